use super::*;
use crate::captured;
use crate::status::Violation;

#[test]
fn a_captured_little_endian_request_is_parsed_and_written_back_unchanged() {
    let datagram = captured::datagram(captured::CONNECT_REQ);
    let (header, body) = Header::parse(&datagram).unwrap();
    assert_eq!(header.kind, Kind::Request);
    assert_eq!(header.order, DataRepresentation::LittleEndian);
    assert_eq!(header.interface, DEVICE_INTERFACE);
    assert_eq!(header.object, object(1, Identity { vendor: 0x0493, device: 0x0002 }));
    assert_eq!(Operation::from(header.operation), Operation::Connect);
    assert_eq!(RequestArgs::parse(&header, body).unwrap().blocks.len(), 557);

    let mut buf = [0; 1500];
    let len = header.emit(body, &mut buf).unwrap();
    assert_eq!(buf[..len], datagram);
}

#[test]
fn a_captured_answer_has_the_header_of_our_answer() {
    let request = captured::datagram(captured::CONNECT_REQ);
    let (request, _) = Header::parse(&request).unwrap();
    let response = captured::datagram(captured::CONNECT_RES);
    let (response, body) = Header::parse(&response).unwrap();
    assert_eq!(request.answer(Kind::Response), response);

    let args = ResponseArgs::parse(&response, body).unwrap();
    let mut buf = [0; 500];
    let len = ResponseArgs::emit(args.status, 557, &mut buf, |w| w.bytes(args.blocks)).unwrap();
    assert_eq!(buf[..len], *body);
}

#[test]
fn lengths_that_contradict_each_other_are_refused() {
    let datagram = captured::datagram(captured::PRMEND_REQ);
    for len in 0..datagram.len() {
        assert!(Header::parse(&datagram[..len]).is_err(), "cut at {len}");
    }
    let (header, body) = Header::parse(&datagram).unwrap();
    assert!(RequestArgs::parse(&header, body).is_ok());
    assert_eq!(RequestArgs::parse(&header, &body[..body.len() - 1]), Err(Violation::ArgsLength));
    let mut longer = body.to_vec();
    longer[4] += 1;
    assert_eq!(RequestArgs::parse(&header, &longer), Err(Violation::ArgsLength));
}

#[test]
fn another_version_and_authentication_are_refused() {
    let mut datagram = captured::datagram(captured::PRMEND_REQ);
    datagram[78] = 1;
    assert_eq!(Header::parse(&datagram), Err(Error::Authentication(1)));
    datagram[0] = 5;
    assert_eq!(Header::parse(&datagram), Err(Error::Version(5)));
}

fn long_message(len: usize) -> Message {
    let mut message = Message::new();
    let header = Header::request(Operation::Write, Uuid::NIL, DEVICE_INTERFACE, Uuid([7; 16]), 3);
    message
        .set(header, |body| {
            body[..len].iter_mut().enumerate().for_each(|(index, byte)| *byte = index as u8);
            Ok(len)
        })
        .unwrap();
    message
}

fn fragments(message: &mut Message) -> Vec<Vec<u8>> {
    let mut buf = [0; 1500];
    core::iter::from_fn(|| message.poll(&mut buf).map(|len| buf[..len].to_vec())).collect()
}

#[test]
fn a_long_body_is_sent_in_fragments_and_reassembled() {
    let fragments = fragments(&mut long_message(4000));
    assert_eq!(fragments.len(), 4);
    let mut reassembly = Reassembly::new();
    for (index, fragment) in fragments.iter().enumerate() {
        let (header, body) = Header::parse(fragment).unwrap();
        match reassembly.take(&header, body) {
            Received::Whole(body) => {
                assert_eq!(index, 3);
                assert_eq!(body.len(), 4000);
                assert!(body.iter().enumerate().all(|(index, byte)| *byte == index as u8));
            }
            received => assert!(index < 3 && matches!(received, Received::Part), "{index}: {received:?}"),
        }
    }
}

#[test]
fn a_duplicate_fragment_is_ignored_a_missing_one_drops_the_call_and_a_repetition_starts_again() {
    let fragments = fragments(&mut long_message(4000));
    let mut reassembly = Reassembly::new();
    let mut take = |index: usize| {
        let (header, body) = Header::parse(&fragments[index]).unwrap();
        match reassembly.take(&header, body) {
            Received::Whole(body) => format!("whole {}", body.len()),
            Received::Part => "part".into(),
            Received::Refused => "refused".into(),
            Received::TooLong => "too long".into(),
        }
    };
    let order = [0, 0, 1, 3, 2, 0, 1, 1, 2, 3];
    let received: Vec<_> = order.into_iter().map(&mut take).collect();
    assert_eq!(
        received,
        ["part", "part", "part", "refused", "refused", "part", "part", "part", "part", "whole 4000"]
    );
}

#[test]
fn the_last_fragment_of_a_complete_call_completes_it_again_and_no_other_fragment_does() {
    let fragments = fragments(&mut long_message(4000));
    let mut reassembly = Reassembly::new();
    for fragment in &fragments {
        let (header, body) = Header::parse(fragment).unwrap();
        reassembly.take(&header, body);
    }
    let (last, end) = Header::parse(&fragments[3]).unwrap();
    let (middle, part) = Header::parse(&fragments[2]).unwrap();
    let is_whole = |reassembly: &mut Reassembly, header: &Header, body: &[u8]| matches!(reassembly.take(header, body), Received::Whole(whole) if whole.len() == 4000);
    assert!(is_whole(&mut reassembly, &last, end) && is_whole(&mut reassembly, &last, end));
    assert!(!is_whole(&mut reassembly, &middle, part));
    assert!(!is_whole(&mut reassembly, &last, &[&[9], &end[1..]].concat()), "other bytes");
    assert!(!is_whole(&mut reassembly, &Header { sequence: 4, ..last }, end), "another call");
    let (first, start) = Header::parse(&fragments[0]).unwrap();
    reassembly.take(&Header { sequence: 4, ..first }, start);
    assert!(!is_whole(&mut reassembly, &last, end), "its body is overwritten");
}

#[test]
fn fragments_of_another_byte_order_and_bodies_over_the_limit_are_refused() {
    let fragments = fragments(&mut long_message(4000));
    let mut reassembly = Reassembly::new();
    let (header, body) = Header::parse(&fragments[0]).unwrap();
    assert!(matches!(reassembly.take(&header, body), Received::Part));
    let (mut header, body) = Header::parse(&fragments[1]).unwrap();
    header.order = DataRepresentation::LittleEndian;
    assert!(matches!(reassembly.take(&header, body), Received::Refused));

    let (mut header, _) = Header::parse(&fragments[0]).unwrap();
    let body = [0; 1400];
    let mut took = Vec::new();
    for fragment in 0..8 {
        header.fragment = fragment;
        took.push(match reassembly.take(&header, &body) {
            Received::Part => "part",
            Received::TooLong => "too long",
            Received::Refused => "refused",
            Received::Whole(_) => "whole",
        });
    }
    // Five fragments of 1400 bytes fit into 8192.
    assert_eq!(took, ["part", "part", "part", "part", "part", "too long", "refused", "refused"]);
}

#[test]
fn the_interfaces_have_the_uuids_of_the_standard() {
    let uuid = |number| {
        Uuid([0xDE, 0xA0, 0, number, 0x6C, 0x97, 0x11, 0xD1, 0x82, 0x71, 0, 0xA0, 0x24, 0x42, 0xDF, 0x7D])
    };
    assert_eq!((DEVICE_INTERFACE, CONTROLLER_INTERFACE), (uuid(1), uuid(2)));
}

#[test]
fn an_operation_has_the_number_that_it_came_from() {
    let numbers = [0, 1, 2, 3, 4, 5, 6, 0xFFFF];
    assert_eq!(numbers.map(|number| u16::from(Operation::from(number))), numbers);
}

#[test]
fn an_answer_has_neither_flags2_nor_serial_nor_fragment_of_its_call() {
    let call = Header::request(Operation::Write, Uuid::NIL, DEVICE_INTERFACE, Uuid([7; 16]), 3);
    let repeated = Header { flags2: 2, serial: 0x0102, fragment: 4, ..call };
    assert_eq!(repeated.answer(Kind::Response), call.answer(Kind::Response));
    let answer = repeated.answer(Kind::NoCall);
    assert_eq!((answer.flags2, answer.serial, answer.fragment), (0, 0, 0));
}

#[test]
fn a_message_is_sent_until_its_last_fragment_and_again_when_repeated_unless_it_is_removed() {
    let mut buf = [0; 1500];
    assert_eq!(Message::new().poll(&mut buf), None);
    let mut message = long_message(FRAGMENT_LEN + 1);
    for _ in 0..2 {
        assert!(message.poll(&mut buf).is_some());
    }
    assert_eq!(message.poll(&mut buf), None);
    message.repeat();
    assert!(message.poll(&mut buf).is_some());
    message.clear();
    assert_eq!(message.poll(&mut buf), None);
    assert!(message.header().is_none());
}

#[test]
fn a_lookup_that_has_no_room_for_an_entry_finds_none() {
    let lookup = Lookup { handle: Uuid::NIL, interface: None, object: None, most_entries: 0 };
    let endpoint = Endpoint::of(DEVICE_INTERFACE, &crate::samples::DEVICE, core::net::Ipv4Addr::LOCALHOST);
    let mut body = [0; 300];
    let len = MapperCall::Lookup(lookup).answer(&endpoint, &mut body).unwrap();
    assert_eq!(body[..len - 4], [0; 36], "no handle, no entries");
    assert_eq!(body[len - 4..len], 0x16C9_A0D6_u32.to_be_bytes());
}

/// Takes fragments of calls, as number of the call, number of the fragment, whether it is the last one, and body; returns what
/// becomes of each.
fn taken(fragments: &[(u32, u16, bool, &str)]) -> Vec<String> {
    let mut reassembly = Reassembly::new();
    let take = |(sequence, fragment, is_last, body): &(u32, u16, bool, &str)| {
        let flags = flags::FRAGMENT | if *is_last { flags::LAST_FRAGMENT } else { 0 };
        let call = Header::request(Operation::Write, Uuid::NIL, DEVICE_INTERFACE, Uuid([7; 16]), *sequence);
        match reassembly.take(&Header { flags, fragment: *fragment, ..call }, body.as_bytes()) {
            Received::Whole(body) => String::from_utf8(body.to_vec()).unwrap(),
            Received::Part => "part".into(),
            Received::Refused => "refused".into(),
            Received::TooLong => "too long".into(),
        }
    };
    fragments.iter().map(take).collect()
}

#[test]
fn a_first_fragment_begins_its_call_anew_whatever_was_there_before() {
    let another_call = [(3, 0, false, "same "), (4, 0, false, "same "), (4, 1, true, "end")];
    assert_eq!(taken(&another_call), ["part", "part", "same end"]);
    let repeated = [(3, 0, false, "a"), (3, 0, false, "a"), (3, 1, true, "b")];
    assert_eq!(taken(&repeated), ["part", "part", "ab"]);
    // A caller that restarted numbers its calls anew.
    let restarted = [(3, 0, false, "old "), (3, 0, false, "new "), (3, 1, true, "end")];
    assert_eq!(taken(&restarted), ["part", "part", "new end"]);
    let restarted_later = [
        (3, 0, false, "old "),
        (3, 1, false, "old "),
        (3, 0, false, "new "),
        (3, 1, false, "part "),
        (3, 2, true, "end"),
    ];
    assert_eq!(taken(&restarted_later), ["part", "part", "part", "part", "new part end"]);
}

#[test]
fn a_later_fragment_of_another_call_does_not_spoil_the_unfinished_one() {
    let fragments = [(3, 0, false, "a"), (4, 1, false, "x"), (3, 1, true, "b")];
    assert_eq!(taken(&fragments), ["part", "refused", "ab"]);
}

#[test]
fn a_reassembly_that_is_cleared_has_no_unfinished_call() {
    let fragments = fragments(&mut long_message(2000));
    let [first, second] = [&fragments[0], &fragments[1]].map(|fragment| Header::parse(fragment).unwrap());
    let mut reassembly = Reassembly::new();
    assert!(matches!(reassembly.take(&first.0, first.1), Received::Part));
    reassembly.clear();
    assert!(matches!(reassembly.take(&second.0, second.1), Received::Refused));
}
