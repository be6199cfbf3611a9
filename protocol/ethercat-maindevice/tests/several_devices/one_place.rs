//! One device in the middle of a cable is driven, and the others are left as they are.

use ethercat_maindevice::{MainDevice, SubDeviceId};
use ethercat_subdevice::{AlState, DeviceId};
use machine::{DownCause, Instant, LinkEvent};

use crate::line::*;

/// Expects one device at this position, from 0, among three.
fn cell_from(position: u16) -> Cell {
    let main =
        MainDevice::at_positions(&[position], config(&[expected(&OTHER, BYTES)]), Instant::ZERO).unwrap();
    let mut cell = connected(main, &[&DEVICE, &OTHER, &DEVICE], 1, good_cable());
    cell.command_b(|echo, _| echo.kept = Some(Vec::new()));
    cell
}

fn states(cell: &Cell) -> [AlState; 3] {
    [0, 1, 2].map(|id| cell.b().segment.state(DeviceId(id)).unwrap().0)
}

/// Returns the command, address and register of each datagram in a frame.
fn datagrams(frame: &[u8]) -> Vec<(u8, u16, u16)> {
    let end = 16 + usize::from(u16::from_le_bytes([frame[14], frame[15]]) & 0x07FF);
    let mut datagrams = Vec::new();
    let mut at = 16;
    while at < end {
        let word = |place: usize| u16::from_le_bytes([frame[at + place], frame[at + place + 1]]);
        datagrams.push((frame[at], word(2), word(4)));
        at += 12 + usize::from(word(6) & 0x07FF);
    }
    datagrams
}

#[test]
fn a_device_at_its_position_is_driven_and_no_datagram_reaches_the_others() {
    let mut cell = cell_from(1);
    assert_eq!(events(&mut cell, MS * 1_000), [(0, LinkEvent::Up)]);
    assert_eq!(echoing(&mut cell, &[0], 30), [0]);
    assert_eq!(states(&cell), [AlState::Init, AlState::Op, AlState::Init]);
    cell.command_a(|main, now| main.disconnect(now, SubDeviceId(0)));
    let closed = events(&mut cell, MS * 100);
    assert_eq!(causes(&closed, &[0]), [(0, vec![DownCause::ClosedHere])].into());
    assert_eq!(states(&cell), [AlState::Init; 3]);
    let frames = cell.b().kept.clone().unwrap();
    let all: Vec<_> = frames.iter().flat_map(|(_, frame)| datagrams(frame)).collect();
    let is_of_the_device = |(command, address, register): &(u8, u16, u16)| match command {
        0 => true,
        1..=3 => *address == 0_u16.wrapping_sub(1),
        4..=6 => *address == 0x1001,
        // 0x1000 logical addresses for each position.
        10..=12 => (*register, *address >> 12) == (0, 1),
        _ => false,
    };
    let others: Vec<_> = all.iter().filter(|datagram| !is_of_the_device(datagram)).collect();
    assert!(others.is_empty() && all.len() > 1_000, "{} of {}: {:04x?}", others.len(), all.len(), others);
}

#[test]
fn a_position_beyond_the_end_is_named_with_the_number_of_devices_on_the_cable() {
    for (position, between) in [(3, "devices 3 and 4"), (7, "devices 7 and 8")] {
        let mut cell = cell_from(position);
        let missing = events(&mut cell, MS * 2_000);
        assert_eq!(causes(&missing, &[0]), [(0, vec![DownCause::NoAnswer])].into());
        let number = position + 1;
        assert_eq!(
            explained(&cell, 0),
            format!(
                "device {number} is missing: check its power and the cable between {between}; the cable has 3 devices"
            )
        );
        assert_eq!(states(&cell), [AlState::Init; 3]);
    }
}

#[test]
fn another_device_at_the_position_is_named_and_left_in_its_state() {
    let mut cell = cell_from(2);
    let refused = events(&mut cell, MS * 2_000);
    assert_eq!(causes(&refused, &[0]), [(0, vec![DownCause::Refused])].into());
    assert!(
        explained(&cell, 0)
            .starts_with("device 3 is another one: expected vendor 0x00000F00, product 0x00000008")
    );
    assert_eq!(states(&cell)[..2], [AlState::Init; 2]);
}

#[test]
fn positions_beyond_the_largest_number_of_devices_are_refused() {
    let made =
        |position| MainDevice::at_positions(&[position], config(&[expected(&DEVICE, BYTES)]), Instant::ZERO);
    assert!(made(1_023).is_ok());
    let refused = made(1_024).unwrap_err();
    assert_eq!(refused.to_string(), "1025 devices on one EtherCAT cable: use at most 1024");
}
