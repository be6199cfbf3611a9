use std::net::SocketAddrV4;

use ethernet_ip::encapsulation::{Command, Header as EncapsulationHeader};
use machine::arp::Operation as ArpOperation;
use machine::wire::{BigEndian, Writer};
use profinet::Uuid;
use profinet::description::Identity;
use profinet::record::ReadResponse;
use profinet::rpc::RequestArgs;
use profinet::status::Status;

use super::*;

const PLC: Mac = Mac([2, 0, 0, 0, 0, 1]);
const ROBOT: Mac = Mac([2, 0, 0, 0, 0, 2]);
const ROBOT_IP: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 2);

fn packet<'a>((source, destination): (Mac, Mac), payload: Payload<'a>) -> EthernetPacket<'a> {
    EthernetPacket { source, destination, payload }
}

fn written(write: impl FnOnce(&mut Writer<'_, BigEndian>)) -> Vec<u8> {
    let mut buf = [0; 512];
    let mut writer = Writer::new(&mut buf);
    write(&mut writer);
    let len = writer.finish().unwrap();
    buf[..len].to_vec()
}

fn of_robot(seen: &SeenStations) -> (Option<String>, Option<String>) {
    let by_mac = seen.traits_of(EndAddress::Mac(ROBOT), None, None);
    (by_mac.name, by_mac.identity)
}

fn some(text: &str) -> Option<String> {
    Some(text.to_owned())
}

/// Returns the answer to a Read of the device's I&M0.
fn version_answer() -> Vec<u8> {
    version_answer_of((0, 1), b"6ES7 517-3AP00-0AB0 ")
}

/// Returns the answer to a Read of I&M0 at a slot and subslot, with this order number.
fn version_answer_of((slot, subslot): (u16, u16), order_number: &[u8; 20]) -> Vec<u8> {
    let im0 = written(|w| {
        w.bytes(&[0, 0x20, 0, 56, 1, 0, 0x00, 0x2A]);
        w.bytes(order_number);
        w.bytes(b"S C-1234        ");
        w.bytes(&[0, 5, b'V', 3, 1, 2]);
        w.bytes(&[0; 16]);
    });
    let address = Address {
        sequence: 1,
        ar: Uuid::NIL,
        api: 0,
        slot,
        subslot,
        index: index::IDENTIFICATION_AND_MAINTENANCE_0,
    };
    let identity = Identity { vendor: 0x2A, device: 1 };
    let object = profinet::rpc::object(1, identity);
    let mut header = Header::request(Operation::ReadImplicit, object, DEVICE_INTERFACE, Uuid([1; 16]), 0);
    header.kind = Kind::Response;
    let mut body = [0; 512];
    let len = ResponseArgs::emit(Status::OK, 1_000, &mut body, |w| {
        ReadResponse { address, record: &im0 }.emit(w);
    });
    let mut buf = [0; 1_000];
    let len = header.emit(&body[..len.unwrap()], &mut buf).unwrap();
    buf[..len].to_vec()
}

#[test]
fn a_robot_is_named_by_dcp_lldp_arp_and_its_version_whatever_comes_first() {
    let dcp = written(|w| {
        let device_id = Content::DeviceId { vendor: 0x0493, device: 7 };
        dcp::emit(
            w,
            Service::IdentifyResponse,
            1,
            0,
            [Content::NameOfStation(b"kuka-7").into(), device_id.into()],
        );
    });
    let lldp = written(|w| {
        let port = lldp::Id { subtype: LOCALLY_ASSIGNED, value: b"port-001.kuka-7" };
        let chassis = lldp::Id { subtype: 4, value: &[2, 0, 0, 0, 0, 2] };
        let mut pdu = lldp::Pdu::new(chassis, port, 20);
        (pdu.chassis_mac, pdu.system_description) = (Some(ROBOT), Some(&b"KR C5   micro"[..]));
        pdu.emit(w);
    });
    let arp = written(|w| {
        ArpPacket {
            operation: ArpOperation::Request,
            sender_mac: ROBOT,
            sender_address: ROBOT_IP,
            target_mac: Mac([0; 6]),
            target_address: Ipv4Addr::new(10, 0, 0, 1),
        }
        .emit(w);
    });
    let version = version_answer();
    let from = SocketAddrV4::new(ROBOT_IP, 49_152);
    let to = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 1), 49_153);
    let all = [
        Payload::Profinet(&dcp),
        Payload::Lldp(&lldp),
        Payload::Arp(&arp),
        Payload::Udp { from, to, data: &version },
    ];
    let expected = "vendor 0x0493, device 0x0007, vendor 0x002A, order number `6ES7 517-3AP00-0AB0`, serial number `S C-1234`, \
                    hardware 5, firmware V3.1.2";
    for first in 0..all.len() {
        let mut seen = SeenStations::default();
        for at in 0..all.len() {
            seen.read(&packet((ROBOT, PLC), all[(first + at) % all.len()]));
        }
        assert_eq!(of_robot(&seen), (some("kuka-7"), some(expected)), "beginning with {first}");
        let by_ip = seen.traits_of(EndAddress::Ip(ROBOT_IP), Some(ROBOT), None);
        assert_eq!(by_ip.name, some("kuka-7"));
        assert_eq!(seen.traits_of(EndAddress::Mac(PLC), None, None), PeerTraits::default());
    }
    let mut seen = SeenStations::default();
    seen.read(&packet((ROBOT, PLC), Payload::Lldp(&lldp)));
    assert_eq!(of_robot(&seen), (some("kuka-7"), some("KR C5 micro")));
}

#[test]
fn the_version_of_a_device_is_that_of_its_access_point_and_not_of_a_module() {
    let from = SocketAddrV4::new(ROBOT_IP, 49_152);
    let device = [(0, 1), (0, 0x8000)].map(|place| version_answer_of(place, b"ROBOT CONTROLLER    "));
    let modules =
        [(1, 1), (0, 2), (5, 0x8000)].map(|place| version_answer_of(place, b"DIGITAL INPUTS      "));
    for of_device in &device {
        for of_module in &modules {
            for answers in [[of_device, of_module], [of_module, of_device]] {
                let mut seen = SeenStations::default();
                for data in answers {
                    seen.read(&packet((ROBOT, PLC), Payload::Udp { from, to: from, data }));
                }
                let identity = of_robot(&seen).1.unwrap();
                assert!(identity.contains("`ROBOT CONTROLLER`"), "{identity}");
            }
        }
    }
}

#[test]
fn vendor_and_device_of_the_connection_stand_before_a_description_that_lacks_them() {
    let lldp = written(|w| {
        let port = lldp::Id { subtype: LOCALLY_ASSIGNED, value: b"port-001.kuka-7" };
        let chassis = lldp::Id { subtype: 4, value: &[2, 0, 0, 0, 0, 2] };
        let mut pdu = lldp::Pdu::new(chassis, port, 20);
        (pdu.chassis_mac, pdu.system_description) = (Some(ROBOT), Some(&b"KR C5 micro"[..]));
        pdu.emit(w);
    });
    let mut seen = SeenStations::default();
    let of_connection = || some("vendor 0x0493, device 0x0007");
    let identity =
        |seen: &SeenStations| seen.traits_of(EndAddress::Mac(ROBOT), None, of_connection()).identity.unwrap();
    assert_eq!(identity(&seen), "vendor 0x0493, device 0x0007");
    seen.read(&packet((ROBOT, PLC), Payload::Lldp(&lldp)));
    assert_eq!(identity(&seen), "vendor 0x0493, device 0x0007, KR C5 micro");
    let dcp = written(|w| {
        let device_id = Content::DeviceId { vendor: 0x0493, device: 8 };
        dcp::emit(w, Service::IdentifyResponse, 1, 0, [device_id.into()]);
    });
    seen.read(&packet((ROBOT, PLC), Payload::Profinet(&dcp)));
    assert_eq!(identity(&seen), "vendor 0x0493, device 0x0008, KR C5 micro");
}

#[test]
fn a_name_that_is_set_belongs_to_the_station_that_gets_it() {
    let set = written(|w| {
        dcp::emit(w, Service::SetRequest, 1, 0, [Content::NameOfStation(b"left-arm").into()]);
    });
    let mut seen = SeenStations::default();
    seen.read(&packet((PLC, ROBOT), Payload::Profinet(&set)));
    assert_eq!(of_robot(&seen).0, some("left-arm"));
    assert_eq!(seen.traits_of(EndAddress::Mac(PLC), None, None), PeerTraits::default());
}

#[test]
fn an_adapter_is_named_by_its_answer_to_list_identity() {
    let mut buf = [0; 256];
    let len = EncapsulationHeader::request(Command::ListIdentity, 0).emit(&mut buf, |w| {
        w.u16(1);
        w.u16(0x000C);
        w.u16(37);
        w.u16(1);
        w.bytes(&[0; 16]);
        w.bytes(b"\x58\0\x2B\0\x02\0\x03\x04\0\0\x78\x56\x34\x12\x03IRC\x03");
    });
    let data = &buf[..len.unwrap()];
    let from = SocketAddrV4::new(ROBOT_IP, ENCAPSULATION_PORT);
    let to = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 1), 50_000);
    let mut seen = SeenStations::default();
    seen.read(&packet((ROBOT, PLC), Payload::Udp { from, to, data }));
    let found = seen.traits_of(EndAddress::Ip(ROBOT_IP), None, None);
    assert_eq!(found.name, some("IRC"));
    let expected = "vendor 0x0058, device type 0x2B, product code 2, revision 3.4, serial number 0x12345678";
    assert_eq!(found.identity, some(expected));
}

#[test]
fn cut_and_endless_strangers_change_nothing_and_take_a_bounded_memory() {
    let version = version_answer();
    let from = SocketAddrV4::new(ROBOT_IP, 49_152);
    let mut seen = SeenStations::default();
    for cut in 0..version.len() {
        seen.read(&packet((ROBOT, PLC), Payload::Udp { from, to: from, data: &version[..cut] }));
        seen.read(&packet((ROBOT, PLC), Payload::Profinet(&version[..cut])));
        seen.read(&packet((ROBOT, PLC), Payload::Lldp(&version[..cut])));
    }
    assert_eq!(of_robot(&seen), (None, None));
    for station in 0..2_000_u16 {
        let [high, low] = station.to_be_bytes();
        let arp = written(|w| {
            ArpPacket {
                operation: ArpOperation::Request,
                sender_mac: Mac([2, 9, 9, 9, high, low]),
                sender_address: ROBOT_IP,
                target_mac: Mac([0; 6]),
                target_address: ROBOT_IP,
            }
            .emit(w);
        });
        seen.read(&packet((ROBOT, PLC), Payload::Arp(&arp)));
    }
    assert!(seen.stations.len() <= MAX_STATIONS, "{}", seen.stations.len());
    // A request is not an answer.
    let mut header = Header::request(
        Operation::ReadImplicit,
        profinet::rpc::object(1, Identity { vendor: 1, device: 1 }),
        DEVICE_INTERFACE,
        Uuid([1; 16]),
        0,
    );
    header.serial = 1;
    let mut body = [0; 64];
    let len = RequestArgs::emit(100, &mut body, |_| {}).unwrap();
    let mut buf = [0; 256];
    let len = header.emit(&body[..len], &mut buf).unwrap();
    assert_eq!(identification(&header, &body), None);
    seen.read(&packet((ROBOT, PLC), Payload::Udp { from, to: from, data: &buf[..len] }));
}
