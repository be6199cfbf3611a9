//! A controller that restarts and numbers its calls anew, with the activity of before or another one.

use super::*;
use profinet::record::{Address, ReadRequest, index};

/// Returns the status of a Connect of a session, whose call has this number; `None` if it is not answered.
fn connect(rig: &mut DeviceRig, sequence: u32, session: u16) -> Option<Status> {
    let mut request = connect_request(RtClass::Class1, true);
    request.ar.session = session;
    rig.sequence = sequence;
    let datagram = rig.datagram(Operation::Connect, &emitted(|w| request.emit(w)));
    let sent = rig.receive(Port::Udp(RPC_PORT), &datagram);
    let (_, answer) = sent.iter().find(|(transmit, _)| transmit.to == Some(CONTROLLER))?;
    let (header, body) = Header::parse(answer).unwrap();
    Some(ResponseArgs::parse(&header, body).unwrap().status)
}

/// Returns a device whose controller has called often.
fn after_many_calls() -> DeviceRig {
    let mut rig = DeviceRig::new();
    rig.sequence = 1_000;
    rig.establish(&connect_request(RtClass::Class1, true));
    rig
}

#[test]
fn a_controller_that_restarts_connects_at_once_while_its_old_connection_is_there() {
    for activity in [Uuid([9; 16]), Uuid([7; 16])] {
        let mut rig = after_many_calls();
        rig.activity = activity;
        assert_eq!(connect(&mut rig, 0, 2), Some(Status::OK));
        assert!(matches!(rig.events()[..], [LinkEvent::Down(machine::Down { code: 0xCF81_FD0E, .. })]));
        let prm_end = Control { session: 2, ..control(Command::PrmEnd) };
        assert!(rig.control(Operation::Control, prm_end).0.is_ok(), "and goes on from there");
    }
}

#[test]
fn a_controller_that_restarts_connects_after_its_watchdog_ended_the_old_connection() {
    for activity in [Uuid([9; 16]), Uuid([7; 16])] {
        let mut rig = after_many_calls();
        rig.advance(Duration::from_secs(1));
        assert!(!rig.device.has_controller());
        rig.activity = activity;
        assert_eq!(connect(&mut rig, 0, 1), Some(Status::OK), "even with the same session");
        assert!(rig.device.has_controller());
    }
}

#[test]
fn a_connect_with_the_number_of_an_earlier_one_gets_an_answer_of_its_own() {
    let mut rig = DeviceRig::new();
    assert_eq!(connect(&mut rig, 0, 1), Some(Status::OK));
    assert_eq!(connect(&mut rig, 0, 2), Some(Status::OK), "another session, so it is no repetition");
    let [LinkEvent::Down(_)] = rig.events()[..] else { panic!("the first connection is over") };

    rig.advance(Duration::from_secs(3));
    assert!(!rig.device.has_controller(), "nothing followed the Connect");
    rig.events();
    assert_eq!(connect(&mut rig, 0, 2), Some(Status::OK));
    assert!(rig.device.has_controller(), "the same bytes are a new Connect, once the AR is over");
}

#[test]
fn a_read_with_the_same_bytes_gets_the_same_answer_while_it_may_be_a_repetition_and_then_the_data_of_now() {
    let mut rig = DeviceRig::new();
    // The log book, which begins with the time of the read.
    let address = Address { sequence: 0, ar: Uuid::NIL, api: 0, slot: 0, subslot: 0, index: index::LOG_BOOK };
    let read = ReadRequest { address, most: 4_000, target_ar: Uuid::NIL };
    let read = rig.datagram(Operation::ReadImplicit, &emitted(|w| read.emit(w)));
    let answer = |rig: &mut DeviceRig| {
        let sent = rig.receive(Port::Udp(RPC_PORT), &read);
        Header::parse(&sent[0].1).unwrap().1.to_vec()
    };
    let first = answer(&mut rig);
    rig.advance(Duration::from_millis(29_999));
    assert_eq!(answer(&mut rig), first, "a repetition, since the answer may be lost");
    rig.advance(Duration::from_millis(1));
    assert_ne!(answer(&mut rig), first, "repetitions do not make it younger");
}

#[test]
fn a_release_that_is_repeated_gets_its_answer_again_and_a_connect_after_it_is_new() {
    let mut rig = after_many_calls();
    let release = rig.datagram(Operation::Release, &emitted(|w| control(Command::Release).emit_request(w)));
    let first = rig.receive(Port::Udp(RPC_PORT), &release);
    let again = rig.receive(Port::Udp(RPC_PORT), &release);
    assert_eq!(first[0].1[80..], again[0].1[80..]);
    assert_eq!(connect(&mut rig, 5, 2), Some(Status::OK));
}
