//! A MainDevice drives several devices on one cable, in virtual time: what happens to one does not disturb the others.

#![expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test fails by a panic")]

mod disturbed;
mod line;
mod one_place;

use ethercat_maindevice::SubDeviceId;
use ethercat_subdevice::{AlState, AlStatusCode, DeviceId};
use line::*;
use machine::{DownCause, Duration, Instant, LinkEvent};
use virtual_time::Event;

#[test]
fn each_device_has_its_own_data_and_all_share_one_frame_a_cycle() {
    for devices in [2, 5] {
        let mut cell = running(devices);
        let all: Vec<_> = (0..devices as u16).collect();
        assert_eq!(echoing(&mut cell, &all, 10), all);
        let before = (cell.b().frames, cell.a().counters(SubDeviceId(0)).received);
        assert_eq!(events(&mut cell, MS * 1_000), []);
        let received = cell.a().counters(SubDeviceId(0)).received - before.1;
        assert_eq!((cell.b().frames - before.0, received), (1_000, 1_000));
    }
}

#[test]
fn a_cut_between_two_devices_takes_down_only_those_after_it_and_mended_they_come_back() {
    let mut cell = running(5);
    cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(2), true));
    let down = causes(&events(&mut cell, MS * 3_000), &[2, 3, 4]);
    assert_eq!(down, (2..5).map(|device| (device, vec![DownCause::Watchdog])).collect());
    assert_eq!(echoing(&mut cell, &[0, 1], 20), [0, 1]);
    assert_eq!([0, 1].map(|device| lost(&cell, device)), [0, 0]);
    cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(2), false));
    let up = events(&mut cell, MS * 1_000);
    assert!(causes(&up, &[2, 3, 4]).is_empty() && up.len() == 3, "{up:?}");
    assert_eq!(echoing(&mut cell, &[0, 1, 2, 3, 4], 30), [0, 1, 2, 3, 4]);
    assert_eq!([0, 1].map(|device| lost(&cell, device)), [0, 0], "the others did not miss an exchange");
}

#[test]
fn a_device_that_leaves_op_is_named_and_helped_while_the_others_exchange() {
    let mut cell = running(5);
    cell.command_b(|echo, _| echo.segment.fail(DeviceId(1), AlStatusCode(0x0018)));
    let events = events(&mut cell, MS * 50);
    assert_eq!(causes(&events, &[1]), [(1, vec![DownCause::ClosedByPeer])].into());
    assert_eq!(events.last(), Some(&(1, LinkEvent::Up)), "device 2 comes back");
    assert_eq!([0, 2, 3, 4].map(|device| lost(&cell, device)), [0; 4]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2, 3, 4], 40), [0, 1, 2, 3, 4]);
}

#[test]
fn a_device_missing_from_the_start_is_named_and_found_later_while_the_others_run() {
    let mut cell = cell_of(&[expected(&DEVICE, BYTES); 3], &[&DEVICE; 3]);
    cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(2), true));
    let start = events(&mut cell, MS * 2_000);
    assert_eq!(causes(&start, &[0, 1, 2]), [(2, vec![DownCause::NoAnswer])].into());
    assert_eq!(
        explained(&cell, 2),
        "device 3 is missing: check its power and the cable between devices 2 and 3; the cable has 2 devices"
    );
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 50), [0, 1]);
    cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(2), false));
    assert_eq!(events(&mut cell, MS * 1_000), [(2, LinkEvent::Up)]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 60), [0, 1, 2]);
    assert_eq!([0, 1].map(|device| lost(&cell, device)), [0, 0]);
}

#[test]
fn another_product_in_the_middle_of_the_cable_is_named_and_the_others_run() {
    let mut cell = cell_of(&[expected(&DEVICE, BYTES); 3], &[&DEVICE, &OTHER, &DEVICE]);
    let start = events(&mut cell, MS * 2_000);
    assert_eq!(causes(&start, &[0, 1, 2]), [(1, vec![DownCause::Refused])].into());
    assert_eq!(
        explained(&cell, 1),
        "device 2 is another one: expected vendor 0x00000F00, product 0x00000007; found `OTHER` (vendor 0x00000F00, \
         product 0x00000008, revision 0x00000003)"
    );
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 70), [0, 2]);
}

#[test]
fn a_device_that_is_replaced_while_it_is_off_is_named_and_the_right_one_is_taken() {
    let mut cell = running(3);
    let product = |cell: &mut Cell, code: u8| {
        cell.command_b(|echo, now| {
            echo.segment.set_power(now, DeviceId(2), false);
            let eeprom = echo.segment.eeprom_mut(DeviceId(2)).unwrap();
            // Product code, ETG.1000.6.
            eeprom[0x14] = code;
            echo.segment.set_power(now, DeviceId(2), true);
        });
    };
    product(&mut cell, 8);
    let replaced = causes(&events(&mut cell, MS * 3_000), &[2]);
    assert_eq!(replaced[&2].last(), Some(&DownCause::Refused));
    assert!(explained(&cell, 2).starts_with("device 3 is another one"), "{}", explained(&cell, 2));
    product(&mut cell, 7);
    assert_eq!(events(&mut cell, MS * 1_000), [(2, LinkEvent::Up)]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 80), [0, 1, 2]);
    assert_eq!([0, 1].map(|device| lost(&cell, device)), [0, 0]);
}

#[test]
fn a_device_without_power_in_the_middle_cuts_off_those_after_it_and_all_come_back() {
    let mut cell = running(3);
    cell.command_b(|echo, now| echo.segment.set_power(now, DeviceId(1), false));
    assert_eq!(
        causes(&events(&mut cell, MS * 2_000), &[1, 2]),
        [(1, vec![DownCause::Watchdog]), (2, vec![DownCause::Watchdog])].into()
    );
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 90), [0]);
    cell.command_b(|echo, now| echo.segment.set_power(now, DeviceId(1), true));
    assert_eq!(events(&mut cell, MS * 1_000).len(), 2);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 100), [0, 1, 2]);
    assert_eq!(lost(&cell, 0), 0);
}

#[test]
fn a_device_that_flaps_again_and_again_costs_the_others_no_exchange() {
    let mut cell = running(4);
    for round in 0..40_u64 {
        let cut = round % 2 == 0;
        cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(3), cut));
        causes(&events(&mut cell, MS * (7 + 13 * (round as u32 % 11))), &[3]);
        assert_eq!([0, 1, 2].map(|device| lost(&cell, device)), [0; 3], "round {round}");
    }
    events(&mut cell, MS * 2_000);
    assert_eq!(echoing(&mut cell, &[0, 1, 2, 3], 110), [0, 1, 2, 3]);
}

#[test]
fn a_device_is_disconnected_alone() {
    let mut cell = running(3);
    cell.command_a(|main, now| main.disconnect(now, SubDeviceId(1)));
    let closed = events(&mut cell, MS * 1_000);
    assert_eq!(causes(&closed, &[1]), [(1, vec![DownCause::ClosedHere])].into());
    let states = [0, 1, 2].map(|id| cell.b().segment.state(DeviceId(id)).unwrap().0);
    assert_eq!(states, [AlState::Op, AlState::Init, AlState::Op]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 120), [0, 2]);
}

#[test]
fn a_cable_that_is_cut_at_the_main_device_takes_all_down_and_all_come_back() {
    let mut cell = running(3);
    cell.set_cut(true);
    let all = [0, 1, 2];
    let down = causes(&events(&mut cell, MS * 3_000), &all);
    assert_eq!(down, all.map(|device| (device, vec![DownCause::Watchdog])).into());
    cell.set_cut(false);
    assert_eq!(events(&mut cell, MS * 2_000).len(), 3);
    assert_eq!(echoing(&mut cell, &all, 130), all);
}

#[test]
fn process_data_of_64_devices_of_256_bytes_each_way_are_spread_over_frames() {
    let devices = 64;
    let mut cell = cell_of(&vec![expected(&LARGE, 256); devices], &vec![&LARGE; devices]);
    assert_eq!(events(&mut cell, MS * 3_000).len(), devices);
    let all: Vec<_> = (0..devices as u16).collect();
    assert_eq!(echoing(&mut cell, &all, 140), all);
    let before = cell.b().frames;
    assert_eq!(events(&mut cell, MS * 100), []);
    assert_eq!(cell.b().frames - before, 100 * 32, "two devices a frame");
    assert!(cell.b().longest <= 1514);
    assert!(all.iter().all(|device| lost(&cell, *device) == 0));
}

#[test]
fn a_device_that_is_held_while_op_is_being_requested_goes_back_to_safe_op() {
    for micros in (0..400).step_by(10) {
        let mut cell = cell_of(&[expected(&DEVICE, BYTES)], &[&DEVICE]);
        let is_safe_op = |event: &Event<_, (DeviceId, ethercat_subdevice::Event)>| {
            matches!(
                event,
                Event::B((_, ethercat_subdevice::Event::StateChanged { state: AlState::SafeOp, .. }))
            )
        };
        while !is_safe_op(&cell.next_event(Instant::from_millis(1_000)).unwrap()) {}
        let held_at = cell.now() + Duration::from_micros(micros);
        while cell.next_event(held_at).is_some() {}
        cell.command_a(|main, _| main.hold_safe_op(SubDeviceId(0), true));
        events(&mut cell, MS * 100);
        let state = cell.b().segment.state(DeviceId(0)).unwrap().0;
        assert_eq!(
            (state, cell.a().inputs(SubDeviceId(0)).is_some()),
            (AlState::SafeOp, true),
            "{micros} us"
        );
    }
}
