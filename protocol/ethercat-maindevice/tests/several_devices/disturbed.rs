//! What comes on the cable besides the replies of devices in their places.

use ethercat_maindevice::{GroupMainDevice, MainDevice, SubDeviceId};
use ethercat_subdevice::DeviceId;
use machine::{DownCause, Duration, Instant, LinkEvent, Machine, Port, Source};
use virtual_time::{Impairment, Pair, Side};

use crate::line::*;

/// Runs for 2 s with a cut cable in between, and returns all frames to the devices with their times.
fn frames<M: Machine>(main: M, devices: usize) -> Vec<(Instant, Vec<u8>)> {
    let mut cell: Pair<M, Echo> = connected(main, &vec![&DEVICE; devices], 1, good_cable());
    cell.command_b(|echo, _| echo.kept = Some(Vec::new()));
    for cut in [false, true, false] {
        cell.set_cut(cut);
        let until = cell.now() + MS * 700;
        while cell.next_event(until).is_some() {}
    }
    cell.command_b(|echo, _| echo.kept.take().unwrap())
}

#[test]
fn the_frames_to_one_device_are_those_of_a_group_of_one_byte_for_byte() {
    let config = config(&[expected(&DEVICE, BYTES)]);
    let of_many = frames(MainDevice::new(config.clone(), Instant::ZERO).unwrap(), 1);
    let of_group = frames(GroupMainDevice::new(config, Instant::ZERO), 1);
    assert!(of_many.len() > 1_500, "{}", of_many.len());
    assert!(of_many == of_group);
}

#[test]
fn devices_that_have_changed_places_are_named_and_those_that_run_go_on() {
    let mut cell = running(3);
    // Device 3 comes to the second place; device 2, which lost its power, to the third.
    cell.command_b(|echo, now| {
        echo.swapped = Some((1, 2));
        for powered in [false, true] {
            echo.segment.set_power(now, DeviceId(1), powered);
        }
    });
    let down = causes(&events(&mut cell, MS * 3_000), &[1]);
    assert_eq!(down[&1].last(), Some(&DownCause::Refused), "{down:?}");
    assert_eq!(
        explained(&cell, 1),
        "place 2 on the cable has device 3, which runs: restore the order of the devices"
    );
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 10), [0, 2]);
    assert_eq!([0, 2].map(|device| lost(&cell, device)), [0, 0]);
    cell.command_b(|echo, _| echo.swapped = None);
    assert_eq!(events(&mut cell, MS * 1_000), [(1, LinkEvent::Up)]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 20), [0, 1, 2]);
}

#[test]
fn another_main_device_is_reported_for_each_device_and_nothing_is_sent_until_the_cable_is_quiet() {
    let mut cell = running(3);
    // Writes AL control of all devices, from another source address.
    let mut frame = [0; 60];
    frame[..6].fill(0xFF);
    frame[6..12].copy_from_slice(&[0, 0x0E, 0x8C, 0, 0, 1]);
    frame[12..16].copy_from_slice(&[0x88, 0xA4, 14, 0x10]);
    frame[16..28].copy_from_slice(&[8, 0, 0, 0, 0x20, 1, 2, 0, 0, 0, 1, 0]);
    let stranger = |cell: &mut Cell| {
        let from = Source { port: Port::Ethernet, peer: None };
        cell.command_a(|main, now| main.handle_frame(now, from, &frame));
    };
    for _ in 0..2 {
        stranger(&mut cell);
        assert_eq!(events(&mut cell, MS * 5), [], "two frames prove nothing");
    }
    stranger(&mut cell);
    let down = causes(&events(&mut cell, MS * 5), &[0, 1, 2]);
    assert_eq!(down, [0, 1, 2].map(|device| (device, vec![DownCause::Refused])).into());
    assert!(explained(&cell, 2).contains("00:0e:8c:00:00:01"), "{}", explained(&cell, 2));
    let before = cell.b().frames;
    for _ in 0..10 {
        stranger(&mut cell);
        assert_eq!(events(&mut cell, MS * 200), []);
    }
    assert_eq!(cell.b().frames, before, "it sends nothing");
    assert_eq!(events(&mut cell, MS * 10_000).len(), 3);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 30), [0, 1, 2]);
    assert_eq!(cell.a().cable_counters().foreign, 13);
}

#[test]
fn with_one_frame_in_fifty_lost_all_devices_come_to_op_and_each_loss_is_counted() {
    for seed in 1..=10 {
        let cable = Impairment { loss_ppm: 10_000, ..good_cable() };
        let mut cell = cell_on(&[expected(&DEVICE, BYTES); 4], &[&DEVICE; 4], seed, cable);
        events(&mut cell, MS * 20_000);
        let before = [0, 1, 2, 3].map(|device| cell.a().counters(SubDeviceId(device)));
        events(&mut cell, MS * 5_000);
        for (device, before) in before.iter().enumerate() {
            let counters = cell.a().counters(SubDeviceId(device as u16)).since(before);
            assert!(counters.lost > 10 && counters.received > 1_000, "seed {seed}: {counters:?}");
            assert_eq!(counters.skipped, 0, "no host holds this MainDevice up");
        }
    }
}

#[test]
fn replies_that_come_late_or_twice_are_counted_and_never_taken_for_others() {
    let cable = Impairment {
        jitter: Duration::from_millis(12),
        duplicate_ppm: 50_000,
        loss_ppm: 1_000,
        ..good_cable()
    };
    for seed in 1..=5 {
        let mut cell = cell_of(&[expected(&DEVICE, BYTES); 3], &[&DEVICE; 3]);
        assert_eq!(events(&mut cell, MS * 1_000).len(), 3);
        for side in [Side::A, Side::B] {
            cell.set_impairment(side, cable);
        }
        for round in 0..100 {
            for device in 0..3 {
                cell.command_a(|main, _| {
                    main.outputs_mut(SubDeviceId(device)).fill(10 * device as u8 + round % 10)
                });
            }
            events(&mut cell, MS * 20);
            for device in 0..3 {
                let inputs = cell.a().inputs(SubDeviceId(device)).map(<[u8]>::to_vec);
                let is_its = |byte: &u8| *byte == 0 || byte / 10 == device as u8;
                assert!(inputs.is_none_or(|inputs| inputs.iter().all(is_its)), "seed {seed} {device}");
            }
        }
        assert!(cell.a().cable_counters().late > 10, "{:?}", cell.a().cable_counters());
        for side in [Side::A, Side::B] {
            cell.set_impairment(side, good_cable());
        }
        events(&mut cell, MS * 10_000);
        assert_eq!(echoing(&mut cell, &[0, 1, 2], 40), [0, 1, 2], "seed {seed}");
    }
}

#[test]
fn flipped_bits_do_not_keep_the_devices_from_exchanging_afterwards() {
    for seed in 1..=30 {
        let cable = Impairment { corrupt_ppm: 10_000, ..good_cable() };
        let mut cell = cell_on(&[expected(&DEVICE, BYTES); 3], &[&DEVICE; 3], seed, cable);
        events(&mut cell, MS * 3_000);
        for side in [Side::A, Side::B] {
            cell.set_impairment(side, good_cable());
        }
        events(&mut cell, MS * 40_000);
        assert_eq!(echoing(&mut cell, &[0, 1, 2], 50), [0, 1, 2], "seed {seed}");
    }
}
