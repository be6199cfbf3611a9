//! What the device counts: everything that it ignores or refuses raises one counter by one.

use machine::Allowed;
use profinet::alarm::{Alarm, FRAME_ID_HIGH, FRAME_ID_LOW, Notification, PduType, Priority, Rta};
use profinet::dcp::Content;
use profinet::rpc::{ENDPOINT_MAPPER_INTERFACE, LOOKUP};

use super::discovery::set;
use super::*;

/// What a frame raises.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Raised {
    Malformed,
    Foreign,
    Late,
}

use Raised::{Foreign, Late, Malformed};

/// Gives the device a frame, and asserts that it raises this counter by one and no other.
fn assert_raised(
    rig: &mut DeviceRig,
    what: &str,
    from: SocketAddrV4,
    (port, frame): (Port, Vec<u8>),
    raised: Raised,
) {
    let count = |rig: &DeviceRig| {
        let counters = rig.device.counters();
        [counters.malformed, counters.foreign, counters.late]
    };
    let before = count(rig);
    rig.receive_from(from, port, &frame);
    let wanted = [Malformed, Foreign, Late].map(|counter| u64::from(counter == raised));
    let after = count(rig);
    assert_eq!([0, 1, 2].map(|index| after[index] - before[index]), wanted, "{what}");
}

type Frame = fn(&mut DeviceRig) -> (Port, Vec<u8>);

fn assert_each(rig: &mut DeviceRig, cases: &[(&str, Raised, Frame)]) {
    for (what, raised, frame) in cases {
        let frame = frame(rig);
        assert_raised(rig, what, CONTROLLER, frame, *raised);
        // A call that was answered is over; the next one has another number.
        rig.sequence += 1;
    }
}

fn rpc(header: Header, body: &[u8]) -> (Port, Vec<u8>) {
    let mut buf = [0; 1500];
    let len = header.emit(body, &mut buf).unwrap();
    (Port::Udp(RPC_PORT), buf[..len].to_vec())
}

fn of_kind(rig: &DeviceRig, kind: Kind) -> (Port, Vec<u8>) {
    rpc(Header { kind, ..rig.header(Operation::Read) }, &[])
}

fn call(rig: &DeviceRig, operation: Operation, emit: impl FnOnce(&mut BlockWriter<'_>)) -> (Port, Vec<u8>) {
    (Port::Udp(RPC_PORT), rig.datagram(operation, &emitted(emit)))
}

fn to_mapper(rig: &DeviceRig, operation: u16, body: &[u8]) -> (Port, Vec<u8>) {
    let header = rig.header(Operation::Unknown(operation));
    rpc(Header { interface: ENDPOINT_MAPPER_INTERFACE, ..header }, body)
}

const RTA: Rta = Rta {
    destination: 0,
    source: 5,
    pdu_type: PduType::Data,
    flags: Rta::WINDOW_1_TACK,
    send_sequence: 0xFFFF,
    ack_sequence: 0xFFFE,
};

fn alarm(frame_id: u16, rta: Rta, variable: impl FnOnce(&mut BlockWriter<'_>)) -> (Port, Vec<u8>) {
    let mut buf = [0; 200];
    let write = |w: &mut BlockWriter<'_>| {
        w.u16(frame_id);
        rta.emit(w, variable);
    };
    let len = ethernet_header().emit(&mut buf, write).unwrap();
    (Port::Ethernet, buf[..len].to_vec())
}

#[test]
fn every_frame_that_is_ignored_or_refused_while_data_go_raises_one_counter() {
    // Longer than a screen, because it is one table of cases.
    let cases: &[(&str, Raised, Frame)] = &[
        ("less than a header of Ethernet", Malformed, |_| (Port::Ethernet, vec![2; 13])),
        ("an Ethernet frame without a whole FrameID", Malformed, |_| {
            let (port, frame) = alarm(FRAME_ID_LOW, RTA, |_| {});
            (port, frame[..15].to_vec())
        }),
        ("a datagram without a whole FrameID", Malformed, |_| (Port::Udp(UDP_PORT), vec![0x80])),
        ("a datagram to a port that is not ours", Foreign, |_| (Port::Udp(1), vec![0; 100])),
        ("an unknown FrameID", Foreign, |_| alarm(0x1234, RTA, |_| {})),
        ("a frame once more", Late, |rig| {
            let (port, frame) = rig.cyclic(&[7; LEN], 0x80, DataStatus::RUNNING);
            rig.receive(port, &frame);
            (port, frame)
        }),
        ("a damaged frame", Malformed, |rig| {
            let (port, mut frame) = rig.cyclic(&[7; LEN], 0x80, DataStatus::RUNNING);
            // TransferStatus is the last byte.
            *frame.last_mut().unwrap() = 1;
            (port, frame)
        }),
        ("an alarm of high priority out of turn", Late, |_| {
            alarm(FRAME_ID_HIGH, Rta { send_sequence: 9, ..RTA }, |_| {})
        }),
        ("an alarm of low priority out of turn", Late, |_| {
            alarm(FRAME_ID_LOW, Rta { send_sequence: 9, ..RTA }, |_| {})
        }),
        ("an alarm without a block", Malformed, |_| alarm(FRAME_ID_LOW, RTA, |_| {})),
        ("an alarm of another connection", Foreign, |_| {
            alarm(FRAME_ID_LOW, Rta { source: 6, ..RTA }, |_| {})
        }),
        ("a name by DCP", Foreign, |_| (Port::Ethernet, set([Content::NameOfStation(b"other")]))),
        ("less than a header of RPC", Malformed, |_| (Port::Udp(RPC_PORT), vec![4; 79])),
        ("a fragment whose first is missing", Malformed, |rig| {
            let header = rig.header(Operation::Read);
            rpc(Header { flags: flags::FRAGMENT, fragment: 2, ..header }, &[0; 20])
        }),
        ("an answer in fragments", Malformed, |rig| {
            let header = rig.header(Operation::Control);
            rpc(Header { kind: Kind::Response, flags: flags::FRAGMENT, ..header }, &[0; 20])
        }),
        ("an answer to no call", Foreign, |rig| of_kind(rig, Kind::Response)),
        ("a Cancel", Foreign, |rig| of_kind(rig, Kind::Cancel)),
        ("a CancelAck", Foreign, |rig| of_kind(rig, Kind::CancelAck)),
        ("a PDU of an unknown kind", Foreign, |rig| of_kind(rig, Kind::Unknown(99))),
        ("a cut Lookup", Malformed, |rig| to_mapper(rig, LOOKUP, &[0; 20])),
        ("another call of the endpoint mapper", Foreign, |rig| to_mapper(rig, 9, &[0; 76])),
        ("an unknown operation", Foreign, |rig| call(rig, Operation::Unknown(9), |_| {})),
        ("an unknown interface", Foreign, |rig| {
            rpc(Header { interface: AR, ..rig.header(Operation::Read) }, &[0; 20])
        }),
        ("a call with lengths that contradict each other", Malformed, |rig| {
            rpc(rig.header(Operation::Read), &[1; 20])
        }),
        ("a Control without a block", Malformed, |rig| call(rig, Operation::Control, |_| {})),
        ("a Control of another AR", Foreign, |rig| {
            let other = Control { ar: Uuid([1; 16]), ..control(Command::PrmEnd) };
            call(rig, Operation::Control, |w| other.emit_request(w))
        }),
        ("a Control out of turn", Foreign, |rig| {
            call(rig, Operation::Control, |w| control(Command::PrmEnd).emit_request(w))
        }),
        ("a Connect of another station", Foreign, |rig| {
            let mut request = connect_request(RtClass::Class1, true);
            (request.ar.initiator_mac, request.ar.session) = (Mac([2, 0, 0, 0, 0, 9]), 2);
            call(rig, Operation::Connect, |w| request.emit(w))
        }),
        ("the Connect of the present AR, delayed", Foreign, |rig| {
            let header = Header { sequence: 0, ..rig.header(Operation::Connect) };
            let datagram = rig
                .datagram(Operation::Connect, &emitted(|w| connect_request(RtClass::Class1, true).emit(w)));
            rpc(header, Header::parse(&datagram).unwrap().1)
        }),
        ("an old call of the controller", Foreign, |rig| {
            let datagram = rig.datagram(Operation::Read, &[]);
            rpc(Header { sequence: 0, ..rig.header(Operation::Read) }, Header::parse(&datagram).unwrap().1)
        }),
    ];
    let mut rig = DeviceRig::connected(RtClass::Class1);
    assert_each(&mut rig, cases);
    assert!(rig.device.has_controller() && rig.device.output(1, 1).is_some(), "none ends the connection");
}

/// Returns an answer to ApplicationReady, changed so.
fn answer(ready: &[u8], header: impl FnOnce(&mut Header), body: &[u8]) -> (Port, Vec<u8>) {
    let (call, _) = Header::parse(ready).unwrap();
    let mut answer = call.answer(Kind::Response);
    header(&mut answer);
    rpc(answer, body)
}

fn response(blocks: impl FnOnce(&mut BlockWriter<'_>)) -> Vec<u8> {
    let mut body = [0; 200];
    let len = ResponseArgs::emit(Status::OK, 100, &mut body, blocks).unwrap();
    body[..len].to_vec()
}

#[test]
fn what_does_not_confirm_application_ready_is_counted_and_the_device_goes_on_waiting() {
    let mut rig = DeviceRig { rt_class: RtClass::Udp, ..DeviceRig::new() };
    rig.connect(&connect_request(RtClass::Udp, true));
    let (_, sent) = rig.prm_end();
    let ready = &sent[0].1;
    let good = control(Command::ApplicationReady);
    let confirmed = |control: Control| response(|w| control.emit_response(w));
    let cases = [
        ("another activity", Foreign, answer(ready, |h| h.activity = AR, &confirmed(good))),
        ("another call", Foreign, answer(ready, |h| h.sequence += 1, &confirmed(good))),
        ("cut", Malformed, answer(ready, |_| {}, &confirmed(good)[..30])),
        ("without a block", Malformed, answer(ready, |_| {}, &response(|_| {}))),
        ("another session", Foreign, answer(ready, |_| {}, &confirmed(Control { session: 9, ..good }))),
        ("another AR", Foreign, answer(ready, |_| {}, &confirmed(Control { ar: Uuid([1; 16]), ..good }))),
        ("another command", Foreign, answer(ready, |_| {}, &confirmed(control(Command::PrmEnd)))),
    ];
    for (what, raised, frame) in cases {
        assert_raised(&mut rig, what, CONTROLLER, frame, raised);
        rig.send_data(&[1; LEN]);
        assert!(rig.device.has_controller() && rig.device.output(1, 1).is_none(), "{what}");
    }
    let stranger = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, 66), RPC_PORT);
    let frame = answer(ready, |_| {}, &confirmed(good));
    assert_raised(&mut rig, "another station", stranger, frame, Foreign);
    rig.confirm(ready);
    rig.send_data(&[2; LEN]);
    assert_eq!(rig.device.output(1, 1), Some(&[2; LEN][..]));
    rig.device.disconnect(rig.now);
    let frame = answer(ready, |_| {}, &confirmed(good));
    assert_raised(&mut rig, "without an AR", CONTROLLER, frame, Foreign);
}

#[test]
fn an_alarm_of_either_priority_is_acknowledged_and_counts_nothing() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    for (frame_id, priority) in [(FRAME_ID_HIGH, Priority::High), (FRAME_ID_LOW, Priority::Low)] {
        let notification = Alarm::Notification(Notification { priority, ..samples::DIAGNOSIS });
        let (port, frame) = alarm(frame_id, RTA, |w| notification.emit(w));
        let sent = rig.receive(port, &frame);
        let pdus: Vec<_> = sent
            .iter()
            .map(|(_, frame)| {
                let (_, payload) = EthernetHeader::parse(frame).unwrap();
                (u16::from_be_bytes([payload[0], payload[1]]), Rta::parse(&payload[2..]).unwrap().0.pdu_type)
            })
            .collect();
        assert_eq!(pdus, [(frame_id, PduType::Ack), (frame_id, PduType::Data)], "{priority:?}");
    }
    let counters = rig.device.counters();
    assert_eq!((counters.malformed, counters.foreign, counters.late), (0, 0, 0));
}

#[test]
fn cycles_for_which_the_device_was_called_too_late_are_counted_once_also_after_the_connection() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    rig.advance(Duration::from_millis(2));
    let before = rig.device.counters();
    rig.now += Duration::from_millis(4);
    rig.device.handle_timeout(rig.now);
    rig.drain();
    let expected = (before.sent + 1, before.skipped + 3);
    assert_eq!((rig.device.counters().sent, rig.device.counters().skipped), expected);
    rig.device.disconnect(rig.now);
    assert_eq!((rig.device.counters().sent, rig.device.counters().skipped), expected);
}

#[test]
fn events_that_the_owner_does_not_take_do_not_pile_up() {
    let mut rig = DeviceRig::new();
    for session in 1..=20 {
        let mut request = connect_request(RtClass::Class1, true);
        request.ar.session = session;
        assert!(rig.connect(&request).0.is_ok());
        rig.device.disconnect(rig.now);
        rig.drain();
    }
    assert_eq!(rig.events().len(), 8);
}

#[test]
fn a_set_of_a_station_that_is_not_listed_is_refused_and_counted_and_one_that_is_listed_may_set() {
    use machine::Peer;
    use profinet::dcp::{BlockError, Code};
    let listed = Peer { address: None, mac: Some(CONTROLLER_MAC), serial_number: None };
    let mut rig = DeviceRig::around(Device::new(
        DeviceConfig { controllers: Allowed(vec![listed]), ..config() },
        Instant::ZERO,
    ));
    let listed = set([Content::NameOfStation(b"other")]);
    let mut not_listed = listed.clone();
    not_listed[11] = 0x66;
    let sent = rig.receive(Port::Ethernet, &not_listed);
    assert_eq!(discovery::results(&sent), [(Code::NAME_OF_STATION, BlockError::NotPossible)]);
    assert_eq!((rig.device.station_name(), rig.device.counters().foreign), (&b"device"[..], 1));
    let sent = rig.receive(Port::Ethernet, &listed);
    assert_eq!(discovery::results(&sent), [(Code::NAME_OF_STATION, BlockError::None)]);
    assert_eq!((rig.device.station_name(), rig.device.counters().foreign), (&b"other"[..], 1));
}
