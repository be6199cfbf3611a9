use super::*;
use core::net::{Ipv4Addr, SocketAddrV4};
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Duration, Instant, Port};
use proptest::prelude::*;

const SIEMENS: Mac = Mac([0xEC, 0x1C, 0x5D, 0x61, 0xE7, 0x3F]);
const P_NET: Mac = Mac([0x8C, 0xF3, 0x19, 0xCD, 0x19, 0xF8]);
const MS: CycleTime = CycleTime { send_clock_factor: 32, reduction_ratio: 1 };

/// A cyclic frame from a Siemens CPU 1515-2 PN V2.9.4 to a p-net device (test data of crate `pnio` 0.1.0, MIT OR
/// Apache-2.0): outputs 0x01, 0x12345678 and 1.5f with their IOPS and IOCS.
#[rustfmt::skip]
const FROM_SIEMENS: [u8; 64] = [
    0x8C, 0xF3, 0x19, 0xCD, 0x19, 0xF8, 0xEC, 0x1C, 0x5D, 0x61, 0xE7, 0x3F, 0x81, 0x00, 0xC0, 0x00,
    0x88, 0x92, 0x80, 0x01, 0x80, 0x80, 0x80, 0x80, 0x01, 0x80, 0x80, 0x00, 0x80, 0x80, 0x12, 0x34,
    0x56, 0x78, 0x3F, 0xC0, 0x00, 0x00, 0x80, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0xE4, 0x00, 0x35, 0x00,
];

fn frame(cycle_counter: u16, data_status: DataStatus, c_sdu: &[u8]) -> Vec<u8> {
    let mut buf = [0; 64];
    let mut writer = Writer::new(&mut buf);
    CyclicFrame { frame_id: 0x8000, c_sdu, cycle_counter, data_status, transfer_status: 0 }.emit(&mut writer);
    let len = writer.finish().unwrap();
    buf[..len].to_vec()
}

fn receiver() -> CyclicReceiver {
    CyclicReceiver::new(0x8000, MS, 1, MS.multiplied(3), Instant::ZERO)
}

#[test]
fn the_siemens_controllers_frame_is_parsed_and_written_back_unchanged() {
    let (_, payload) = EthernetHeader::parse(&FROM_SIEMENS).unwrap();
    let parsed = CyclicFrame::parse(payload, 40).unwrap();
    assert_eq!((parsed.frame_id, parsed.cycle_counter), (0x8001, 0xE400));
    assert_eq!((parsed.data_status, parsed.transfer_status), (DataStatus::RUNNING, 0));
    assert_eq!(parsed.c_sdu[10..18], [0x12, 0x34, 0x56, 0x78, 0x3F, 0xC0, 0, 0]);

    let first = Instant::from_nanos(0xE400 * 31_250);
    let route = Route::Ethernet { source: SIEMENS, destination: P_NET };
    let mut sender = CyclicSender::new(route, 0x8001, MS, 40, first);
    sender.c_sdu_mut().copy_from_slice(parsed.c_sdu);
    sender.handle_timeout(first);
    let mut buf = [0xFF; 100];
    let transmit = sender.poll_transmit(&mut buf).unwrap();
    assert_eq!((transmit.port, transmit.len), (Port::Ethernet, 64));
    assert_eq!(buf[..64], FROM_SIEMENS);
    assert!(sender.poll_transmit(&mut buf).is_none(), "one frame a cycle");
}

#[test]
fn over_udp_the_same_frame_is_one_datagram_to_port_34962() {
    let to = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, 2), UDP_PORT);
    let mut sender = CyclicSender::new(Route::Udp(to), 0xC000, MS, 12, Instant::ZERO);
    sender.handle_timeout(Instant::ZERO);
    let mut buf = [0xFF; 100];
    let transmit = sender.poll_transmit(&mut buf).unwrap();
    assert_eq!((transmit.port, transmit.to, transmit.len), (Port::Udp(34_962), Some(to), 18));
    assert_eq!(buf[..18], [0xC0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x35, 0]);
}

#[test]
fn a_late_sender_skips_cycles_and_its_counter_follows_the_clock() {
    let mut sender = CyclicSender::new(
        Route::Ethernet { source: SIEMENS, destination: P_NET },
        0x8000,
        MS,
        40,
        Instant::from_millis(1),
    );
    let mut buf = [0; 100];
    let mut counters = Vec::new();
    for now_us in [1_000, 2_010, 6_300, 7_000] {
        sender.handle_timeout(Instant::from_micros(now_us));
        while let Some(transmit) = sender.poll_transmit(&mut buf) {
            let (_, payload) = EthernetHeader::parse(&buf[..transmit.len]).unwrap();
            counters.push(CyclicFrame::parse(payload, 40).unwrap().cycle_counter / 32);
        }
    }
    assert_eq!(counters, [1, 2, 6, 7]);
    assert_eq!((sender.sent(), sender.skipped()), (4, 3));
    assert_eq!(sender.poll_timeout(), Instant::from_millis(8));
}

#[test]
fn late_and_duplicate_frames_are_dropped_and_missing_ones_counted() {
    let mut receiver = receiver();
    let mut take = |counter: u16, value: u8| {
        receiver.handle_frame(Instant::ZERO, &frame(counter, DataStatus::RUNNING, &[value]))
    };
    assert_eq!(take(65_504, 1), Received::New);
    assert_eq!(take(0, 2), Received::New, "the counter wraps");
    assert_eq!(take(0, 3), Received::Late);
    assert_eq!(take(128, 4), Received::New);
    assert_eq!(take(96, 5), Received::Late);
    assert_eq!(take(159, 6), Received::New, "a count of jitter is no loss");
    assert_eq!(receiver.usable_data(), Some(&[6][..]));
    assert_eq!((receiver.received(), receiver.late(), receiver.lost()), (4, 2, 3));
}

#[test]
fn after_one_frame_with_a_wrong_counter_no_connection_ends_and_few_frames_are_missing() {
    let watchdog = MS.multiplied(3);
    for wrong in [33, 4_000, 10_000, 40_000, 61_440, 61_441, 65_000] {
        let mut receiver = CyclicReceiver::new(0x8000, MS, 1, watchdog, Instant::ZERO);
        for cycle in 1..100_u16 {
            let now = Instant::from_millis(cycle.into());
            assert!(!receiver.is_expired(now), "{wrong} ahead, in cycle {cycle}");
            receiver.handle_frame(now, &frame(cycle * 32, DataStatus::RUNNING, &[1]));
            if cycle == 50 {
                receiver
                    .handle_frame(now, &frame((cycle * 32).wrapping_add(wrong), DataStatus::RUNNING, &[2]));
            }
        }
        assert!(receiver.lost() <= 4_096 / 32, "{wrong} ahead: {}", receiver.lost());
        assert!(receiver.late() <= 3, "{wrong} ahead: {}", receiver.late());
        assert_eq!(receiver.usable_data(), Some(&[1][..]));
    }
}

#[test]
fn the_watchdog_time_starts_with_the_last_accepted_frame() {
    let mut receiver = receiver();
    assert!(!receiver.is_expired(Instant::from_micros(2_999)));
    assert!(receiver.is_expired(Instant::from_millis(3)));
    receiver.handle_frame(Instant::from_millis(2), &frame(64, DataStatus::RUNNING, &[1]));
    receiver.handle_frame(Instant::from_millis(4), &frame(64, DataStatus::RUNNING, &[1]));
    assert_eq!(receiver.poll_timeout(), Instant::from_millis(5), "a duplicate does not feed it");
}

#[test]
fn data_is_usable_only_if_valid_and_from_a_running_provider() {
    let mut receiver = receiver();
    assert_eq!(receiver.usable_data(), None);
    receiver.handle_frame(Instant::ZERO, &frame(32, DataStatus::STOPPED, &[1]));
    assert_eq!((receiver.usable_data(), receiver.c_sdu()), (None, Some(&[1][..])));
    receiver.handle_frame(Instant::ZERO, &frame(64, DataStatus::RUNNING, &[2]));
    assert_eq!(receiver.usable_data(), Some(&[2][..]));
    let ignore = DataStatus(DataStatus::RUNNING.0 | DataStatus::IGNORE);
    assert_eq!(receiver.handle_frame(Instant::ZERO, &frame(96, ignore, &[3])), Received::Ignored);
    assert_eq!(receiver.usable_data(), Some(&[2][..]));
}

#[test]
fn a_cycle_is_expressed_as_send_clock_and_reduction_ratio() {
    let cycle = |micros, transport| {
        CycleTime::new(Duration::from_micros(micros), transport)
            .map(|cycle| (cycle.send_clock_factor, cycle.reduction_ratio))
            .ok()
    };
    assert_eq!(cycle(250, Transport::Rt1), Some((8, 1)));
    assert_eq!(cycle(1_000, Transport::Rt1), Some((32, 1)));
    assert_eq!(cycle(4_000, Transport::Udp), Some((32, 4)));
    assert_eq!(cycle(3_000, Transport::Udp), Some((32, 3)));
    for unfit in [0, 300, 1_500, 3_000, 513_000] {
        assert_eq!(cycle(unfit, Transport::Rt1), None, "{unfit} µs");
    }
    for unfit in [1_921_000, 2_048_000, 4_096_000, 16_384_000] {
        assert_eq!(cycle(unfit, Transport::Udp), None, "{unfit} µs");
    }
}

#[test]
fn at_the_longest_cycle_of_each_transport_every_frame_is_newer_than_the_one_before() {
    for (transport, millis) in [(Transport::Rt1, 512), (Transport::Udp, 1_920)] {
        let time = CycleTime::new(Duration::from_millis(millis), transport).unwrap();
        let mut receiver = CyclicReceiver::new(0xC000, time, 1, time.multiplied(3), Instant::ZERO);
        for number in 1..100 {
            let now = Instant::from_millis(number * millis);
            let frame = frame(cycle_counter(now), DataStatus::RUNNING, &[1]);
            assert_eq!(receiver.handle_frame(now, &frame), Received::New, "{transport:?}");
        }
        assert_eq!(receiver.lost(), 0);
    }
}

#[test]
fn the_first_frame_is_due_within_one_cycle_on_the_grid_of_the_clock() {
    let mac = Mac([0, 0, 0, 0, 0, 4]);
    for (now, first) in [(12_345, 13_125), (13_000, 13_125), (13_124, 13_125), (13_125, 14_125)] {
        assert_eq!(MS.first(Instant::from_micros(now), mac), Instant::from_micros(first), "after {now} µs");
    }
}

#[test]
fn the_grid_of_the_clock_stays_the_same_for_hours() {
    let now = Instant::from_micros(20_000_000_345);
    let first = MS.first(now, Mac([0, 0, 0, 0, 0, 4]));
    assert_eq!(first, Instant::from_micros(20_000_001_125));
}

#[test]
fn the_sender_tells_counter_and_status_of_its_last_frame() {
    let first = Instant::from_millis(2);
    let route = Route::Ethernet { source: SIEMENS, destination: P_NET };
    let mut sender = CyclicSender::new(route, 0x8000, MS, 40, first);
    assert_eq!(sender.last(), (0, DataStatus(0)), "before the first frame");
    let mut buf = [0; 100];
    for (now, status) in [(first, DataStatus::RUNNING), (Instant::from_millis(3), DataStatus::STOPPED)] {
        sender.set_data_status(status);
        sender.handle_timeout(now);
        let transmit = sender.poll_transmit(&mut buf).unwrap();
        let (_, payload) = EthernetHeader::parse(&buf[..transmit.len]).unwrap();
        let frame = CyclicFrame::parse(payload, 40).unwrap();
        assert_eq!(frame.data_status, status);
        assert_eq!(sender.last(), (frame.cycle_counter, status));
    }
}

#[test]
fn a_frame_is_as_long_as_its_data_and_six_bytes() {
    let frame = CyclicFrame {
        frame_id: 0x8000,
        c_sdu: &[1; 40],
        cycle_counter: 0,
        data_status: DataStatus::RUNNING,
        transfer_status: 0,
    };
    let mut buf = [0; 64];
    let mut writer = Writer::new(&mut buf);
    frame.emit(&mut writer);
    assert_eq!(writer.finish(), Ok(46));
}

#[test]
fn a_watchdog_that_is_restarted_expires_as_if_a_frame_had_arrived() {
    let mut receiver = receiver();
    receiver.restart_watchdog(Instant::from_millis(2));
    assert_eq!(receiver.poll_timeout(), Instant::from_millis(5));
    assert_eq!((receiver.received(), receiver.usable_data()), (0, None));
}

proptest! {
    #[test]
    fn no_frame_makes_the_receiver_panic(frames in proptest::collection::vec(
        proptest::collection::vec(any::<u8>(), 0..12), 0..8)) {
        let mut receiver = CyclicReceiver::new(0x8000, MS, 2, MS.multiplied(3), Instant::ZERO);
        for frame in &frames {
            let received = receiver.handle_frame(Instant::ZERO, frame);
            prop_assert_eq!(received == Received::Malformed, frame.len() < 8 || frame[7] != 0);
        }
    }
}
