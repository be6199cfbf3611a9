//! LLDP: what the device tells its neighbour, as tshark reads it, and what it does with what the neighbour tells.

use profinet::dcp::{Content, IpSuite, Pdu as Dcp};
use profinet::lldp::{self, Id, Pdu};
use profinet::record::{Address, WriteRequest};
use profinet::{Parameter, dcp};

use super::discovery::{identify, request, set};
use super::dissected::assert_records;
use super::*;
use crate::tshark;

const NEIGHBOUR: Mac = Mac([2, 0, 0, 0, 0, 9]);

/// Lets time pass; returns what is announced meanwhile, with its ms.
fn announced(rig: &mut DeviceRig, by: Duration) -> Vec<(u128, Vec<u8>)> {
    rig.announced.clear();
    rig.advance(by);
    let ms = |at: Instant| at.since(Instant::ZERO).as_millis();
    rig.announced.drain(..).map(|(at, frame)| (ms(at), frame)).collect()
}

/// Returns what the device has announced last. It must have.
fn last(rig: &mut DeviceRig) -> Vec<u8> {
    rig.advance(Duration::ZERO);
    rig.announced.drain(..).next_back().expect("an announcement").1
}

fn named(value: &[u8]) -> Id<'_> {
    Id { subtype: 7, value }
}

/// Gives the device an announcement of the port 2 of this station.
fn hear(rig: &mut DeviceRig, station: &[u8], ttl: u16) -> Sent {
    let pdu = Pdu { chassis_mac: Some(NEIGHBOUR), ..Pdu::new(named(station), named(b"port-002"), ttl) };
    let header = EthernetHeader {
        destination: lldp::MULTICAST,
        source: NEIGHBOUR,
        tag: None,
        ether_type: lldp::ETHER_TYPE,
    };
    let mut buf = [0; 1500];
    let len = header.emit(&mut buf, |w| pdu.emit(w)).unwrap();
    rig.receive(Port::Ethernet, &buf[..len])
}

fn write_interface_adjust(rig: &mut DeviceRig) -> Status {
    let Parameter { slot, subslot, index, data } = Parameter::interface_adjust();
    let address = Address { sequence: 0, ar: AR, api: 0, slot, subslot, index };
    rig.call(Operation::Write, &emitted(|w| WriteRequest { address, record: &data }.emit(w))).0
}

/// What every announcement of the sample device has.
const SYSTEM: &str = "sample device             sample-device        1                    1 V  0  1  0";

#[test]
fn an_announcement_is_read_by_a_dissector_field_by_field() {
    let fields = [
        "eth.dst",
        "eth.src",
        "lldp.tlv.type",
        "lldp.chassis.subtype",
        "lldp.chassis.id",
        "lldp.chassis.id.mac",
        "lldp.port.subtype",
        "lldp.port.id",
        "lldp.time_to_live",
        "lldp.tlv.system.name",
        "lldp.tlv.system.desc",
        "lldp.mgn.addr.ip4",
        "lldp.orgtlv.oui",
        "lldp.profinet.subtype",
        "lldp.profinet.port_rx_delay_local",
        "lldp.profinet.cable_delay_local",
        "lldp.profinet.rtc2_port_status",
        "lldp.profinet.rtc3_port_status",
        "lldp.profinet.cm_mac_add",
        "lldp.ieee.802_3.subtype",
        "lldp.ieee.802_3.mac_phy_auto_neg_status",
        "lldp.ieee.802_3.pmd_mau_type",
    ];
    let named = last(&mut DeviceRig::new());
    let unnamed = last(&mut DeviceRig::around(device_named(b"")));
    let mut rig = DeviceRig::connected(RtClass::Class1);
    assert_eq!(write_interface_adjust(&mut rig), Status::OK);
    let of_device = last(&mut rig);
    let found = tshark::dissected(&[named, unnamed, of_device], &fields);

    // tshark prints what is locally assigned as digits.
    let hex = |name: &str| name.bytes().map(|byte| format!("{byte:02x}")).collect::<String>();
    let (name, kind) = (hex("device"), hex(SYSTEM));
    let ends = |name: &'static str| {
        let text = [name, SYSTEM, "192.168.64.2"];
        let organizations =
            ["3791,3791,3791,4623", "0x01,0x02,0x05", "0", "0", "0x0000", "0x0000", "02:00:00:00:00:02"];
        [&text[..], &organizations, &["0x01", "0x00", "0x0000"]].concat()
    };
    let heads = ["01:80:c2:00:00:0e", "02:00:00:00:00:02"];
    let (with, without) = ("1,2,3,5,6,8,127,127,127,127,0", "1,2,3,6,8,127,127,127,127,0");
    let wanted = [
        [&heads[..], &[with, "7", &name, "", "7", "port-001", "20"], &ends("device")].concat(),
        [&heads[..], &[without, "4", "", "02:00:00:00:00:02", "7", "port-001", "20"], &ends("")].concat(),
        [&heads[..], &[with, "7", &kind, "", "7", "port-001.device", "20"], &ends("device")].concat(),
    ];
    for (found, wanted) in found.iter().zip(wanted) {
        let (values, faults) = found.split_at(fields.len());
        assert_eq!(values, wanted);
        assert!(faults.iter().all(String::is_empty), "{faults:?}");
    }
    assert_eq!(found.len(), 3);
}

#[test]
fn it_announces_itself_every_five_seconds_while_data_go_or_not() {
    let mut rig = DeviceRig::new();
    let times: Vec<_> = announced(&mut rig, Duration::from_secs(21)).iter().map(|(ms, _)| *ms).collect();
    assert_eq!(times, [10, 5_010, 10_010, 15_010, 20_010]);
}

#[test]
fn a_new_name_a_new_address_and_another_kind_of_name_are_announced_at_once() {
    let mut rig = DeviceRig::new();
    last(&mut rig);
    let chassis = |frame: &[u8]| {
        let (_, payload) = EthernetHeader::parse(frame).unwrap();
        let pdu = Pdu::parse(payload).unwrap();
        (pdu.chassis.value.to_vec(), pdu.management_address)
    };
    rig.receive(Port::Ethernet, &set([Content::Signal(0x0100)]));
    assert_eq!(announced(&mut rig, Duration::from_millis(500)), [], "nothing changed");

    rig.receive(Port::Ethernet, &set([Content::NameOfStation(b"other")]));
    assert_eq!(chassis(&last(&mut rig)), (b"other".to_vec(), Some(ADDRESS)));

    let address = Ipv4Addr::new(192, 168, 64, 77);
    rig.receive(Port::Ethernet, &set([Content::Ip(IpSuite { address, mask: MASK, gateway: address })]));
    assert!(rig.announced.is_empty(), "the owner has not set it yet");
    rig.device.address_set(rig.now, true);
    rig.drain();
    assert_eq!(chassis(&last(&mut rig)), (b"other".to_vec(), Some(address)));

    let mut rig = DeviceRig::connected(RtClass::Udp);
    rig.announced.clear();
    write_interface_adjust(&mut rig);
    assert_eq!(chassis(&last(&mut rig)).0, SYSTEM.as_bytes());
    write_interface_adjust(&mut rig);
    assert!(rig.announced.is_empty(), "the same again");
    rig.device.disconnect(rig.now);
    rig.drain();
    assert_eq!(chassis(&last(&mut rig)).0, b"device", "what the controller wrote ends with its AR");
}

#[test]
fn it_is_found_by_the_name_of_its_neighbours_port() {
    let mut rig = DeviceRig::new();
    let alias = Content::AliasName(b"port-002.plc");
    assert!(rig.receive(Port::Ethernet, &identify([alias])).is_empty(), "no neighbour yet");
    assert!(hear(&mut rig, b"plc", 20).is_empty());
    assert!(rig.receive(Port::Ethernet, &identify([Content::AliasName(b"port-001.plc")])).is_empty());
    let contents = |sent: &Sent| -> Vec<String> {
        let [(_, frame)] = &sent[..] else { panic!("one answer: {sent:?}") };
        let (_, payload) = EthernetHeader::parse(frame).unwrap();
        let pdu = Dcp::parse(payload).unwrap();
        pdu.blocks().map(|block| format!("{:?}", block.unwrap().content)).collect()
    };
    let expected = format!("{alias:?}");
    let by_alias = contents(&rig.receive(Port::Ethernet, &identify([alias])));
    assert_eq!(by_alias.last(), Some(&expected));
    // Only who asked by the alias reads it in the answer.
    assert!(!contents(&rig.receive(Port::Ethernet, &identify([Content::All]))).contains(&expected));
    let get = request(MAC, |w| dcp::emit_get_request(w, 9, &[dcp::Code::ALIAS_NAME]));
    assert_eq!(contents(&rig.receive(Port::Ethernet, &get)), [expected]);

    hear(&mut rig, b"plc", 0);
    let error = dcp::BlockError::SuboptionNotSupported;
    let none = Content::Response { code: dcp::Code::ALIAS_NAME, error };
    assert_eq!(contents(&rig.receive(Port::Ethernet, &get)), [format!("{none:?}")]);
}

#[test]
fn a_get_is_answered_by_what_was_so_when_it_came() {
    let mut rig = DeviceRig::new();
    let get = request(MAC, |w| dcp::emit_get_request(w, 9, &[dcp::Code::ALIAS_NAME]));
    rig.device.handle_frame(rig.now, Source { port: Port::Ethernet, peer: None }, &get);
    let error = dcp::BlockError::SuboptionNotSupported;
    let sent = hear(&mut rig, b"plc", 20);
    assert_eq!(discovery::results(&sent), [(dcp::Code::ALIAS_NAME, error)]);
}

#[test]
fn the_records_of_the_port_name_the_neighbour_as_long_as_it_is_heard() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let fields = [
        "pn_io.block_type",
        "pn_io.number_of_peers",
        "pn_io.peer_port_id",
        "pn_io.peer_chassis_id",
        "pn_io.line_delay_value",
        "pn_io.peer_macadd",
        "pn_io.mau_type",
        "pn_io.link_state_link",
    ];
    let peer = ["1", "port-002", "plc", "0", "02:00:00:00:00:09", "0x0000", "0x01"];
    let none = ["0", "", "", "", "", "0x0000", "0x01"];
    let (port, all) = ("0x8009,0x020f", "0x8009,0x0400,0x0240,0x0400,0x020f");
    let row = |block_type, values: [&'static str; 7]| [&[block_type][..], &values].concat();
    for (ttl, values) in [(20, peer), (0, none)] {
        hear(&mut rig, b"plc", ttl);
        let (port, all) = (row(port, values), row(all, values));
        assert_records(&mut rig, &fields, &[(0x802A, 0, 0x8001, &port), (0xF841, 0, 0, &all)]);
        let known = rig.device.neighbour().map(|neighbour| neighbour.alias().to_vec());
        assert_eq!(known, (ttl > 0).then(|| b"port-002.plc".to_vec()));
    }
}

#[test]
fn a_neighbour_that_is_not_heard_for_its_time_is_forgotten() {
    let mut rig = DeviceRig::new();
    hear(&mut rig, b"plc", 7);
    announced(&mut rig, Duration::from_millis(6_999));
    assert!(rig.device.neighbour().is_some());
    announced(&mut rig, Duration::from_millis(1));
    assert!(rig.device.neighbour().is_none());
}

#[test]
fn a_malformed_announcement_is_counted_and_one_of_a_third_station_ignored() {
    let mut rig = DeviceRig::new();
    let header = EthernetHeader {
        destination: lldp::MULTICAST,
        source: CONTROLLER_MAC,
        tag: None,
        ether_type: lldp::ETHER_TYPE,
    };
    let mut buf = [0; 100];
    let len = header.emit(&mut buf, |w| w.bytes(&[0x02, 0x07, 7])).unwrap();
    rig.receive(Port::Ethernet, &buf[..len]);
    assert_eq!((rig.device.counters().malformed, rig.device.counters().foreign), (1, 0));
    hear(&mut rig, b"plc", 20);
    let third = Pdu::new(named(b"third"), named(b"port-001"), 20);
    let len = header.emit(&mut buf, |w| third.emit(w)).unwrap();
    rig.receive(Port::Ethernet, &buf[..len]);
    assert_eq!((rig.device.counters().malformed, rig.device.counters().foreign), (1, 0));
    assert_eq!(rig.device.neighbour().map(|neighbour| neighbour.station_name()), Some(&b"plc"[..]));
}
