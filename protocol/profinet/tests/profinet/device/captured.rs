//! The device in p-net's place: a Siemens controller's frames as they were captured, and p-net's answers to compare.

use super::*;
use crate::captured::{self, datagram, frame};

const P_NET_MAC: Mac = Mac([0x8C, 0xF3, 0x19, 0xCD, 0x19, 0xF8]);
const CPU: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(172, 16, 2, 100), 0xD5EE);

fn p_net() -> DeviceRig {
    p_net_with(Some(Ipv4Addr::new(172, 16, 2, 10)))
}

fn p_net_with(address: Option<Ipv4Addr>) -> DeviceRig {
    let config = DeviceConfig {
        mac: P_NET_MAC,
        station_name: b"rt-labs-dev".to_vec(),
        permanent: None,
        address,
        mask: MASK,
        description: samples::P_NET,
        controllers: machine::Allowed::default(),
    };
    DeviceRig::around(Device::new(config, Instant::ZERO))
}

impl DeviceRig {
    fn cpu_sends(&mut self, text: &str) -> Sent {
        self.cpu_sends_datagram(&datagram(text))
    }

    fn cpu_sends_datagram(&mut self, datagram: &[u8]) -> Sent {
        let source = Source { port: Port::Udp(RPC_PORT), peer: Some(CPU) };
        self.device.handle_frame(self.now, source, datagram);
        self.drain()
    }
}

#[test]
fn the_captured_start_up_is_answered_byte_for_byte_as_p_net_did() {
    let mut rig = p_net();
    for (request, response) in
        [(captured::CONNECT_REQ, captured::CONNECT_RES), (captured::WRITE_REQ, captured::WRITE_RES)]
    {
        let sent = rig.cpu_sends(request);
        assert_eq!(sent.len(), 1);
        assert_eq!(sent[0].0.to, Some(CPU));
        assert_eq!(sent[0].1, datagram(response));
    }
    let sent = rig.cpu_sends(captured::PRMEND_REQ);
    let [(_, answer), (call_to, call)] = &sent[..] else {
        panic!("an answer and ApplicationReady: {sent:?}")
    };
    assert_eq!(*answer, datagram(captured::PRMEND_RES));

    assert_eq!(call_to.to, Some(SocketAddrV4::new(*CPU.ip(), RPC_PORT)));
    let theirs = datagram(captured::APPREADY_REQ);
    let differs = |index: &usize| call[*index] != theirs[*index];
    let different: Vec<usize> = (0..theirs.len()).filter(differs).collect();
    // Ours to choose: the activity's UUID, and how long an answer we take (twice).
    let may_differ = |index: &usize| matches!(index, 40..56 | 80..84 | 88..92);
    assert!(different.iter().all(may_differ), "{different:?}");
    assert_eq!(call.len(), theirs.len());

    // The captured confirmation, but for the activity that we chose (which the controller writes little-endian).
    let confirmation = datagram(captured::APPREADY_RES);
    let (ours, _) = Header::parse(call).unwrap();
    let (theirs, body) = Header::parse(&confirmation).unwrap();
    let mut confirmation = vec![0; confirmation.len()];
    Header { activity: ours.activity, ..theirs }.emit(body, &mut confirmation).unwrap();
    assert!(rig.cpu_sends_datagram(&confirmation).is_empty());
    assert_eq!(rig.device.outputs().count(), 0);

    rig.receive(Port::Ethernet, &frame(captured::ECHO_CPU_8001));
    assert_eq!(rig.events(), [LinkEvent::Up]);
    let outputs: Vec<_> = rig.device.outputs().collect();
    let of_slot_4 = [0x12, 0x34, 0x56, 0x78, 0x3F, 0xC0, 0x00, 0x00];
    let expected: [(_, Option<&[u8]>); 3] =
        [((2, 1), Some(&[0x01])), ((3, 1), Some(&[0x00])), ((4, 1), Some(&of_slot_4))];
    assert_eq!(outputs, expected);
}

#[test]
fn the_cyclic_frame_has_every_byte_where_p_net_has_it() {
    let mut rig = p_net();
    rig.cpu_sends(captured::CONNECT_REQ);
    rig.cpu_sends(captured::PRMEND_REQ);
    rig.device.set_input(1, 1, &[0xA4]).unwrap();
    rig.device.set_input(3, 1, &[0xA5]).unwrap();
    rig.device.set_input(4, 1, &[0x12, 0xB4, 0x56, 0x78, 0x7F, 0x80, 0, 0]).unwrap();
    let sent = rig.advance(Duration::from_millis(40));
    let (_, ours) = sent.iter().find(|(transmit, _)| transmit.port == Port::Ethernet).unwrap();
    let mut theirs = frame(captured::ECHO_DEV_8000);
    // The cycle counter is the clock's, and p-net set Backup in this capture.
    let end = theirs.len() - 4;
    theirs[end..].copy_from_slice(&ours[end..]);
    assert_eq!(ours[..6], [0xEC, 0x1C, 0x5D, 0x61, 0xE7, 0x3F]);
    assert_eq!(*ours, theirs);
    assert_eq!(ours[end + 2..], [0x35, 0]);
}

#[test]
fn the_captured_set_of_an_address_is_answered_once_the_owner_has_done_it() {
    let mut rig = p_net_with(None);
    assert!(rig.receive(Port::Ethernet, &frame(captured::DCP_SET_REQ)).is_empty());
    let address = Ipv4Addr::new(172, 16, 2, 10);
    assert_eq!(rig.events(), [LinkEvent::SetAddress { address, mask: MASK, gateway: address }]);
    assert!(rig.receive(Port::Ethernet, &frame(captured::DCP_SET_REQ)).is_empty(), "a repetition waits too");
    rig.device.address_set(rig.now, true);
    let sent = rig.drain();
    let theirs = frame(captured::DCP_SET_RES);
    assert_eq!(sent[0].1[..theirs.len()], theirs);
    assert_eq!(sent[0].1.len(), 60);
}

#[test]
fn the_captured_read_of_im0_is_answered_as_p_net_did_but_for_its_profile() {
    let mut connect = datagram(captured::CONNECT_REQ);
    let mut rig = p_net();
    // The capture is from another day: another AR.
    let read = datagram(captured::IM0_READ_REQ);
    connect[108..124].copy_from_slice(&read[108..124]);
    rig.cpu_sends_datagram(&connect);
    let sent = rig.cpu_sends_datagram(&read);
    let (ours, theirs) = (&sent[0].1, datagram(captured::IM0_READ_RES));
    assert_eq!(ours.len(), theirs.len());
    // Revision counter, profile, type and I&M1 to 4 are p-net's own; and it counts its hardware from 3.
    let until = theirs.len() - 10;
    assert_eq!(ours[..until], theirs[..until]);
}
