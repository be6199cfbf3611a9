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
    let mut refused = 0;
    for fragment in 0..10 {
        header.fragment = fragment;
        refused += u32::from(matches!(reassembly.take(&header, &body), Received::Refused));
    }
    assert!(refused > 0);
}
