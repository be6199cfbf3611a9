//! Frames between a Siemens CPU 1515-2 PN V2.9.4 and a p-net device, from the test data of crate `pnio` 0.1.0
//! (MIT OR Apache-2.0), without their Ethernet headers.

use super::*;
use core::net::Ipv4Addr;
use proptest::prelude::*;

#[rustfmt::skip]
const SET_REQUEST: &[u8] = &[
    0xFE, 0xFD, 0x04, 0x00, 0x03, 0x00, 0x01, 0x2D, 0x00, 0x00, 0x00, 0x12, 0x01, 0x02, 0x00, 0x0E, 0x00, 0x00,
    0xAC, 0x10, 0x02, 0x0A, 0xFF, 0xFF, 0xFF, 0x00, 0xAC, 0x10, 0x02, 0x0A,
];

#[rustfmt::skip]
const SET_RESPONSE: &[u8] = &[
    0xFE, 0xFD, 0x04, 0x01, 0x03, 0x00, 0x01, 0x2D, 0x00, 0x00, 0x00, 0x08, 0x05, 0x04, 0x00, 0x03, 0x01, 0x02,
    0x00, 0x00,
];

#[rustfmt::skip]
const IDENTIFY_RESPONSE: &[u8] = &[
    0xFE, 0xFF, 0x05, 0x01, 0x03, 0x00, 0x01, 0x2C, 0x00, 0x00, 0x00, 0x76, 0x01, 0x02, 0x00, 0x0E, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x02, 0x01, 0x00, 0x1A, 0x00, 0x00,
    0x50, 0x2D, 0x4E, 0x65, 0x74, 0x20, 0x53, 0x61, 0x6D, 0x70, 0x6C, 0x65, 0x20, 0x41, 0x70, 0x70, 0x6C, 0x69,
    0x63, 0x61, 0x74, 0x69, 0x6F, 0x6E, 0x02, 0x02, 0x00, 0x0D, 0x00, 0x00, 0x72, 0x74, 0x2D, 0x6C, 0x61, 0x62,
    0x73, 0x2D, 0x64, 0x65, 0x76, 0x00, 0x02, 0x03, 0x00, 0x06, 0x00, 0x00, 0x04, 0x93, 0x00, 0x02, 0x02, 0x04,
    0x00, 0x04, 0x00, 0x00, 0x01, 0x01, 0x02, 0x05, 0x00, 0x1E, 0x00, 0x00, 0x01, 0x02, 0x01, 0x01, 0x02, 0x01,
    0x02, 0x02, 0x02, 0x03, 0x02, 0x04, 0x02, 0x05, 0x02, 0x06, 0x05, 0x01, 0x05, 0x02, 0x05, 0x03, 0x05, 0x05,
    0x05, 0x06, 0xFF, 0xFF,
];

fn emitted(write: impl FnOnce(&mut Writer<'_, BigEndian>)) -> Vec<u8> {
    let mut buf = [0xAA; 512];
    let mut writer = Writer::new(&mut buf);
    write(&mut writer);
    let len = writer.finish().unwrap();
    buf[..len].to_vec()
}

const SUITE: IpSuite = IpSuite {
    address: Ipv4Addr::new(172, 16, 2, 10),
    mask: Ipv4Addr::new(255, 255, 255, 0),
    gateway: Ipv4Addr::new(172, 16, 2, 10),
};

#[test]
fn set_ip_and_its_answer_have_the_bytes_of_the_siemens_controller_and_of_p_net() {
    let request = [Content::Ip(SUITE).into()];
    assert_eq!(emitted(|w| emit(w, Service::SetRequest, 0x0300_012D, 0, request)), SET_REQUEST);
    let response = [Content::Response { code: Code::IP, error: BlockError::None }.into()];
    assert_eq!(emitted(|w| emit(w, Service::SetResponse, 0x0300_012D, 0, response)), SET_RESPONSE);

    let pdu = Pdu::parse(SET_REQUEST).unwrap();
    assert_eq!((pdu.service, pdu.xid), (Service::SetRequest, 0x0300_012D));
    assert_eq!(pdu.blocks().collect::<Vec<_>>(), request.map(Ok));
    let pdu = Pdu::parse(SET_RESPONSE).unwrap();
    assert_eq!(pdu.blocks().collect::<Vec<_>>(), response.map(Ok));
}

#[test]
fn an_identify_response_describes_the_station() {
    let pdu = Pdu::parse(IDENTIFY_RESPONSE).unwrap();
    let none = Ipv4Addr::UNSPECIFIED;
    assert_eq!(
        Station::from_pdu(&pdu),
        Ok(Station {
            name: b"rt-labs-dev",
            type_of_station: b"P-Net Sample Application",
            identity: Some((0x0493, 2)),
            ip: Some(IpSuite { address: none, mask: none, gateway: none }),
            roles: 1,
        })
    );
    // p-net writes 1 into the reserved byte behind the role; we write 0.
    let mut expected = IDENTIFY_RESPONSE.to_vec();
    expected[95] = 0;
    let blocks = pdu.blocks().map(Result::unwrap);
    assert_eq!(emitted(|w| emit(w, pdu.service, pdu.xid, 0, blocks)), expected);
}

#[test]
fn an_identify_request_has_no_block_info_and_may_end_without_padding() {
    let bytes = emitted(|w| {
        emit(w, Service::IdentifyRequest, 7, 1, [Content::NameOfStation(b"abc").into()]);
    });
    assert_eq!(bytes, b"\xFE\xFE\x05\x00\x00\x00\x00\x07\x00\x01\x00\x08\x02\x02\x00\x03abc\x00");
    let mut unpadded = bytes[..bytes.len() - 1].to_vec();
    unpadded[11] = 7;
    let pdu = Pdu::parse(&unpadded).unwrap();
    assert_eq!(pdu.blocks().collect::<Vec<_>>(), [Ok(Content::NameOfStation(b"abc").into())]);

    // The shortest one: 30 bytes with its Ethernet header.
    let all = emitted(|w| emit(w, Service::IdentifyRequest, 7, 1, [Content::All.into()]));
    assert_eq!(all.len(), 16);
    assert_eq!(Pdu::parse(&all).unwrap().blocks().collect::<Vec<_>>(), [Ok(Content::All.into())]);
}

#[test]
fn a_get_request_lists_options() {
    let bytes = emitted(|w| emit_get_request(w, 9, &[Code::IP, Code::NAME_OF_STATION]));
    assert_eq!(bytes, b"\xFE\xFD\x03\x00\x00\x00\x00\x09\x00\x00\x00\x04\x01\x02\x02\x02");
    let pdu = Pdu::parse(&bytes).unwrap();
    assert_eq!(pdu.requested_options().collect::<Vec<_>>(), [Code::IP, Code::NAME_OF_STATION]);
    assert_eq!(pdu.blocks().count(), 0);
}

#[test]
fn a_block_shorter_than_its_block_info_is_an_error_and_one_that_is_cut_ends_the_blocks() {
    let bytes = b"\xFE\xFF\x05\x01\0\0\0\x01\0\0\0\x16\x02\x02\0\x01\0\0\x02\x04\0\x04\0\0\x01\0\x02\x03\0\x06\0\0\0\x01";
    let blocks: Vec<_> = Pdu::parse(bytes).unwrap().blocks().collect();
    let short = Err(Violation::BlockLength { code: Code::NAME_OF_STATION, len: 1 });
    assert_eq!(blocks[..2], [short, Ok(Content::DeviceRole(1).into())]);
    assert!(matches!(blocks[2..], [Err(Violation::Truncated(_))]));
}

#[test]
fn an_ip_address_with_more_or_less_than_its_three_parts_is_none() {
    for len in [11, 13, 14, 16] {
        let value: Vec<u8> = vec![0; len];
        let bytes =
            emitted(|w| emit(w, Service::SetRequest, 1, 0, [Content::Unknown(Code::IP, &value).into()]));
        let blocks: Vec<_> = Pdu::parse(&bytes).unwrap().blocks().collect();
        assert_eq!(blocks, [Err(Violation::BlockLength { code: Code::IP, len: len as u16 + 2 })]);
    }
}

#[test]
fn a_frame_id_that_does_not_fit_the_service_is_refused() {
    let mut bytes = SET_REQUEST.to_vec();
    bytes[1] = 0xFE;
    assert!(matches!(Pdu::parse(&bytes), Err(Violation::Service { frame_id: 0xFEFE, .. })));
}

#[test]
fn a_station_says_which_service_it_does_not_support() {
    for (frame_id, service) in [(0xFEFC, 6), (0xFEFD, 3), (0xFEFE, 5), (0xFEFF, 7)] {
        let not_supported = Service::NotSupported(frame_id, service);
        let bytes = emitted(|w| emit(w, not_supported, 7, 0, []));
        assert_eq!(bytes[..4], [0xFE, frame_id as u8, service, 5]);
        let pdu = Pdu::parse(&bytes).unwrap();
        assert_eq!((pdu.service, pdu.xid, pdu.service.is_request()), (not_supported, 7, false));
    }
    assert!(Pdu::parse(&emitted(|w| emit(w, Service::NotSupported(0xFEFB, 5), 7, 0, []))).is_err());
}

#[test]
fn the_mac_address_determines_the_delay_of_an_answer() {
    let mac = Mac([0, 0, 0, 0, 0x01, 0x05]);
    assert_eq!(response_delay(mac, 0), Duration::ZERO);
    assert_eq!(response_delay(mac, 1), Duration::ZERO);
    assert_eq!(response_delay(mac, 128), Duration::from_millis(50));
}

proptest! {
    #[test]
    fn no_bytes_make_the_parser_panic_or_loop(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let mut framed = vec![0xFE, 0xFF, 5, 1, 0, 0, 0, 1, 0, 0, 0, bytes.len() as u8];
        framed.extend_from_slice(&bytes);
        for candidate in [&framed, &bytes] {
            if let Ok(pdu) = Pdu::parse(candidate) {
                prop_assert!(pdu.blocks().count() <= 50);
                let _ = (Station::from_pdu(&pdu), pdu.requested_options().count());
            }
        }
    }
}
