//! Answers of a device that do not fit the call, and what it is asked next.

use machine::wire::{BigEndian, Reader, Writer};
use profinet::Uuid;
use profinet::connect::{ConnectRequest, RtClass};
use profinet::control::{Command, Control};
use profinet::record::{WriteRequest, WriteResponse};
use profinet::rpc::{Operation, RequestArgs, ResponseArgs};
use profinet::status::{Service, Status, Violation};

use super::peer::datagram;
use super::*;

/// Lets the controller connect, with other answers to the calls of this operation: `body` makes their bodies from the blocks of
/// the calls. Returns what is reported within 5 ms.
fn connect(cell: &mut Cell, operation: Operation, body: impl Fn(&[u8]) -> Vec<u8>) -> Vec<LinkEvent> {
    let mut buf = [0; FRAME_CAPACITY];
    cell.now = Instant::from_millis(200);
    cell.controller.handle_timeout(cell.now);
    while let Some(transmit) = cell.poll(&mut buf) {
        let frame = &buf[..transmit.len];
        let pdu = (transmit.port == Port::Udp(RPC_PORT)).then(|| Header::parse(frame).unwrap());
        let call = pdu.filter(|(header, _)| {
            header.kind == Kind::Request && Operation::from(header.operation) == operation
        });
        let answers = match call {
            Some((header, args)) => {
                let body = body(RequestArgs::parse(&header, args).unwrap().blocks);
                vec![datagram(&header.answer(Kind::Response), |buf| {
                    buf[..body.len()].copy_from_slice(&body);
                    body.len()
                })]
            }
            None => cell.peer.receive(cell.now, &transmit, frame),
        };
        for (source, frame) in answers {
            cell.controller.handle_frame(cell.now, source, &frame);
        }
    }
    cell.run(5)
}

/// Returns the body of a positive answer with these blocks.
fn positive(blocks: impl FnOnce(&mut Writer<'_, BigEndian>)) -> Vec<u8> {
    let mut body = [0; 200];
    let len = ResponseArgs::emit(Status::OK, 4096, &mut body, blocks).unwrap();
    body[..len].to_vec()
}

/// Returns cause, status and words of the only event, an end.
fn down(events: &[LinkEvent]) -> (DownCause, u32, &str) {
    let [LinkEvent::Down(down)] = events else { panic!("{events:?}") };
    (down.cause, down.code, down.text)
}

const UNFIT: (DownCause, u32, &str) =
    (DownCause::Refused, 0, "the device's answer does not fit the request: compare both in a capture");

#[test]
fn the_answer_to_a_write_counts_only_if_it_is_about_this_ar_and_positive() {
    let written = |change: fn(&mut WriteResponse)| {
        let mut cell = Cell::new(Transport::Rt1, PeerScript::default());
        connect(&mut cell, Operation::Write, |blocks| {
            let request = WriteRequest::parse(&mut Reader::new(blocks)).unwrap();
            let mut answer = WriteResponse { address: request.address, length: 0, status: Status::OK };
            change(&mut answer);
            positive(|w| answer.emit(w))
        })
    };
    assert_eq!(written(|_| {}), [LinkEvent::Up]);
    assert_eq!(down(&written(|answer| answer.address.ar = Uuid([9; 16]))), UNFIT);
    let refusal = Violation::WriteLength.status(Service::Write);
    let refused = written(|answer| answer.status = Violation::WriteLength.status(Service::Write));
    assert_eq!(down(&refused), (DownCause::Refused, refusal.0, refusal.text()));
    let mut cell = Cell::new(Transport::Rt1, PeerScript::default());
    assert_eq!(down(&connect(&mut cell, Operation::Write, |_| positive(|_| {}))), UNFIT);
}

#[test]
fn the_answer_to_prm_end_counts_only_if_it_is_about_this_connection() {
    let ended = |change: fn(&mut Control)| {
        let script = PeerScript { never_ready: true, ..PeerScript::default() };
        let mut cell = Cell::new(Transport::Rt1, script);
        connect(&mut cell, Operation::Control, |blocks| {
            let mut control = Control::parse_request(blocks).unwrap();
            change(&mut control);
            positive(|w| control.emit_response(w))
        })
    };
    assert_eq!(ended(|_| {}), []);
    assert_eq!(down(&ended(|control| control.ar = Uuid([9; 16]))), UNFIT);
    assert_eq!(down(&ended(|control| control.session += 1)), UNFIT);
    assert_eq!(down(&ended(|control| control.command = Command::Release)), UNFIT);
}

#[test]
fn an_answer_that_breaks_the_format_is_counted_and_refused() {
    for operation in [Operation::Connect, Operation::Write, Operation::Control] {
        let mut cell = Cell::new(Transport::Rt1, PeerScript::default());
        let events = connect(&mut cell, operation, |_| vec![0; 7]);
        assert_eq!((down(&events), cell.ar().counters().malformed), (UNFIT, 1), "{operation:?}");
    }
}

#[test]
fn differences_of_modules_that_break_the_format_are_counted_and_the_device_is_ready_all_the_same() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript { never_ready: true, ..PeerScript::default() });
    assert_eq!(cell.run(50), []);
    let (_, call) = cell.peer.application_ready();
    let (header, body) = Header::parse(&call).unwrap();
    let blocks = RequestArgs::parse(&header, body).unwrap().blocks;
    // A ModuleDiffBlock that says one API and ends.
    let cut = [0x81, 0x04, 0, 4, 1, 0, 0, 1];
    let ready = datagram(&header, |body| {
        let blocks =
            |w: &mut Writer<'_, BigEndian>| [blocks, &cut].into_iter().for_each(|part| w.bytes(part));
        RequestArgs::emit(4096, body, blocks).unwrap()
    });
    cell.deliver(ready);
    assert_eq!(cell.run(5), [LinkEvent::Up]);
    assert_eq!((cell.ar().counters().malformed, cell.ar().module_diff()), (1, &[][..]));
}

/// Returns the Connects on the cable.
fn connects(cell: &Cell) -> Vec<ConnectRequest> {
    let datagram = |frame: &Vec<u8>| {
        let is_udp = frame[6..14] == [&CONTROLLER.0[..], &[8, 0]].concat();
        let is_call = is_udp && frame[36..38] == RPC_PORT.to_be_bytes();
        let (header, body) = Header::parse(frame.get(42..).filter(|_| is_call)?).ok()?;
        let is_connect =
            header.kind == Kind::Request && Operation::from(header.operation) == Operation::Connect;
        let args = RequestArgs::parse(&header, body).ok().filter(|_| is_connect)?;
        Some(ConnectRequest::parse(args.blocks).unwrap())
    };
    cell.tap.iter().filter_map(datagram).collect()
}

/// Returns the forms in which a device is asked for its data that refuses each Connect with this status, for so many ms.
fn forms(transport: Transport, violation: Violation, millis: u64) -> Vec<[(RtClass, u16); 2]> {
    let refuses_connect = Some(violation.status(Service::Connect));
    let mut cell = Cell::new(transport, PeerScript { refuses_connect, ..PeerScript::default() });
    cell.run(millis);
    let form =
        |connect: ConnectRequest| [0, 1].map(|n| (connect.iocrs[n].rt_class, connect.iocrs[n].frame_id));
    connects(&cell).into_iter().map(form).collect()
}

#[test]
fn only_a_device_that_refuses_the_class_of_its_data_is_asked_for_another_one() {
    let present = [(RtClass::Class1, 0x8000), (RtClass::Class1, 0x8001)];
    let former = [(RtClass::Legacy1, 0xC000), (RtClass::Legacy1, 0xC001)];
    let over_udp = [(RtClass::Udp, 0xC000), (RtClass::Udp, 0xC001)];
    // Attempts at 0 and 0.3 s, each with a search of 0.2 s.
    let class = Violation::IocrProperties;
    assert_eq!(forms(Transport::Rt1, class, 400), [present, former, former, present]);
    assert_eq!(forms(Transport::Rt1, Violation::OutOfArResources, 400), [present; 2]);
    assert_eq!(forms(Transport::Udp, class, 400), [over_udp; 2]);
}

#[test]
fn the_uuid_of_each_ar_is_random_in_all_bits_besides_version_and_variant() {
    let (mut ones, mut zeros) = (0, 0);
    for seed in 0..64 {
        let mut cell = Cell::new(Transport::Rt1, PeerScript::default());
        cell.controller = controller_with(seed);
        cell.ar = cell.controller.connect(ar(Transport::Rt1), Instant::ZERO).unwrap();
        cell.now = Instant::ZERO;
        assert_eq!(cell.run(205), [LinkEvent::Up]);
        let uuid = u128::from_be_bytes(cell.peer.connect.unwrap().ar.uuid.0);
        assert_eq!((uuid >> 76 & 0xF, uuid >> 62 & 3), (4, 2), "RFC 9562, version 4: {uuid:032x}");
        ones |= uuid;
        zeros |= !uuid;
    }
    let fixed = 0xF << 76 | 3 << 62;
    assert_eq!((ones | fixed, zeros | fixed), (u128::MAX, u128::MAX));
}
