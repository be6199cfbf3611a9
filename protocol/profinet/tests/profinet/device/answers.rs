//! Which answers the device keeps for a repeated request, for whom, and what it replies without blocks.

use profinet::record::{Address, ReadRequest, index};
use profinet::rpc::{ENDPOINT_MAPPER_INTERFACE, LOOKUP, read_rpc_status};

use super::*;

/// A station that reads without an AR.
struct AnswerReader {
    number: u8,
    sequence: u32,
}

impl AnswerReader {
    fn new(number: u8) -> Self {
        Self { number, sequence: 0 }
    }

    /// Makes the call with the number of the reader. Returns the serial number of the answer: 0 if the call was executed, 1 if
    /// it was answered before; `None` without an answer.
    fn call(&self, rig: &mut DeviceRig) -> Option<u16> {
        let address = Address {
            sequence: 0,
            ar: Uuid::NIL,
            api: 0,
            slot: 1,
            subslot: 1,
            index: index::IDENTIFICATION_AND_MAINTENANCE_0,
        };
        let read = ReadRequest { address, most: 4_000, target_ar: Uuid::NIL };
        let own = (rig.activity, rig.sequence);
        (rig.activity, rig.sequence) = (Uuid([self.number; 16]), self.sequence);
        let datagram = rig.datagram(Operation::ReadImplicit, &emitted(|w| read.emit(w)));
        (rig.activity, rig.sequence) = own;
        let from = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, self.number), 50_000);
        let sent = rig.receive_from(from, Port::Udp(RPC_PORT), &datagram);
        serial(&sent)
    }
}

fn serial(sent: &Sent) -> Option<u16> {
    let (_, answer) = sent.first()?;
    let (header, _) = Header::parse(answer).unwrap();
    assert_eq!(header.kind, Kind::Response);
    Some(header.serial)
}

#[test]
fn the_answer_that_is_the_oldest_makes_room_for_that_of_a_new_caller() {
    let mut rig = DeviceRig::new();
    let mut readers = [1, 2, 3, 4, 5].map(AnswerReader::new);
    for reader in &readers[..4] {
        assert_eq!(reader.call(&mut rig), Some(0));
    }
    readers[0].sequence = 1;
    assert_eq!(readers[0].call(&mut rig), Some(0), "another call");
    assert_eq!(readers[4].call(&mut rig), Some(0), "takes the place of the second reader");
    for index in [0, 2, 3, 4] {
        assert_eq!(readers[index].call(&mut rig), Some(1), "reader {}", index + 1);
    }
    assert_eq!(readers[1].call(&mut rig), Some(0));
}

#[test]
fn the_controllers_newest_answer_stays_however_many_others_read() {
    let mut rig = DeviceRig::new();
    assert_eq!(AnswerReader::new(1).call(&mut rig), Some(0), "is there before the controller");
    let connect =
        rig.datagram(Operation::Connect, &emitted(|w| connect_request(RtClass::Class1, true).emit(w)));
    assert_eq!(serial(&rig.receive(Port::Udp(RPC_PORT), &connect)), Some(0));
    for number in 2..20 {
        AnswerReader::new(number).call(&mut rig);
    }
    assert_eq!(serial(&rig.receive(Port::Udp(RPC_PORT), &connect)), Some(1));
}

#[test]
fn the_controller_numbers_its_calls_upwards_and_every_other_caller_as_it_likes() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    for sequence in [7, 3, 0x8000_0000, 3] {
        let reader = AnswerReader { number: 1, sequence };
        assert_eq!(reader.call(&mut rig), Some(0), "number {sequence}");
    }
    let mut prm_begin = |sequence| {
        rig.sequence = sequence;
        let blocks = emitted(|w| control(Command::PrmBegin).emit_request(w));
        let datagram = rig.datagram(Operation::Control, &blocks);
        serial(&rig.receive(Port::Udp(RPC_PORT), &datagram))
    };
    assert_eq!(prm_begin(0), None, "older than the last call of the controller");
    assert_eq!(prm_begin(2), Some(0));
}

#[test]
fn a_ping_gets_the_answer_of_its_own_call_only() {
    let mut rig = DeviceRig::new();
    rig.connect(&connect_request(RtClass::Class1, true));
    let mut ping = |from, activity, sequence| {
        let header = Header { kind: Kind::Ping, activity, sequence, ..rig.header(Operation::Connect) };
        let mut buf = [0; 100];
        let len = header.emit(&[], &mut buf).unwrap();
        let sent = rig.receive_from(from, Port::Udp(RPC_PORT), &buf[..len]);
        let [(transmit, answer)] = &sent[..] else { panic!("one answer: {sent:?}") };
        assert_eq!(transmit.to, Some(from));
        Header::parse(answer).unwrap().0.kind
    };
    let own = Uuid([9; 16]);
    let other = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, 66), 49_152);
    assert_eq!(ping(CONTROLLER, own, 0), Kind::Response);
    assert_eq!(ping(CONTROLLER, own, 5), Kind::NoCall, "another call");
    assert_eq!(ping(CONTROLLER, Uuid([8; 16]), 0), Kind::NoCall, "another activity");
    assert_eq!(ping(other, own, 0), Kind::NoCall, "another station");
}

#[test]
fn a_fragment_is_acknowledged_by_its_number_unless_its_sender_wants_none() {
    let mut rig = DeviceRig::new();
    let mut fragment = |fragment, more| {
        let header = rig.header(Operation::Connect);
        let header = Header { fragment, flags: flags::FRAGMENT | more, ..header };
        let mut buf = [0; 200];
        let len = header.emit(&[0; 100], &mut buf).unwrap();
        let sent = rig.receive(Port::Udp(RPC_PORT), &buf[..len]);
        sent.first().map(|(_, answer)| {
            let (header, _) = Header::parse(answer).unwrap();
            (header.kind, header.fragment)
        })
    };
    assert_eq!(fragment(0, 0), Some((Kind::FragmentAck, 0)));
    assert_eq!(fragment(1, 0), Some((Kind::FragmentAck, 1)));
    assert_eq!(fragment(2, flags::NO_FRAGMENT_ACK), None);
    assert_eq!(fragment(3, 0), Some((Kind::FragmentAck, 3)));
}

#[test]
fn the_endpoint_mapper_refuses_in_the_terms_of_rpc() {
    let mut rig = DeviceRig::new();
    let mut refusal = |operation, body: &[u8]| {
        let header = rig.header(Operation::Unknown(operation));
        let mut buf = [0; 200];
        let header = Header { interface: ENDPOINT_MAPPER_INTERFACE, ..header };
        let len = header.emit(body, &mut buf).unwrap();
        let sent = rig.receive(Port::Udp(RPC_PORT), &buf[..len]);
        let (header, body) = Header::parse(&sent[0].1).unwrap();
        (header.kind, read_rpc_status(&header, body))
    };
    assert_eq!(refusal(LOOKUP, &[0; 20]), (Kind::Fault, Some(rpc_status::PROTOCOL_ERROR)));
    assert_eq!(refusal(9, &[0; 76]), (Kind::Reject, Some(rpc_status::OPERATION_RANGE)));
}
