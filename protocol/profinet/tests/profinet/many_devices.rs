//! One controller with 64 devices on one switch.

use machine::{DownCause, LinkEvent};
use profinet::rt::Transport;

use crate::network::{Cell, Stranger};

const DEVICES: usize = 64;

#[test]
fn sixty_four_devices_at_1_ms_have_their_own_data_and_miss_no_frame_in_10_s() {
    for transport in [Transport::Rt1, Transport::Udp] {
        let mut cell = Cell::new(DEVICES, transport);
        let up = cell.run(3_000);
        assert_eq!(up.len(), DEVICES, "{transport:?}");
        assert!(up.iter().all(|(_, event)| *event == LinkEvent::Up));
        assert_eq!(cell.run(100), []);
        let before: Vec<_> = (0..DEVICES).map(|device| cell.counters(device)).collect();
        assert_eq!(cell.run(10_000), []);
        for (device, before) in before.iter().enumerate() {
            let counted = cell.counters(device).since(before);
            assert_eq!((counted.received, counted.sent), (10_000, 10_000), "{transport:?} {device}");
            assert_eq!((counted.lost, counted.late, counted.skipped, counted.foreign), (0, 0, 0, 0));
            assert_eq!(cell.data(device), (Some(device as u8), Some(!device as u8)));
        }
    }
}

#[test]
fn one_lost_device_among_64_is_named_and_does_not_disturb_the_others() {
    let mut cell = Cell::new(DEVICES, Transport::Rt1);
    cell.run(3_000);
    cell.disconnect(17);
    let events = cell.run(1_000);
    let [(down_of, LinkEvent::Down(down)), (up_of, LinkEvent::Up)] = events[..] else { panic!("{events:?}") };
    assert_eq!((down_of, up_of, down.cause), (17, 17, DownCause::ClosedByPeer));
    for device in (0..DEVICES).filter(|device| *device != 17) {
        let counters = cell.counters(device);
        assert_eq!((counters.lost, counters.late), (0, 0), "{device}");
        assert_eq!(cell.data(device), (Some(device as u8), Some(!device as u8)));
    }
}

#[test]
fn frames_of_strangers_are_counted_and_change_nothing() {
    let mut cell = Cell::new(DEVICES, Transport::Rt1);
    cell.run(3_000);
    for stranger in [Stranger::OtherMac, Stranger::OtherFrameId, Stranger::OtherXid, Stranger::Arp] {
        let before = cell.foreign();
        for _ in 0..100 {
            cell.stranger(stranger);
        }
        assert_eq!(cell.run(100), [], "{stranger:?}");
        let counted = if stranger == Stranger::Arp { 0 } else { 100 };
        assert_eq!(cell.foreign() - before, counted, "{stranger:?}");
    }
    assert!((0..DEVICES).all(|device| cell.data(device) == (Some(device as u8), Some(!device as u8))));
}
