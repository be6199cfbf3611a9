//! A connection from its Connect to its end.

use super::*;
use machine::Down;
use profinet::alarm::{FRAME_ID_LOW, Rta};
use profinet::record::{Address, ReadRequest, ReadResponse, index};

const EACH_WAY: [RtClass; 3] = [RtClass::Class1, RtClass::Legacy1, RtClass::Udp];

pub(super) fn cyclic_frames(sent: &[(Transmit, Vec<u8>)], rt_class: RtClass) -> Vec<Vec<u8>> {
    let is_udp = rt_class == RtClass::Udp;
    let payload = |(transmit, frame): &(Transmit, Vec<u8>)| match transmit.port {
        Port::Ethernet if !is_udp => Some(EthernetHeader::parse(frame).unwrap().1.to_vec()),
        Port::Udp(UDP_PORT) if is_udp => Some(frame.clone()),
        _ => None,
    };
    sent.iter().filter_map(payload).filter(|payload| matches!(payload[0], 0x80..0xF8)).collect()
}

#[test]
fn both_styles_of_connect_get_data_both_ways_over_each_class() {
    for rt_class in EACH_WAY {
        for with_access_point in [true, false] {
            let mut rig = DeviceRig::new();
            rig.device.set_input(1, 1, &[0x33; LEN]).unwrap();
            rig.establish(&connect_request(rt_class, with_access_point));
            assert_eq!(rig.device.output(1, 1), Some(&[0x5A; LEN][..]));
            let frames = cyclic_frames(&rig.advance(Duration::from_micros(4_500)), rt_class);
            assert!((4..=5).contains(&frames.len()), "{rt_class:?}: {}", frames.len());
            let frame = CyclicFrame::parse(&frames[0], 261).unwrap();
            assert_eq!(frame.frame_id & 0x8FFF, 0x8001);
            assert_eq!(frame.data_status, DataStatus::RUNNING);
            let mut c_sdu = [0x33; 261];
            c_sdu[256..].copy_from_slice(if with_access_point { &[0x80; 5] } else { &[0x80, 0, 0, 0, 0] });
            assert_eq!(frame.c_sdu, c_sdu);
        }
    }
}

#[test]
fn statuses_are_bad_until_the_parameters_are_there() {
    let mut rig = DeviceRig::new();
    rig.connect(&connect_request(RtClass::Class1, true));
    let frames = cyclic_frames(&rig.advance(Duration::from_millis(2)), RtClass::Class1);
    assert_eq!(CyclicFrame::parse(&frames[0], 261).unwrap().c_sdu[256..], [0x40; 5]);
    rig.prm_end();
    let frames = cyclic_frames(&rig.advance(Duration::from_millis(2)), RtClass::Class1);
    assert_eq!(CyclicFrame::parse(&frames[0], 261).unwrap().c_sdu[256..], [0x80; 5]);
}

#[test]
fn the_output_holds_only_while_the_controller_calls_it_good() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let data = [7; LEN];
    for (iops, data_status, good) in [
        (0x80, DataStatus::RUNNING, true),
        (0x60, DataStatus::RUNNING, false),
        (0x80, DataStatus::STOPPED, false),
        (0x80, DataStatus(0x31), false),
        (0x80, DataStatus::RUNNING, true),
    ] {
        let (port, frame) = rig.cyclic(&data, iops, data_status);
        rig.receive(port, &frame);
        assert_eq!(rig.device.output(1, 1).is_some(), good, "{iops:02X} {data_status:?}");
    }
    assert_eq!(rig.events(), [], "the connection stays up all the while");
}

#[test]
fn a_frame_of_another_station_or_frame_id_or_by_another_way_is_foreign() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let (port, frame) = rig.cyclic(&[7; LEN], 0x80, DataStatus::RUNNING);
    let mut other_station = frame.clone();
    other_station[11] ^= 1;
    rig.receive(port, &other_station);
    let mut other_receiver = frame.clone();
    other_receiver[5] ^= 1;
    rig.receive(port, &other_receiver);
    let mut other_id = frame.clone();
    other_id[15] ^= 0x40;
    rig.receive(port, &other_id);
    rig.receive(Port::Udp(UDP_PORT), &frame[14..]);
    assert_eq!(rig.device.output(1, 1), Some(&[0x5A; LEN][..]));
    assert_eq!(rig.device.counters().foreign, 4);
    let mut tagged = frame[..12].to_vec();
    tagged.extend([0x81, 0, 0xC0, 0]);
    tagged.extend(&frame[12..]);
    rig.receive(port, &tagged);
    assert_eq!(rig.device.output(1, 1), Some(&[7; LEN][..]), "a priority tag does not matter");
}

#[test]
fn without_a_frame_within_the_data_hold_time_the_device_aborts() {
    for rt_class in EACH_WAY {
        let mut rig = DeviceRig::connected(rt_class);
        assert!(rig.advance(Duration::from_micros(9_999)).len() >= 9);
        assert!(rig.device.output(1, 1).is_some());
        let sent = rig.advance(Duration::from_millis(1));
        let status = Violation::ConsumerExpired.status(Service::Abort);
        let down = Down { cause: DownCause::Watchdog, code: 0xCF81_FD05, text: status.text() };
        assert_eq!(rig.events(), [LinkEvent::Down(down)]);
        assert_eq!(rig.device.output(1, 1), None);
        let (_, frame) = sent.last().unwrap();
        // Destination, source, tag, EtherType, FrameID, then the alarm endpoints of controller and device.
        assert_eq!(frame[16..20], [0x88, 0x92, 0xFE, 0x01]);
        let (rta, variable) = Rta::parse(&frame[20..]).unwrap();
        assert_eq!((rta.destination, rta.source), (5, 0));
        assert_eq!(variable, [0xCF, 0x81, 0xFD, 0x05]);
        assert!(rig.advance(Duration::from_secs(1)).is_empty(), "and is silent from then on");
    }
}

#[test]
fn a_controller_that_stops_half_way_is_given_up_after_its_activity_timeout() {
    let mut rig = DeviceRig::new();
    rig.connect(&connect_request(RtClass::Udp, true));
    rig.advance(Duration::from_millis(1_900));
    assert_eq!(rig.events(), []);
    rig.advance(Duration::from_millis(100));
    let [LinkEvent::Down(down)] = rig.events()[..] else { panic!("the device gives up") };
    assert_eq!((down.cause, down.code), (DownCause::Watchdog, 0xCF81_FD06));
}

#[test]
fn application_ready_is_repeated_until_it_is_confirmed_or_too_late() {
    let mut rig = DeviceRig::new();
    rig.connect(&connect_request(RtClass::Udp, true));
    let (_, first) = rig.prm_end();
    let (_, first) = &first[0];
    let is_call = |(transmit, _): &&(Transmit, Vec<u8>)| transmit.port == Port::Udp(RPC_PORT);
    let repeated: Vec<_> =
        rig.advance(Duration::from_millis(1_900)).iter().filter(is_call).cloned().collect();
    assert_eq!(repeated.len(), 3, "after 200, 600 and 1400 ms");
    for (_, call) in &repeated {
        let (ours, _) = Header::parse(first).unwrap();
        let (again, _) = Header::parse(call).unwrap();
        assert!(ours.is_same_call(&again));
    }
    rig.advance(Duration::from_millis(100));
    let [LinkEvent::Down(down)] = rig.events()[..] else { panic!("the device gives up") };
    assert_eq!((down.cause, down.code), (DownCause::NoAnswer, 0xCF81_FD28));
    let foreign = rig.device.counters().foreign;
    rig.confirm(first);
    assert_eq!(rig.device.counters().foreign, foreign + 1, "a confirmation out of time is foreign");
}

#[test]
fn a_refused_application_ready_ends_the_connection() {
    let mut rig = DeviceRig::new();
    rig.connect(&connect_request(RtClass::Udp, true));
    let (_, sent) = rig.prm_end();
    let (header, _) = Header::parse(&sent[0].1).unwrap();
    let mut body = [0; 20];
    let status = Violation::StateConflict.status(Service::Control);
    let len = ResponseArgs::emit(status, 100, &mut body, |_| {}).unwrap();
    let mut buf = [0; 100];
    let len = header.answer(Kind::Response).emit(&body[..len], &mut buf).unwrap();
    rig.receive(Port::Udp(RPC_PORT), &buf[..len]);
    let [LinkEvent::Down(down)] = rig.events()[..] else { panic!("the device gives up") };
    assert_eq!((down.cause, down.code), (DownCause::Refused, 0xCF81_FD0C));
}

#[test]
fn a_release_is_answered_and_the_ar_is_gone() {
    let mut rig = DeviceRig::connected(RtClass::Udp);
    let (status, _) = rig.control(Operation::Release, control(Command::Release));
    assert_eq!(status, Status::OK);
    let [LinkEvent::Down(down)] = rig.events()[..] else { panic!("the connection is over") };
    assert_eq!((down.cause, down.code), (DownCause::ClosedByPeer, 0));
    let (status, _) = rig.control(Operation::Release, control(Command::Release));
    assert_eq!(status, Violation::ArUuidUnknown.status(Service::Release));
    let mut request = connect_request(RtClass::Udp, true);
    request.ar.session = 2;
    assert!(rig.connect(&request).0.is_ok(), "and it can be had again");
}

#[test]
fn an_error_pdu_from_the_controller_ends_the_connection_without_one_from_us() {
    for rt_class in [RtClass::Class1, RtClass::Udp] {
        let mut rig = DeviceRig { rt_class, ..DeviceRig::new() };
        let mut request = connect_request(rt_class, true);
        if rt_class == RtClass::Udp {
            let alarm_cr = request.alarm_cr.as_mut().unwrap();
            (alarm_cr.lt, alarm_cr.properties) = (LT_UDP, AlarmCr::OVER_UDP);
        }
        rig.establish(&request);
        let rta = Rta {
            destination: 0,
            source: 5,
            pdu_type: profinet::alarm::PduType::Error,
            flags: 1,
            send_sequence: 0xFFFE,
            ack_sequence: 0xFFFE,
        };
        let status = Violation::ArRemoved.status(Service::Abort);
        let mut buf = [0; 100];
        let write = |w: &mut BlockWriter<'_>| {
            w.u16(FRAME_ID_LOW);
            rta.emit_error(status, w);
        };
        let sent = if rt_class == RtClass::Udp {
            let mut writer = BlockWriter::new(&mut buf);
            write(&mut writer);
            let len = writer.finish().unwrap();
            rig.receive(Port::Udp(UDP_PORT), &buf[..len])
        } else {
            let len = ethernet_header().emit(&mut buf, write).unwrap();
            rig.receive(Port::Ethernet, &buf[..len])
        };
        assert!(sent.is_empty());
        let down = Down { cause: DownCause::ClosedByPeer, code: 0xCF81_FD11, text: "the AR was removed" };
        assert_eq!(rig.events(), [LinkEvent::Down(down)]);
    }
}

#[test]
fn a_repeated_request_gets_the_same_answer_and_is_not_carried_out_twice() {
    let mut rig = DeviceRig::new();
    let connect =
        rig.datagram(Operation::Connect, &emitted(|w| connect_request(RtClass::Class1, true).emit(w)));
    let first = rig.receive(Port::Udp(RPC_PORT), &connect);
    let again = rig.receive(Port::Udp(RPC_PORT), &connect);
    // The serial number tells repetitions apart; it is bytes 7 and 79 of the header.
    assert_eq!(first[0].1[80..], again[0].1[80..]);

    rig.sequence = 1;
    let prm_end = rig.datagram(Operation::Control, &emitted(|w| control(Command::PrmEnd).emit_request(w)));
    assert_eq!(rig.receive(Port::Udp(RPC_PORT), &prm_end).len(), 2);
    assert_eq!(rig.receive(Port::Udp(RPC_PORT), &prm_end).len(), 1, "no second ApplicationReady");
    assert!(rig.receive(Port::Udp(RPC_PORT), &connect).is_empty(), "a Connect from before is too late");
    assert_eq!(rig.events(), []);
}

#[test]
fn a_ping_gets_the_answer_again_or_hears_that_there_is_none() {
    let mut rig = DeviceRig::new();
    let ping = |rig: &DeviceRig| {
        let header = Header { kind: Kind::Ping, ..rig.header(Operation::Connect) };
        let mut buf = [0; 100];
        let len = header.emit(&[], &mut buf).unwrap();
        buf[..len].to_vec()
    };
    let kind = |sent: &[(Transmit, Vec<u8>)]| Header::parse(&sent[0].1).unwrap().0.kind;
    let datagram = ping(&rig);
    assert_eq!(kind(&rig.receive(Port::Udp(RPC_PORT), &datagram)), Kind::NoCall);
    rig.connect(&connect_request(RtClass::Class1, true));
    rig.sequence = 0;
    let datagram = ping(&rig);
    assert_eq!(kind(&rig.receive(Port::Udp(RPC_PORT), &datagram)), Kind::Response);
}

#[test]
fn the_same_controller_that_starts_anew_takes_its_old_place_and_another_one_waits() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let mut request = connect_request(RtClass::Class1, true);
    request.ar.initiator_mac = Mac([2, 0, 0, 0, 0, 9]);
    request.ar.uuid = Uuid([1; 16]);
    let (status, _) = rig.connect(&request);
    assert_eq!(status, Violation::OutOfArResources.status(Service::Connect));
    assert!(matches!(rig.events()[..], [LinkEvent::Foreign(_)]));
    request.ar.initiator_mac = CONTROLLER_MAC;
    assert!(rig.connect(&request).0.is_ok());
    let [LinkEvent::Down(down)] = rig.events()[..] else { panic!("the old connection is over") };
    assert_eq!((down.cause, down.code), (DownCause::ClosedByPeer, 0xCF81_FD0E));
}

#[test]
fn a_long_request_is_taken_in_fragments_each_is_acknowledged_and_the_last_one_answered_as_often_as_it_comes()
{
    let mut rig = DeviceRig::new();
    let connect =
        rig.datagram(Operation::Connect, &emitted(|w| connect_request(RtClass::Class1, true).emit(w)));
    let (header, body) = Header::parse(&connect).unwrap();
    let mut kinds = Vec::new();
    let chunks = body.chunks(100).collect::<Vec<_>>();
    // The answer is lost: only the last fragment is not acknowledged, so it alone is repeated.
    let repeated = chunks.len() - 1;
    for (index, chunk) in chunks.iter().enumerate().chain([(repeated, &chunks[repeated])]) {
        let last = if index + 1 == chunks.len() { flags::LAST_FRAGMENT } else { 0 };
        let header = Header { fragment: index as u16, flags: flags::FRAGMENT | last, ..header };
        let mut buf = [0; 300];
        let len = header.emit(chunk, &mut buf).unwrap();
        let sent = rig.receive(Port::Udp(RPC_PORT), &buf[..len]);
        kinds.push(Header::parse(&sent[0].1).unwrap().0.kind);
    }
    let (parts, last) = kinds.split_at(repeated);
    assert!(parts.len() > 2 && parts.iter().all(|kind| *kind == Kind::FragmentAck));
    assert_eq!(last, [Kind::Response; 2]);
    assert!(rig.device.has_controller());
    assert_eq!((rig.events(), rig.device.counters().malformed), (vec![], 0));
}

#[test]
fn a_controller_that_only_reads_while_it_prepares_keeps_its_connection() {
    let mut rig = DeviceRig::new();
    let (status, _) = rig.connect(&connect_request(RtClass::Class1, true));
    assert_eq!(status, Status::OK);
    // The activity timeout of this Connect is 2 s.
    for index in [index::CONNECTION_MONITORING_TRIGGER, index::REAL_IDENTIFICATION_API, 0xFBFF] {
        rig.advance(Duration::from_millis(1_500));
        let address = Address { sequence: 0, ar: AR, api: 0, slot: 0, subslot: 0, index };
        let read = ReadRequest { address, most: 4_000, target_ar: Uuid::NIL };
        let (status, blocks, _) = rig.call(Operation::Read, &emitted(|w| read.emit(w)));
        assert_eq!(status, Status::OK, "index 0x{index:04X}");
        let record = ReadResponse::parse(&mut BlockReader::new(&blocks)).unwrap().record;
        assert_eq!(record.is_empty(), index == 0xFBFF);
    }
    assert_eq!(rig.prm_end().0, Status::OK);
    assert_eq!(rig.events(), []);
    rig.advance(Duration::from_millis(2_100));
    assert!(!rig.device.has_controller(), "without a call the time passes as before");
}
