//! What a segment offers to its owner, beside the frames that pass it.

use ethercat_subdevice::{AlState, DeviceConfig, DeviceId, ETHER_TYPE, Segment};
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, Machine, Port, PortRequest, Source};

use crate::devices::{BRIDGE, SIMPLE, SMART};
use crate::raw_main_device::{APRD, APWR, BRD, FIRST, RawMainDevice, frame};

const ID: DeviceId = DeviceId(0);

fn of(description: &'static ethercat_subdevice::Description) -> Segment {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(description));
    segment
}

#[test]
fn a_segment_asks_for_ethercat_frames_to_any_address() {
    let segment = Segment::new();
    assert_eq!(segment.ports(), [PortRequest::AnyEthernet { ether_type: ETHER_TYPE }]);
}

#[test]
fn a_segment_is_empty_until_a_device_is_added_and_takes_none_behind_one_that_is_not_there() {
    let mut segment = Segment::new();
    assert!(segment.is_empty());
    assert_eq!(segment.add_at(&DeviceConfig::new(&SIMPLE), ID, 1), None);
    assert_eq!(segment.add(&DeviceConfig::new(&SIMPLE)), ID);
    assert!(!segment.is_empty());
    assert_eq!(segment.add_at(&DeviceConfig::new(&SIMPLE), DeviceId(1), 1), None);
    assert_eq!(segment.len(), 1);
}

#[test]
fn frames_beyond_256_under_way_are_lost_and_counted() {
    let mut segment = of(&SIMPLE);
    let from = Source { port: Port::Ethernet, peer: None };
    for _ in 0..300 {
        segment.handle_frame(Instant::ZERO, from, &frame(BRD, 0, &[0]));
    }
    let counters = segment.counters();
    assert_eq!((counters.passed, counters.lost, counters.foreign), (256, 44, 0));
    let mut buf = [0; 2048];
    let back = core::iter::from_fn(|| segment.poll_transmit(Instant::ZERO, &mut buf)).count();
    assert_eq!(back, 256);
}

#[test]
fn a_frame_as_long_as_the_room_for_one_passes_and_a_longer_one_is_foreign() {
    for (len, passed) in [(FRAME_CAPACITY, 1), (FRAME_CAPACITY + 1, 0)] {
        let mut main_device = RawMainDevice::new(of(&SIMPLE));
        let mut frame = frame(BRD, 0, &[0]);
        frame.resize(len, 0);
        assert_eq!(main_device.send(&frame).map(|reply| reply.len()), (passed == 1).then_some(len));
        let counters = main_device.segment.counters();
        assert_eq!((counters.passed, counters.foreign), (passed, 1 - passed));
    }
}

#[test]
fn the_owner_sets_any_object_but_only_to_values_of_its_length() {
    let mut segment = of(&BRIDGE);
    assert_eq!(segment.set_object(ID, 0x8000, 2, &[5]), Some(()), "although SDOs write it in PRE-OP alone");
    assert_eq!(segment.object(ID, 0x8000, 2), Some(&[5][..]));
    // A number has all of its bytes, a text up to its capacity of 400.
    for wrong in [&[][..], &[1, 2]] {
        assert_eq!(segment.set_object(ID, 0x8000, 2, wrong), None, "{wrong:?}");
    }
    assert_eq!(segment.set_object(ID, 0x8000, 1, &[1]), None, "one byte for two");
    assert_eq!(segment.object(ID, 0x8000, 1), Some(&[7, 0][..]));
    for len in [0, 1, 399, 400] {
        let text = vec![b'x'; len];
        assert_eq!(segment.set_object(ID, 0x8001, 0, &text), Some(()), "{len}");
        assert_eq!(segment.object(ID, 0x8001, 0), Some(&text[..]), "{len}");
    }
    assert_eq!(segment.set_object(ID, 0x8001, 0, &[b'y'; 401]), None);
    assert_eq!(segment.set_object(ID, 0x8001, 0, &[b'y'; 500]), None);
    assert_eq!(segment.set_object(ID, 0x9000, 0, &[1]), None, "no such object");
    assert_eq!(segment.set_object(DeviceId(1), 0x8000, 2, &[5]), None, "no such device");
    assert_eq!(segment.object(ID, 0x8001, 0), Some(&[b'x'; 400][..]));
}

#[test]
fn the_owner_sees_the_system_time_that_the_main_device_reads() {
    let mut segment = Segment::new();
    let clock = ethercat_subdevice::LocalClock { start_ns: 5_000, error_ppb: 0 };
    let with_clock = segment.add(&DeviceConfig { clock, ..DeviceConfig::new(&SMART) });
    let without = segment.add(&DeviceConfig::new(&SIMPLE));
    let mut main_device = RawMainDevice::new(segment);
    main_device.wait(Duration::from_micros(300));
    let (read, counter) = main_device.exchange(APRD, 0, 0x0910, &[0; 8]);
    let now = main_device.now;
    let seen = main_device.segment.system_time(with_clock, now);
    assert_eq!((seen, counter), (Some(u64::from_le_bytes(read.try_into().unwrap())), 1));
    assert_eq!(seen, Some(305_000));
    assert_eq!(main_device.segment.system_time(without, now), None);
}

#[test]
fn an_answer_delay_that_the_owner_changes_counts_from_the_next_request_on() {
    let mut main_device = RawMainDevice::new(of(&SIMPLE));
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device.segment.set_answer_delay(ID, Duration::from_millis(3));
    main_device.request_state(2);
    assert_eq!(main_device.segment.state(ID).unwrap().0, AlState::Init);
    main_device.wait(Duration::from_millis(3));
    assert_eq!(main_device.segment.state(ID).unwrap().0, AlState::PreOp);
    main_device.segment.set_answer_delay(ID, Duration::ZERO);
    main_device.request_state(1);
    assert_eq!(main_device.segment.state(ID).unwrap().0, AlState::Init);
}
