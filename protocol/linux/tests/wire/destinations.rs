//! Which frames a raw port receives, by their destination address.

use machine::PortRequest;
use machine::ethernet::Mac;
use protocol_linux::{Interface, OpenPort, Received};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::test_network::{TIMEOUT, TestNetwork};

const ETHER_TYPE: u16 = 0x88A4;
const BROADCAST: Mac = Mac([0xFF; 6]);
/// The group that Beckhoff's MainDevice sends to.
const GROUP: Mac = Mac([0x01, 0x01, 0x05, 0x01, 0x00, 0x00]);
const STRANGER: Mac = Mac([0x02, 0, 0, 0, 0, 0x77]);
const VLAN_5: [u8; 4] = [0x81, 0x00, 0x00, 0x05];
/// Payload of the last frame of each test.
const END: u8 = 0xEE;

fn frame(destination: Mac, tag: &[u8], mark: u8) -> Vec<u8> {
    let head = [&destination.0[..], &[0x02, 0, 0, 0, 0, 1], tag, &ETHER_TYPE.to_be_bytes()].concat();
    [head, vec![mark; 46]].concat()
}

/// Sends a frame for each destination and tag, and one to broadcast; returns which of the former the port receives.
fn received(request: PortRequest, sent: &[(Mac, &[u8])]) -> Vec<usize> {
    received_of(&TestNetwork::new(), request, sent)
}

fn received_of(network: &TestNetwork, request: PortRequest, sent: &[(Mac, &[u8])]) -> Vec<usize> {
    let port = network.run(1, |interface| OpenPort::open(interface, request).unwrap());
    network.run(0, |interface: &Interface| {
        let sender = OpenPort::open(interface, PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[] });
        let sender = sender.unwrap();
        for (mark, (destination, tag)) in (0..).zip(sent) {
            sender.send(&frame(*destination, tag, mark), None, 0).unwrap();
        }
        sender.send(&frame(BROADCAST, &[], END), None, 0).unwrap();
    });
    let (mut marks, mut buf) = (Vec::new(), [0; 1_600]);
    loop {
        let limit = Timespec::try_from(TIMEOUT).unwrap();
        assert_eq!(poll(&mut [PollFd::new(&port, PollFlags::IN)], Some(&limit)).unwrap(), 1, "{marks:?}");
        match port.receive(&mut buf).unwrap() {
            Received::Frame { len, .. } if buf[len - 1] == END => return marks,
            Received::Frame { len, .. } => marks.push(buf[len - 1].into()),
            Received::Discarded => {}
        }
    }
}

pub(super) fn a_port_for_any_address_receives_frames_to_groups_and_to_other_stations() {
    let any = PortRequest::AnyEthernet { ether_type: ETHER_TYPE };
    let sent: [(Mac, &[u8]); 4] =
        [(BROADCAST, &[]), (GROUP, &[]), (STRANGER, &[]), (GROUP, &[0x81, 0, 0xC0, 0])];
    assert_eq!(received(any, &sent), [0, 1, 2, 3]);
    let network = TestNetwork::new();
    let own = network.run(1, Interface::mac);
    assert_eq!(received_of(&network, any, &[(own, &[])]), [0]);
}

pub(super) fn a_port_for_any_address_receives_no_broadcast_of_another_vlan() {
    let any = PortRequest::AnyEthernet { ether_type: ETHER_TYPE };
    assert_eq!(received(any, &[(BROADCAST, &VLAN_5), (GROUP, &VLAN_5), (STRANGER, &[])]), [2]);
}

pub(super) fn a_port_for_its_own_address_receives_no_frames_to_others_beside_one_for_any_address() {
    let network = TestNetwork::new();
    let any = PortRequest::AnyEthernet { ether_type: ETHER_TYPE };
    let _promiscuous = network.run(1, |interface| OpenPort::open(interface, any).unwrap());
    let ours = PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[] };
    assert_eq!(received_of(&network, ours, &[(GROUP, &[]), (STRANGER, &[]), (BROADCAST, &[])]), [2]);
}
