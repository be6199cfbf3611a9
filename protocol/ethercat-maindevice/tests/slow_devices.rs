//! Devices that take their time for each answer, on a cable where frames take none: the MainDevice waits without a flood of
//! frames.

use ethercat_maindevice::ethercrab::error::Error;
use ethercat_maindevice::ethercrab::{MainDeviceConfig, Timeouts};
use ethercat_maindevice::{Config, ExpectedDevice, MainDevice, Scripted, ethercrab, time, with_main_device};
use ethercat_subdevice::description::{DataType, Description, Mailbox, Pdo, PdoEntry};
use ethercat_subdevice::{DeviceConfig, Segment};
use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

const MS: Duration = Duration::from_millis(1);

/// One byte of outputs.
static VALVES: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 1,
    revision: 1,
    order_code: "VALVES",
    name: "Eight valves",
    group: "Test devices",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[Pdo {
        index: 0x1600,
        name: "Outputs",
        entries: &[PdoEntry {
            index: 0x7000,
            subindex: 1,
            bits: 8,
            data_type: DataType::Unsigned8,
            name: "Valves",
        }],
    }],
    inputs: &[],
    mailbox: None,
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

/// The same with a mailbox.
static SMART: Description = Description { mailbox: Some(Mailbox { len: 128, file_capacity: 0 }), ..VALVES };

/// A cable without delay, as that of the README.
fn cable() -> PairConfig {
    PairConfig {
        seed: 1,
        clocks: [Clock::default(); 2],
        links: [Impairment::default(); 2],
        addresses: [None; 2],
    }
}

fn segment(description: &'static Description, answer: Duration, eeprom: Duration) -> Segment {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig {
        answer_delay: answer,
        eeprom_delay: eeprom,
        ..DeviceConfig::new(description)
    });
    segment
}

/// Answer delays and EEPROM delays.
const DELAYS: [(Duration, Duration); 4] =
    [(Duration::ZERO, Duration::ZERO), (MS, Duration::ZERO), (MS, MS), (Duration::from_micros(700), MS)];

#[test]
fn a_device_that_takes_a_millisecond_for_each_answer_comes_to_op_without_a_flood_of_frames() {
    for description in [&VALVES, &SMART] {
        let mut without_delay = 0;
        for (answer, eeprom) in DELAYS {
            let valves = ExpectedDevice {
                vendor: 0x0000_0F00,
                product: 1,
                revision: None,
                output_bytes: 1,
                input_bytes: 0,
            };
            let mac = Mac([0x02, 0x00, 0x00, 0x00, 0x00, 0x01]);
            let config = Config { mac, devices: vec![valves], cycle: MS, watchdog: MS * 20 };
            let main = MainDevice::new(config, Instant::ZERO).unwrap();
            let mut pair = Pair::new(main, segment(description, answer, eeprom), cable());
            loop {
                match pair.next_event(Instant::from_millis(2_000)) {
                    Some(Event::A((_, event))) => {
                        assert_eq!(event, LinkEvent::Up);
                        break;
                    }
                    Some(Event::B(_)) => {}
                    None => panic!("not up after 2 s, {answer:?}, {eeprom:?}"),
                }
            }
            let frames = pair.b().counters().passed;
            if (answer, eeprom) == (Duration::ZERO, Duration::ZERO) {
                without_delay = frames;
            }
            // Each wait begins with a read at once; the others are a millisecond apart.
            let waited = pair.now().as_nanos() / 1_000_000;
            assert!(
                frames <= without_delay + 2 * waited,
                "{frames} frames, {without_delay} alone, {waited} ms"
            );
        }
    }
}

#[test]
fn a_script_of_default_timeouts_waits_for_slow_devices() {
    for (answer, eeprom) in DELAYS {
        let script = with_main_device(
            Timeouts::default(),
            MainDeviceConfig { dc_static_sync_iterations: 0, ..MainDeviceConfig::default() },
            async |main: &ethercrab::MainDevice<'_>| {
                let group = main.init_single_group::<2, 64>(time::now_ns).await?;
                let group = group.into_op(main).await?;
                Ok::<_, Error>(group.tx_rx(main).await?.working_counter)
            },
        );
        let scripted = Scripted::new(script, Instant::ZERO);
        let mut pair = Pair::new(scripted, segment(&SMART, answer, eeprom), cable());
        let result = loop {
            match pair.next_event(Instant::from_millis(2_000)) {
                Some(Event::A(result)) => break Some(result),
                Some(Event::B(_)) => {}
                None => break None,
            }
        };
        assert_eq!(result, Some(Ok(2)), "{answer:?}, {eeprom:?}");
    }
}

/// Answer delay, EEPROM delay, delay of a cable, and delay in the device, of the devices of a line. No answer takes longer than the
/// watchdog of a device that is in OP already, 100 ms: the script sends no outputs before all are.
type Line = &'static [(Duration, Duration, Duration, Duration)];

const ZERO: Duration = Duration::ZERO;
const MICROSECOND: Duration = Duration::from_micros(1);

const LINES: [Line; 6] = [
    &[(ZERO, ZERO, ZERO, ZERO), (MS, ZERO, ZERO, ZERO)],
    &[(MS, MS, ZERO, ZERO), (ZERO, ZERO, ZERO, ZERO), (Duration::from_micros(1_300), ZERO, ZERO, ZERO)],
    &[(Duration::from_nanos(1), Duration::from_nanos(1), ZERO, ZERO); 4],
    &[
        (Duration::from_millis(37), ZERO, MICROSECOND, ZERO),
        (ZERO, Duration::from_micros(90), ZERO, MICROSECOND),
    ],
    &[(Duration::from_millis(90), Duration::from_micros(999), ZERO, ZERO), (MS, ZERO, ZERO, ZERO)],
    &[(ZERO, ZERO, MS, ZERO), (MS, ZERO, ZERO, Duration::from_micros(50))],
];

#[test]
fn a_script_brings_lines_of_unequal_devices_to_op_and_never_floods_the_cable() {
    for (number, line) in LINES.iter().enumerate() {
        for description in [&VALVES, &SMART] {
            let mut segment = Segment::new();
            for (answer_delay, eeprom_delay, cable_delay, forwarding_delay) in *line {
                segment.add(&DeviceConfig {
                    answer_delay: *answer_delay,
                    eeprom_delay: *eeprom_delay,
                    cable_delay: *cable_delay,
                    forwarding_delay: *forwarding_delay,
                    ..DeviceConfig::new(description)
                });
            }
            let script = with_main_device(
                Timeouts::default(),
                MainDeviceConfig { dc_static_sync_iterations: 0, ..MainDeviceConfig::default() },
                async |main: &ethercrab::MainDevice<'_>| {
                    let group = main.init_single_group::<4, 64>(time::now_ns).await?;
                    let group = group.into_op(main).await?;
                    Ok::<_, Error>(group.tx_rx(main).await?.working_counter)
                },
            );
            let mut pair = Pair::new(Scripted::new(script, Instant::ZERO), segment, cable());
            let result = loop {
                match pair.next_event(Instant::from_millis(20_000)) {
                    Some(Event::A(result)) => break Some(result),
                    Some(Event::B(_)) => {}
                    None => break None,
                }
            };
            let devices = line.len();
            let name = description.order_code;
            assert_eq!(result, Some(Ok(2 * devices as u16)), "line {number} of {name}");
            let (frames, ms) = (pair.b().counters().passed, pair.now().as_nanos() / 1_000_000);
            // Some 700 frames read the EEPROM of a device and configure it; each wait has one a millisecond.
            assert!(
                frames <= 2 * ms + 1_500 * devices as u64,
                "line {number} of {name}: {frames} frames in {ms} ms"
            );
        }
    }
}
