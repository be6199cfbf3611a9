//! A controller of others maps the process data of a drive as it needs them, and moves it.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use ethercat_drive::{DriveConfig, Drives, State, control};
use ethercat_maindevice::ethercrab::error::{CoeAbortCode, Error, MailboxError};
use ethercat_maindevice::ethercrab::{MainDevice, MainDeviceConfig, Timeouts};
use ethercat_maindevice::{Scripted, time, with_main_device};
use machine::{Duration, Instant};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

const MS: Duration = Duration::from_millis(1);
const START: i32 = 5_000;

/// Entries that a controller maps, each as index, subindex and bits.
#[derive(Clone, Copy)]
struct Mapping {
    outputs: &'static [u32],
    inputs: &'static [u32],
}

/// As the CiA 402 class of KickCAT maps a drive, with a gap that aligns the mode.
const KICKCAT: Mapping = Mapping {
    outputs: &[0x6040_0010, 0x6060_0008, 0x0000_0008, 0x607A_0020, 0x60FF_0020, 0x6071_0010],
    inputs: &[0x6041_0010, 0x6061_0008, 0x0000_0008, 0x6064_0020, 0x606C_0020, 0x6077_0010, 0x603F_0010],
};

/// The mode by SDO alone, another order, and the dummy entry of an UNSIGNED8.
const SHORT: Mapping = Mapping {
    outputs: &[0x607A_0020, 0x0005_0008, 0x6040_0010],
    inputs: &[0x6062_0020, 0x6064_0020, 0x60F4_0020, 0x6041_0010],
};

/// No target: the motor stays where it is.
const NO_TARGET: Mapping =
    Mapping { outputs: &[0x6040_0010, 0x6060_0008], inputs: &[0x6064_0020, 0x6041_0010] };

/// Returns the place of an object in process data that are mapped so, and its length in bytes.
fn place(mapping: &[u32], index: u16) -> Option<std::ops::Range<usize>> {
    let mut at = 0;
    for entry in mapping {
        let len = (entry & 0xFF) as usize / 8;
        if entry >> 16 == index.into() {
            return Some(at..at + len);
        }
        at += len;
    }
    None
}

fn get(mapping: &[u32], inputs: &[u8], index: u16) -> Option<i32> {
    let bytes = inputs.get(place(mapping, index)?)?;
    Some(match *bytes {
        [a] => (a as i8).into(),
        [a, b] => i16::from_le_bytes([a, b]).into(),
        [a, b, c, d] => i32::from_le_bytes([a, b, c, d]),
        _ => return None,
    })
}

/// Maps as a controller does: each object without entries first, then the entries, then their number.
async fn map(main: &MainDevice<'_>, mapping: Mapping) -> Result<u16, Error> {
    let group = main.init_single_group::<2, 64>(time::now_ns).await?;
    let device = group.iter(main).next().ok_or(Error::UnknownSubDevice)?;
    device.sdo_write(0x6060, 0, 8_i8).await?;
    for (object, assignment, entries) in [(0x1600, 0x1C12, mapping.outputs), (0x1A00, 0x1C13, mapping.inputs)]
    {
        device.sdo_write(object, 0, 0_u8).await?;
        for (number, entry) in (1..).zip(entries) {
            device.sdo_write(object, number, *entry).await?;
        }
        device.sdo_write(object, 0, entries.len() as u8).await?;
        device.sdo_write(assignment, 0, 0_u8).await?;
        device.sdo_write(assignment, 1, object).await?;
        device.sdo_write(assignment, 0, 1_u8).await?;
    }
    device.sdo_write(0x60C2, 1, 2_u8).await?;
    device.sdo_write(0x60C2, 2, -3_i8).await?;
    let group = group.into_op(main).await?;
    let mut step = 0;
    let (mut target, mut word) = (None, control::DISABLE_VOLTAGE);
    for _ in 0..500 {
        time::wait_until(time::now() + MS * 2).await;
        {
            let device = group.iter(main).next().ok_or(Error::UnknownSubDevice)?;
            let mut outputs = device.outputs_raw_mut();
            for (index, value) in [(0x6040, i32::from(word)), (0x607A, target.unwrap_or(0)), (0x6060, 8)] {
                if let Some(place) = place(mapping.outputs, index) {
                    let len = place.len();
                    outputs[place].copy_from_slice(&value.to_le_bytes()[..len]);
                }
            }
        }
        group.tx_rx(main).await?;
        let device = group.iter(main).next().ok_or(Error::UnknownSubDevice)?;
        let inputs = device.inputs_raw();
        let status = get(mapping.inputs, &inputs, 0x6041).unwrap_or(0) as u16;
        let position = get(mapping.inputs, &inputs, 0x6064).unwrap_or(0);
        word = match State::of(status) {
            Some(State::SwitchOnDisabled) => control::SHUTDOWN,
            Some(State::ReadyToSwitchOn) => control::SWITCH_ON,
            Some(State::SwitchedOn | State::OperationEnabled) => control::ENABLE_OPERATION,
            _ => control::DISABLE_VOLTAGE,
        };
        target = Some(match target {
            Some(target) if State::of(status) == Some(State::OperationEnabled) => {
                step += 1;
                target + if step <= 200 { 100 } else { 0 }
            }
            _ => position,
        });
        if step == 150 {
            // At 100 increments each 2 ms.
            if let Some(velocity) = get(mapping.inputs, &inputs, 0x606C) {
                assert_eq!((velocity, get(mapping.inputs, &inputs, 0x6077)), (50_000, Some(0)));
            }
            if let Some(demand) = get(mapping.inputs, &inputs, 0x6062) {
                let following_error = get(mapping.inputs, &inputs, 0x60F4);
                assert_eq!(Some(demand - position), following_error);
            }
        }
    }
    Ok(group.tx_rx(main).await?.working_counter)
}

fn run<T>(script: impl AsyncFnOnce(&MainDevice<'_>) -> Result<T, Error>) -> (Result<T, Error>, Drives) {
    let config = DriveConfig { position: START, ..DriveConfig::new(1, 1e6) };
    let drives = Drives::new(&[config], MS, Instant::ZERO);
    let cable = Impairment { delay: Duration::from_micros(10), ..Impairment::default() };
    let config =
        PairConfig { seed: 1, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] };
    let settings = MainDeviceConfig { dc_static_sync_iterations: 0, ..MainDeviceConfig::default() };
    let script = with_main_device(Timeouts::default(), settings, script);
    let mut pair = Pair::new(Scripted::new(script, Instant::ZERO), drives, config);
    let ended = loop {
        if let Event::A(result) = pair.next_event(Instant::ZERO + Duration::from_secs(10)).unwrap() {
            break result;
        }
    };
    let drives = pair.command_b(|drives, now| std::mem::replace(drives, Drives::new(&[], MS, now)));
    (ended, drives)
}

#[test]
fn a_drive_moves_by_the_process_data_that_its_controller_maps() {
    for (mapping, end) in [(KICKCAT, START + 20_000), (SHORT, START + 20_000), (NO_TARGET, START)] {
        let (ended, drives) = run(async |main: &MainDevice<'_>| map(main, mapping).await);
        assert_eq!(ended, Ok(3));
        let drive = drives.drive(0).unwrap();
        assert_eq!(
            (drive.state(), drive.position()),
            (State::OperationEnabled, end),
            "{:X?}",
            mapping.outputs
        );
        assert_eq!(drive.period(), MS * 2, "as object 0x60C2 says");
    }
}

#[test]
fn what_a_drive_cannot_map_is_refused_and_its_interpolation_time_is_that_of_its_owner_first() {
    let (ended, drives) = run(async |main: &MainDevice<'_>| {
        let group = main.init_single_group::<2, 64>(time::now_ns).await?;
        let device = group.iter(main).next().ok_or(Error::UnknownSubDevice)?;
        let period = (device.sdo_read::<u8>(0x60C2, 1).await?, device.sdo_read::<i8>(0x60C2, 2).await?);
        let mut refused = Vec::new();
        device.sdo_write(0x1600, 0, 0_u8).await?;
        // An object that is not there, an input, another length, and times that there are not.
        let wrong = [(0x1600, 1, 0x6099_0120_u32), (0x1600, 1, 0x6041_0010), (0x1600, 1, 0x6060_0010)];
        for (index, subindex, value) in wrong {
            refused.push(device.sdo_write(index, subindex, value).await);
        }
        refused.push(device.sdo_write(0x60C2, 1, 0_u8).await);
        refused.push(device.sdo_write(0x60C2, 2, 1_i8).await);
        refused.push(device.sdo_write(0x60C2, 2, -7_i8).await);
        let codes = refused.into_iter().map(|result| match result {
            Err(Error::Mailbox(MailboxError::Aborted { code, .. })) => Some(code),
            _ => None,
        });
        Ok((period, codes.collect::<Vec<_>>()))
    });
    let (period, codes) = ended.unwrap();
    assert_eq!(period, (1, -3));
    let (not_mappable, range) = (CoeAbortCode::PdoMappingFailed, CoeAbortCode::ValueOutOfRange);
    let expected = [not_mappable, not_mappable, not_mappable, range, range, range].map(Some);
    assert_eq!(codes, expected);
    assert_eq!(drives.drive(0).unwrap().period(), MS);
}
