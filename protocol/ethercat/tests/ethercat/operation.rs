//! A MainDevice as a PLC needs one: it checks working counter, states and data of every cycle, brings a device that fell
//! back to OP, and starts over if a device does not answer any more.

use embassy_time::Timer;
use ethercat_maindevice::time;
use ethercrab::error::Error;
use ethercrab::{MainDevice, SubDeviceState};

/// Devices at most, and bytes of the process image.
const DEVICES: usize = 4;
const IMAGE: usize = 64;

const AL_CONTROL: u16 = 0x0120;
const AL_STATUS: u16 = 0x0130;

/// Cycles without all devices in OP after which all start over.
const PATIENCE: usize = 50;

/// What a run of a MainDevice was like.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Operation {
    /// Attempts to bring all devices to OP that failed.
    pub failed_starts: usize,
    /// Starts that succeeded.
    pub starts: usize,
    /// Cycles in which every device was counted and in OP.
    pub good: usize,
    /// Cycles in which a device was not counted or not in OP, or that had no reply.
    pub bad: usize,
    /// Good cycles since the last bad one.
    pub good_since: usize,
    /// Good cycles whose inputs were not those of the last or the last but one cycle: a loss that nothing showed.
    pub silent: usize,
}

/// Runs a cycle each millisecond until `end_ns`, and all that is needed to get there.
pub async fn operate(main: &MainDevice<'_>, devices: usize, end_ns: u64) -> Operation {
    let mut operation = Operation::default();
    while time::now_ns() < end_ns {
        if start_and_run(main, devices, end_ns, &mut operation).await.is_err() {
            operation.failed_starts += 1;
            operation.good_since = 0;
            Timer::after_millis(20).await;
        }
    }
    operation
}

/// Brings all devices to OP and runs cycles until the end, or until it is better to start over.
async fn start_and_run(
    main: &MainDevice<'_>,
    devices: usize,
    end_ns: u64,
    operation: &mut Operation,
) -> Result<(), Error> {
    let group = main.init_single_group::<DEVICES, IMAGE>(time::now_ns).await?;
    if group.len() != devices {
        return Err(Error::UnknownSubDevice);
    }
    let group = group.into_op(main).await?;
    operation.starts += 1;
    let expected = 3 * devices as u16;
    let mut sent: u8 = 0;
    // The cycle in which the last reply is known to have reached all.
    let mut known = None;
    let mut bad = 0;
    while time::now_ns() < end_ns && bad < PATIENCE {
        sent = sent.wrapping_add(1);
        for device in group.iter(main) {
            device.outputs_raw_mut().fill(sent);
        }
        let cycle = group.tx_rx(main).await;
        // Not `all_op`: that is true as well if a device does not answer for its state.
        let in_op = |states: &[SubDeviceState]| states.iter().all(|state| *state == SubDeviceState::Op);
        if cycle.is_ok_and(|cycle| cycle.working_counter == expected && in_op(&cycle.subdevice_states)) {
            let old = group.iter(main).any(|device| sent.wrapping_sub(device.inputs_raw()[0]) > 1);
            operation.silent += usize::from(old && known == Some(sent.wrapping_sub(1)));
            known = Some(sent);
            (operation.good, operation.good_since, bad) = (operation.good + 1, operation.good_since + 1, 0);
        } else {
            known = None;
            (operation.bad, operation.good_since, bad) = (operation.bad + 1, 0, bad + 1);
            for device in group.iter(main) {
                // A device that does not answer shows in the next cycle, too.
                let request = match device.register_read::<[u8; 2]>(AL_STATUS).await {
                    Ok([0x14, _]) => 0x0014_u16,
                    Ok([0x04, _]) => 0x0008,
                    _ => continue,
                };
                let _ = device.register_write(AL_CONTROL, request).await;
            }
        }
        Timer::after_millis(1).await;
    }
    Ok(())
}
