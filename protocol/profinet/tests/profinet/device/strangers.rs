//! Frames from other stations than the controller's: none ends or changes the connection, whatever they know of it.

use super::*;
use machine::{Allowed, Peer, Requested, Sender};
use profinet::record::{Address, ReadRequest, WriteRequest, index};

const STRANGER: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, 66), 49_152);

/// Asserts that the connection is unchanged, and that the owner was told of foreign requests at most.
fn nothing_changed(rig: &mut DeviceRig) {
    let events = rig.events();
    assert!(events.iter().all(|event| matches!(event, LinkEvent::Foreign(_))), "{events:?}");
    assert_eq!(rig.device.output(1, 1), Some(&[0x5A; LEN][..]));
}

#[test]
fn a_connect_with_the_controllers_mac_from_another_address_does_not_take_the_connection_over() {
    for rt_class in [RtClass::Class1, RtClass::Udp] {
        let mut rig = DeviceRig::connected(rt_class);
        for (uuid, session) in [(AR, 1), (AR, 2), (Uuid([1; 16]), 1)] {
            let mut request = connect_request(rt_class, true);
            (request.ar.uuid, request.ar.session) = (uuid, session);
            let blocks = emitted(|w| request.emit(w));
            let (status, ..) = rig.call_from(STRANGER, Operation::Connect, &blocks);
            assert_eq!(status, Violation::OutOfArResources.status(Service::Connect));
        }
        nothing_changed(&mut rig);
    }
}

#[test]
fn release_control_write_and_read_with_the_right_uuids_from_another_address_find_no_connection() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let controls = [
        (Operation::Release, Command::Release),
        (Operation::Control, Command::PrmBegin),
        (Operation::Control, Command::PrmEnd),
    ];
    for (operation, command) in controls {
        let blocks = emitted(|w| control(command).emit_request(w));
        let (status, ..) = rig.call_from(STRANGER, operation, &blocks);
        let service = if operation == Operation::Release { Service::Release } else { Service::Control };
        assert_eq!(status, Violation::ArUuidUnknown.status(service), "{command:?}");
    }
    let address = Address {
        sequence: 0,
        ar: AR,
        api: 0,
        slot: 1,
        subslot: 1,
        index: index::IDENTIFICATION_AND_MAINTENANCE_0,
    };
    let write = emitted(|w| WriteRequest { address, record: &[1] }.emit(w));
    let (status, ..) = rig.call_from(STRANGER, Operation::Write, &write);
    assert_eq!(status, Violation::ArUuidUnknown.status(Service::Write));
    let read = emitted(|w| ReadRequest { address, most: 4_000, target_ar: Uuid::NIL }.emit(w));
    let (status, ..) = rig.call_from(STRANGER, Operation::Read, &read);
    assert_eq!(status, Violation::ArUuidUnknown.status(Service::Read));
    let (status, ..) = rig.call_from(STRANGER, Operation::ReadImplicit, &read);
    assert_eq!(status, Status::OK, "what anybody may know anybody may read");
    assert_eq!(
        rig.events(),
        [LinkEvent::Foreign(machine::ForeignRequest {
            from: Sender::Ip(*STRANGER.ip()),
            what: Requested::End,
            owner: Some(Sender::Ip(*CONTROLLER.ip())),
            more: 0
        })]
    );
    nothing_changed(&mut rig);
}

#[test]
fn a_write_from_another_address_does_not_prolong_the_controllers_time() {
    let mut rig = DeviceRig::new();
    rig.connect(&connect_request(RtClass::Udp, true));
    rig.advance(Duration::from_millis(1_900));
    let address = Address { sequence: 0, ar: AR, api: 0, slot: 0, subslot: 0x8000, index: 0x8071 };
    rig.call_from(STRANGER, Operation::Write, &emitted(|w| WriteRequest { address, record: &[] }.emit(w)));
    rig.advance(Duration::from_millis(100));
    assert!(!rig.device.has_controller());
}

#[test]
fn application_ready_is_confirmed_and_refused_by_the_controller_alone() {
    for status in [Status::OK, Violation::StateConflict.status(Service::Control)] {
        let mut rig = DeviceRig::new();
        rig.connect(&connect_request(RtClass::Udp, true));
        let (_, sent) = rig.prm_end();
        let (header, body) = Header::parse(&sent[0].1).unwrap();
        let blocks = RequestArgs::parse(&header, body).unwrap().blocks;
        let ready = Control::parse_request(blocks).unwrap();
        let mut body = [0; 200];
        let len = ResponseArgs::emit(status, 100, &mut body, |w| ready.emit_response(w)).unwrap();
        let mut buf = [0; 400];
        let len = header.answer(Kind::Response).emit(&body[..len], &mut buf).unwrap();
        rig.receive_from(STRANGER, Port::Udp(RPC_PORT), &buf[..len]);
        rig.rt_class = RtClass::Udp;
        rig.send_data(&[1; LEN]);
        assert!(rig.device.has_controller() && rig.device.output(1, 1).is_none());
        rig.confirm(&sent[0].1);
        rig.send_data(&[2; LEN]);
        assert_eq!(rig.device.output(1, 1), Some(&[2; LEN][..]));
    }
}

#[test]
fn requests_of_others_displace_neither_the_controllers_last_answer_nor_its_unfinished_request() {
    let mut rig = DeviceRig::new();
    let own = rig.activity;
    let connect =
        rig.datagram(Operation::Connect, &emitted(|w| connect_request(RtClass::Class1, true).emit(w)));
    let first = rig.receive(Port::Udp(RPC_PORT), &connect);
    let read = |activity: Uuid, sequence: u32| {
        let header = Header::request(
            Operation::ReadImplicit,
            object(1, samples::DEVICE.identity),
            DEVICE_INTERFACE,
            activity,
            sequence,
        );
        let mut buf = [0; 1400];
        let len = header.emit(&[0; 20], &mut buf).unwrap();
        buf[..len].to_vec()
    };
    for number in 0..20 {
        let stranger = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, number), 50_000);
        rig.receive_from(stranger, Port::Udp(RPC_PORT), &read(Uuid([number; 16]), 0));
        rig.receive_from(stranger, Port::Udp(RPC_PORT), &read(own, 1_000_000));
    }
    let again = rig.receive(Port::Udp(RPC_PORT), &connect);
    assert_eq!(first[0].1[80..], again[0].1[80..], "the answer that was lost is sent again");

    rig.sequence = 1;
    let blocks = emitted(|w| control(Command::PrmEnd).emit_request(w));
    let prm_end = rig.datagram(Operation::Control, &blocks);
    let (header, body) = Header::parse(&prm_end).unwrap();
    let fragments: Vec<_> = body.chunks(20).collect();
    let mut sent = Vec::new();
    for (index, chunk) in fragments.iter().enumerate() {
        let last = if index + 1 == fragments.len() { flags::LAST_FRAGMENT } else { 0 };
        let header = Header { fragment: index as u16, flags: flags::FRAGMENT | last, ..header };
        let mut buf = [0; 300];
        let len = header.emit(chunk, &mut buf).unwrap();
        sent = rig.receive(Port::Udp(RPC_PORT), &buf[..len]);
        for number in 0..8 {
            let stranger = SocketAddrV4::new(Ipv4Addr::new(10, 0, 1, number), 50_000);
            let header = Header { fragment: 0, flags: flags::FRAGMENT, ..header };
            let mut buf = [0; 300];
            let len = header.emit(&[0; 100], &mut buf).unwrap();
            rig.receive_from(stranger, Port::Udp(RPC_PORT), &buf[..len]);
        }
    }
    assert_eq!(sent.len(), 2, "the answer, and ApplicationReady");
}

#[test]
fn the_alarm_connection_takes_pdus_of_the_controllers_station_alone() {
    use profinet::alarm::{FRAME_ID_LOW, PduType, Rta};
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let rta = Rta {
        destination: 0,
        source: 5,
        pdu_type: PduType::Error,
        flags: 1,
        send_sequence: 0xFFFE,
        ack_sequence: 0xFFFE,
    };
    let mut buf = [0; 100];
    let header = EthernetHeader { source: Mac([2, 0, 0, 0, 0, 0x66]), ..ethernet_header() };
    let status = Violation::ArRemoved.status(Service::Abort);
    let len = header
        .emit(&mut buf, |w| {
            w.u16(FRAME_ID_LOW);
            rta.emit_error(status, w);
        })
        .unwrap();
    rig.receive(Port::Ethernet, &buf[..len]);
    rig.receive_from(STRANGER, Port::Udp(UDP_PORT), &buf[14..len]);
    nothing_changed(&mut rig);
}

#[test]
fn a_device_with_a_list_of_controllers_is_connected_to_and_addressed_by_these_alone() {
    let controllers = Allowed(vec![Peer {
        address: Some(*CONTROLLER.ip()),
        mac: Some(CONTROLLER_MAC),
        serial_number: None,
    }]);
    let mut rig = DeviceRig::around(Device::new(DeviceConfig { controllers, ..config() }, Instant::ZERO));
    let connect = connect_request(RtClass::Class1, true);
    let (status, ..) = rig.call_from(STRANGER, Operation::Connect, &emitted(|w| connect.emit(w)));
    assert_eq!(status, Violation::InitiatorMac.status(Service::Connect));
    let mut other_mac = connect.clone();
    other_mac.ar.initiator_mac = Mac([2, 0, 0, 0, 0, 0x66]);
    assert_eq!(rig.connect(&other_mac).0, Violation::InitiatorMac.status(Service::Connect));
    assert!(!rig.device.has_controller());
    assert!(matches!(rig.events()[..], [LinkEvent::Foreign(_)]));
    rig.establish(&connect);
}
