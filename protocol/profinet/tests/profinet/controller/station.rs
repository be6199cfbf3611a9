//! The controller as a station of DCP: it can be found and read, and not be set.

use machine::ethernet::EthernetHeader;
use profinet::ETHER_TYPE;
use profinet::dcp::{BlockError, Code, Content, IpSuite, Pdu, Service, emit};

use super::*;

#[test]
fn whatever_is_set_is_not_possible_also_if_its_length_is_wrong() {
    let address = Ipv4Addr::new(192, 168, 64, 9);
    let suite = IpSuite { address, mask: Ipv4Addr::new(255, 255, 255, 0), gateway: address };
    let blocks = [
        Content::Unknown(Code::IP, &[10, 0, 0, 1]),
        Content::Ip(suite),
        Content::NameOfStation(b"other"),
        Content::FactoryReset,
    ];
    let header =
        EthernetHeader { destination: CONTROLLER, source: DEVICE, tag: None, ether_type: ETHER_TYPE };
    let mut buf = [0; FRAME_CAPACITY];
    let len = header
        .emit(&mut buf, |w| emit(w, Service::SetRequest, 8, 0, blocks.into_iter().map(Into::into)))
        .unwrap();
    let mut controller = controller();
    controller.handle_frame(Instant::ZERO, Source { port: Port::Ethernet, peer: None }, &buf[..len]);
    let sent = core::iter::from_fn(|| {
        let transmit = controller.poll_transmit(Instant::ZERO, &mut buf)?;
        Some((transmit.port, buf[..transmit.len].to_vec()))
    });
    let answers: Vec<_> =
        sent.filter(|(port, frame)| !is_lldp(*port, frame) && !is_arp(*port, frame)).collect();
    let [(_, answer)] = &answers[..] else { panic!("one answer: {answers:?}") };
    let (_, payload) = EthernetHeader::parse(answer).unwrap();
    let results: Vec<_> = Pdu::parse(payload).unwrap().blocks().map(|block| block.unwrap().content).collect();
    let refused = |code| Content::Response { code, error: BlockError::NotPossible };
    assert_eq!(results, [Code::IP, Code::IP, Code::NAME_OF_STATION, Code::FACTORY_RESET].map(refused));
}
