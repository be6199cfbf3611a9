//! Distributed clocks: delays measured from the cable, clocks that run too fast or too slow and are made to agree, SYNC
//! signals.

use embassy_time::Timer;
use ethercat_maindevice::time;
use ethercat_subdevice::{AlStatusCode, DeviceConfig, DeviceId, Event, LocalClock, Segment};
use ethercrab::error::Error;
use ethercrab::subdevice_group::DcConfiguration;
use ethercrab::{DcSync, MainDevice, MainDeviceConfig};
use machine::{Duration, Instant};

use crate::devices::{BRIDGE, SIMPLE};
use crate::main_device::Stand;
use crate::raw_main_device::{APRD, BWR, RawMainDevice};

/// Start in ns, error in ppb, and delay of the cable in ns, of each device.
const DEVICES: [(u64, i64, u64); 4] = [
    (0, 0, 500),
    (1_000_000_000, 100_000, 120),
    (77, -100_000, 1_000),
    (u32::MAX as u64 - 50_000_000, 30_000, 40),
];

const FORWARDING_NS: u64 = 300;

fn bridge((start_ns, error_ppb, cable_ns): (u64, i64, u64)) -> DeviceConfig {
    DeviceConfig {
        forwarding_delay: Duration::from_nanos(FORWARDING_NS),
        cable_delay: Duration::from_nanos(cable_ns),
        clock: LocalClock { start_ns, error_ppb },
        ..DeviceConfig::new(&BRIDGE)
    }
}

fn line() -> Segment {
    let mut segment = Segment::new();
    for device in DEVICES {
        segment.add(&bridge(device));
    }
    segment
}

#[test]
fn a_broadcast_write_latches_the_time_at_each_port_that_the_frame_comes_by() {
    let mut segment = Segment::new();
    for cable_ns in [500, 100, 30] {
        segment.add(&bridge((5_000, 0, cable_ns)));
    }
    let mut main_device = RawMainDevice::new(segment);
    assert_eq!(main_device.exchange(BWR, 0, 0x0900, &[0; 4]).1, 3);
    let times: Vec<[u32; 2]> = (0..3_u16)
        .map(|position| {
            let (times, _) = main_device.exchange(APRD, 0_u16.wrapping_sub(position), 0x0900, &[0; 8]);
            [0, 4].map(|at| u32::from_le_bytes(times[at..at + 4].try_into().unwrap()))
        })
        .collect();
    let first = 5_000 + 500;
    let second = first + 300 + 100;
    let third = second + 300 + 30;
    let back_at_second = third + 300 + 30;
    let back_at_first = back_at_second + 300 + 100;
    assert_eq!(times, [[first, back_at_first], [second, back_at_second], [third, 0]]);
    // Another frame latches nothing.
    assert_eq!(main_device.exchange(APRD, 0, 0x0900, &[0; 4]).0, first.to_le_bytes());
}

#[test]
fn a_device_without_clock_does_not_count_in_the_latch_of_the_others() {
    let mut segment = line();
    segment.add(&DeviceConfig::new(&SIMPLE));
    let mut main_device = RawMainDevice::new(segment);
    assert_eq!(main_device.exchange(BWR, 0, 0x0900, &[0; 4]).1, DEVICES.len() as u16);
}

/// Returns the largest difference in ns between the system times of the devices at one instant.
fn spread(segment: &Segment, now: Instant) -> u64 {
    let times: Vec<u64> =
        (0..DEVICES.len()).map(|id| segment.system_time(DeviceId(id), now).unwrap()).collect();
    times.iter().max().unwrap() - times.iter().min().unwrap()
}

#[test]
fn ethercrab_measures_the_delays_of_the_cable_and_makes_all_clocks_agree() {
    let mut segment = line();
    let mut stand = Stand::new(&mut segment);
    stand.config = MainDeviceConfig { dc_static_sync_iterations: 10_000, ..MainDeviceConfig::default() };
    let ended = stand.run(async |main| {
        let group = main.init_single_group::<4, 2048>(time::now_ns).await?;
        let delays: Vec<u32> = group.iter(main).map(|device| device.propagation_delay()).collect();
        let mut differences = Vec::new();
        for device in group.iter(main) {
            differences.push(device.register_read::<u32>(0x092C_u16).await? & 0x7FFF_FFFF);
        }
        Ok::<_, Error>((delays, differences))
    });
    let (delays, differences) = ended.result.unwrap().unwrap();
    let mut true_delays = vec![0];
    for (_, _, cable_ns) in &DEVICES[1..] {
        true_delays.push(true_delays.last().unwrap() + (FORWARDING_NS + cable_ns) as u32);
    }
    // The clocks measure with their own errors: 100 ppm of some microseconds.
    let off = delays.iter().zip(&true_delays).map(|(measured, truth)| measured.abs_diff(*truth)).max();
    assert!(off.unwrap() <= FORWARDING_NS as u32 / 2, "{delays:?} instead of {true_delays:?}");
    assert!(differences.iter().all(|difference| *difference < 20), "{differences:?} ns");
    let spread = spread(&segment, ended.at);
    assert!(spread < 200, "{spread} ns");
}

#[test]
fn ethercrab_measures_the_delays_of_a_tree_as_they_are() {
    let mut segment = Segment::new();
    let device = |cable_ns| bridge((0, 0, cable_ns));
    // A fork with a line of two at port 1 and one device at port 2.
    let first = segment.add(&device(500));
    let fork = segment.add_at(&device(100), first, 1).unwrap();
    let branch = segment.add_at(&device(220), fork, 1).unwrap();
    segment.add_at(&device(40), branch, 1).unwrap();
    segment.add_at(&device(360), fork, 2).unwrap();
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<8, 4096>(time::now_ns).await?;
        Ok::<_, Error>(group.iter(main).map(|device| device.propagation_delay()).collect::<Vec<_>>())
    });
    let measured = ended.result.unwrap().unwrap();
    let to_fork = 300 + 100;
    let to_branch = to_fork + 300 + 220;
    let to_its_end = to_branch + 300 + 40;
    // The frame has been down the branch and back when it leaves for the last one.
    let back_at_fork = to_its_end + 300 + 40 + 300 + 220;
    let truth = [0, to_fork, to_branch, to_its_end, back_at_fork + 300 + 360];
    assert_eq!(measured, truth);
}

#[test]
fn sync_signals_come_at_every_device_at_the_same_time_and_by_the_period() {
    let mut segment = line();
    let mut stand = Stand::new(&mut segment);
    stand.config = MainDeviceConfig { dc_static_sync_iterations: 10_000, ..MainDeviceConfig::default() };
    let ended = stand.run(async |main: &MainDevice<'_>| {
        let mut group = main.init_single_group::<4, 2048>(time::now_ns).await?;
        for mut device in group.iter_mut(main) {
            device.set_dc_sync(DcSync::Sync01 { sync1_period: Duration::from_micros(100) });
        }
        let configuration = DcConfiguration {
            start_delay: Duration::from_millis(20),
            sync0_period: Duration::from_millis(1),
            sync0_shift: Duration::from_micros(500),
        };
        let group = group.into_pre_op_pdi(main).await?;
        let group = group.configure_dc_sync(main, configuration).await?;
        let group = group.into_safe_op(main).await?;
        let group = group.request_into_op(main).await?;
        let mut all_op = false;
        for _ in 0..100 {
            let cycle = group.tx_rx_dc(main).await?;
            all_op = cycle.all_op();
            Timer::after_nanos(cycle.extra.next_cycle_wait.as_nanos() as u64).await;
        }
        Ok::<_, Error>(all_op)
    });
    assert_eq!(ended.result, Some(Ok(true)));
    let pulses = |wanted: fn(&Event) -> Option<u64>| -> Vec<(u64, DeviceId, Instant)> {
        ended.events.iter().filter_map(|(at, id, event)| Some((wanted(event)?, *id, *at))).collect()
    };
    let sync0 = pulses(|event| match event {
        Event::Sync0 { system_time_ns } => Some(*system_time_ns),
        _ => None,
    });
    let sync1 = pulses(|event| match event {
        Event::Sync1 { system_time_ns } => Some(*system_time_ns),
        _ => None,
    });
    assert!(sync0.len() >= 4 * 70, "{} pulses", sync0.len());
    for (time, _, at) in &sync0 {
        assert_eq!(time % 1_000_000, 0);
        let (_, _, other) = sync0.iter().find(|(other, id, _)| other == time && *id == DeviceId(0)).unwrap();
        let apart = at.since(*other).max(other.since(*at));
        assert!(apart < Duration::from_nanos(300), "{apart:?} apart at {time}");
    }
    assert!(sync1.iter().all(|(time, ..)| time % 1_000_000 == 100_000));
}

#[test]
fn a_sync1_longer_than_the_cycle_comes_after_every_second_sync0_and_a_cycle_of_0_makes_one_pulse() {
    for (cycle, sync1, expected) in [
        (
            1_000_u32,
            1_500_u32,
            vec![(0, 10_000), (0, 11_000), (1, 11_500), (0, 12_000), (0, 13_000), (1, 13_500)],
        ),
        (
            1_000,
            0,
            vec![
                (0, 10_000),
                (1, 10_000),
                (0, 11_000),
                (1, 11_000),
                (0, 12_000),
                (1, 12_000),
                (0, 13_000),
                (1, 13_000),
            ],
        ),
        (0, 300, vec![(0, 10_000), (1, 10_300)]),
    ] {
        let mut segment = Segment::new();
        segment.add(&bridge((0, 0, 0)));
        let mut main_device = RawMainDevice::start(segment);
        main_device.write(0x0990, &10_000_000_u64.to_le_bytes());
        main_device.write(0x09A0, &(cycle * 1_000).to_le_bytes());
        main_device.write(0x09A4, &(sync1 * 1_000).to_le_bytes());
        main_device.write(0x0981, &[0x07]);
        main_device.wait(Duration::from_micros(13_600));
        let pulses: Vec<(u8, u64)> = main_device
            .events
            .iter()
            .filter_map(|(_, event)| match event {
                Event::Sync0 { system_time_ns } => Some((0, system_time_ns / 1_000)),
                Event::Sync1 { system_time_ns } => Some((1, system_time_ns / 1_000)),
                _ => None,
            })
            .collect();
        assert_eq!(pulses, expected, "{cycle} us and {sync1} us");
    }
}

/// Found by the fuzzer: near the end of the 64-bit system time, the clock repeated one signal for ever.
#[test]
fn sync_signals_go_on_where_the_64_bit_system_time_begins_anew() {
    let mut segment = Segment::new();
    segment.add(&bridge((0, 0, 0)));
    let mut main_device = RawMainDevice::start(segment);
    let ends_in = |nanos: u64| (u64::MAX - nanos).to_le_bytes();
    main_device.write(0x0920, &ends_in(10_000_000));
    main_device.write(0x0990, &ends_in(2_499_999));
    main_device.write(0x09A0, &1_000_000_u32.to_le_bytes());
    main_device.write(0x0981, &[0x03]);
    main_device.wait(Duration::from_millis(12));
    let pulses: Vec<u64> = main_device
        .events
        .iter()
        .filter_map(|(_, event)| match event {
            Event::Sync0 { system_time_ns } => Some(system_time_ns.wrapping_add(2_500_000)),
            _ => None,
        })
        .collect();
    assert_eq!(pulses, [0, 1_000_000, 2_000_000, 3_000_000, 4_000_000]);
}

#[test]
fn a_sync_start_that_has_passed_makes_no_signal_and_keeps_the_device_from_safe_op() {
    let mut segment = Segment::new();
    segment.add(&bridge((1_000_000, 0, 0)));
    let mut main_device = RawMainDevice::start(segment);
    main_device.write(0x0990, &500_000_u64.to_le_bytes());
    main_device.write(0x09A0, &1_000_000_u32.to_le_bytes());
    main_device.write(0x0981, &[0x03]);
    main_device.wait(Duration::from_secs(1));
    assert!(main_device.events.iter().all(|(_, event)| !matches!(event, Event::Sync0 { .. })));
    main_device.write(0x0810, &[0x00, 0x11, 0x00, 0x01, 0x64, 0, 1, 0]);
    main_device.write(0x0818, &[0x00, 0x14, 0x00, 0x01, 0x20, 0, 1, 0]);
    main_device.request_state(4);
    assert_eq!(main_device.al_status(), (0x12, 0x0030));
}

#[test]
fn a_device_asked_for_no_sync_signal_needs_none_for_safe_op() {
    // Cyclic operation without an output, and outputs without cyclic operation.
    for activation in [0x01, 0x02, 0x04, 0x06] {
        let mut segment = Segment::new();
        segment.add(&DeviceConfig::new(&BRIDGE));
        let mut main_device = RawMainDevice::start(segment);
        main_device.write(0x0981, &[activation]);
        main_device.operate();
    }
}

/// Starts SYNC0 with a period of a millisecond, 10 ms from now.
fn start_sync(main_device: &mut RawMainDevice) {
    main_device.write(0x0990, &(main_device.now.as_nanos() + 10_000_000).to_le_bytes());
    main_device.write(0x09A0, &1_000_000_u32.to_le_bytes());
    main_device.write(0x0981, &[0x03]);
}

#[test]
fn a_device_whose_sync_signals_stop_leaves_op_after_two_periods_and_comes_back_with_them_only() {
    let mut segment = Segment::new();
    segment.add(&bridge((0, 0, 0)));
    let mut main_device = RawMainDevice::start(segment);
    // Without the watchdog of outputs.
    main_device.write(0x0420, &[0, 0]);
    start_sync(&mut main_device);
    main_device.operate();
    main_device.wait(Duration::from_micros(30_500));
    assert_eq!(main_device.al_status(), (0x08, 0));
    main_device.write(0x0981, &[0x00]);
    main_device.wait(Duration::from_millis(1));
    assert_eq!(main_device.al_status(), (0x08, 0));
    main_device.wait(Duration::from_millis(1));
    assert_eq!(main_device.al_status(), (0x14, AlStatusCode::FATAL_SYNC_ERROR.0));
    main_device.request_state(0x14);
    main_device.request_state(8);
    assert_eq!(main_device.al_status(), (0x14, AlStatusCode::NO_SYNC_ERROR.0));
    main_device.request_state(0x14);
    start_sync(&mut main_device);
    main_device.request_state(8);
    main_device.wait(Duration::from_millis(50));
    assert_eq!(main_device.al_status(), (0x08, 0));
}
