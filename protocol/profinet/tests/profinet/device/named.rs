//! DCP: by what else the device is found, what it tells of itself, and what it does while its owner sets and stores.

use profinet::Permanent;
use profinet::dcp::{
    self, Block, BlockError, Code, Content, IpSuite, Pdu, Service as Dcp, emit, emit_get_request,
};
use profinet::record::Maintenance;

use super::discovery::{identify, request, results};
use super::permanent::{own, set, with};
use super::*;

const FOR_NOW: u16 = 0;
const PERMANENTLY: u16 = 1;

const fn suite(last: u8) -> IpSuite {
    let address = Ipv4Addr::new(192, 168, 64, last);
    IpSuite { address, mask: MASK, gateway: address }
}

#[test]
fn it_is_found_by_everything_that_it_tells_of_itself() {
    let options = [1, 1, 1, 2, 2, 1, 2, 2, 2, 3, 2, 4, 2, 5, 2, 6, 2, 7, 5, 1, 5, 2, 5, 3, 5, 5, 5, 6];
    let gateway = Ipv4Addr::new(192, 168, 64, 1);
    let mut rig = DeviceRig::new();
    for (content, is_found) in [
        (Content::TypeOfStation(b"sample device"), true),
        (Content::TypeOfStation(b"sample"), false),
        (Content::DeviceOptions(&options), true),
        (Content::DeviceOptions(&options[..26]), false),
        (Content::MacAddress(MAC), true),
        (Content::MacAddress(CONTROLLER_MAC), false),
        (Content::Ip(suite(2)), true),
        (Content::Ip(IpSuite { gateway, ..suite(2) }), false),
        (Content::Signal(0x0100), false),
    ] {
        let foreign = rig.device.counters().foreign;
        let sent = rig.receive(Port::Ethernet, &identify([content]));
        assert_eq!(sent.len(), usize::from(is_found), "{content:?}");
        assert_eq!(rig.device.counters().foreign - foreign, u64::from(!is_found));
    }
}

fn get(rig: &mut DeviceRig, code: Code) -> (u16, String) {
    let sent = rig.receive(Port::Ethernet, &request(MAC, |w| emit_get_request(w, 9, &[code])));
    let (_, payload) = EthernetHeader::parse(&sent[0].1).unwrap();
    let block = Pdu::parse(payload).unwrap().blocks().next().unwrap().unwrap();
    (block.qualifier, format!("{:?}", block.content))
}

#[test]
fn it_tells_its_mac_address_and_whether_it_has_an_ip_address() {
    let mut rig = DeviceRig::new();
    assert_eq!(get(&mut rig, Code::MAC_ADDRESS), (0, format!("{:?}", Content::MacAddress(MAC))));
    assert_eq!(get(&mut rig, Code::IP), (1, format!("{:?}", Content::Ip(suite(2)))));
    let none = Ipv4Addr::UNSPECIFIED;
    let none = IpSuite { address: none, mask: none, gateway: none };
    assert_eq!(get(&mut with(None), Code::IP), (0, format!("{:?}", Content::Ip(none))));
}

#[test]
fn a_get_or_set_to_a_group_is_for_nobody() {
    let mut rig = DeviceRig::new();
    let to_all = dcp::IDENTIFY_MULTICAST;
    let name = || [Content::NameOfStation(b"other").into()];
    for frame in [
        request(to_all, |w| emit_get_request(w, 9, &[Code::NAME_OF_STATION])),
        request(to_all, |w| emit(w, Dcp::SetRequest, 8, 0, name())),
    ] {
        assert!(rig.receive(Port::Ethernet, &frame).is_empty());
    }
    assert_eq!((rig.device.counters().foreign, rig.device.station_name()), (2, &b"device"[..]));
}

#[test]
fn an_owner_that_cannot_set_the_address_spoils_the_result_of_the_address_alone() {
    let mut rig = DeviceRig::new();
    assert!(
        set(&mut rig, &[(FOR_NOW, Content::NameOfStation(b"a")), (FOR_NOW, Content::Ip(suite(3)))])
            .is_empty()
    );
    rig.device.address_set(rig.now, false);
    let wanted = [(Code::NAME_OF_STATION, BlockError::None), (Code::IP, BlockError::NotPossible)];
    assert_eq!(results(&rig.drain()), wanted);
    assert_eq!(rig.device.station_name(), b"a");
}

#[test]
fn the_owner_has_3_s_for_each_step() {
    let storage = || with(Some(Permanent { address: Some(suite(2)), ..Permanent::default() }));
    let set_address = [(PERMANENTLY, Content::Ip(suite(3)))];
    let done = [(Code::IP, BlockError::None)];
    let nearly = Duration::from_millis(2_999);

    let mut rig = storage();
    assert!(set(&mut rig, &set_address).is_empty());
    rig.advance(nearly);
    rig.device.address_set(rig.now, true);
    assert!(rig.drain().is_empty(), "it must be stored, too");
    rig.advance(nearly);
    rig.device.stored(rig.now, true);
    assert_eq!(results(&rig.drain()), done);

    let mut rig = storage();
    set(&mut rig, &set_address);
    rig.advance(Duration::from_secs(3));
    rig.device.address_set(rig.now, true);
    assert!(rig.drain().is_empty(), "too late");
    assert_eq!(get(&mut rig, Code::IP).1, format!("{:?}", Content::Ip(suite(2))));
}

#[test]
fn what_was_set_permanently_is_stored_again_with_all_that_is_stored_later() {
    let blocks =
        |qualifier| [(qualifier, Content::NameOfStation(b"robot")), (qualifier, Content::Ip(suite(7)))];
    let mut rig = with(Some(Permanent::default()));
    set(&mut rig, &blocks(PERMANENTLY));
    own(&mut rig, Permanent::default(), true);
    assert_eq!(rig.device.to_store(), (Some(&b"robot"[..]), Some(suite(7)), None));
    set(&mut rig, &blocks(FOR_NOW));
    own(&mut rig, Permanent::default(), true);
    assert_eq!(rig.device.to_store(), (None, None, None));
    assert_eq!(rig.device.station_name(), b"robot");
}

#[test]
fn a_reset_asks_the_owner_to_store_only_if_something_is_stored() {
    let written = Maintenance { signature: [7; 54], ..Maintenance::default() };
    for (maintenance, events) in [(Some(written), vec![LinkEvent::Store]), (None, vec![])] {
        let mut rig = with(Some(Permanent { maintenance, ..Permanent::default() }));
        let sent = set(&mut rig, &[(0, Content::FactoryReset)]);
        assert_eq!(sent.is_empty(), maintenance.is_some(), "the answer waits for the owner");
        assert_eq!(rig.events(), events);
        rig.device.stored(rig.now, true);
        assert_eq!(rig.device.to_store(), (None, None, None));
    }
}

#[test]
fn a_connection_goes_on_when_what_the_device_is_called_and_where_is_only_stored() {
    let stored = || Permanent { address: Some(suite(2)), ..Permanent::default() };
    for (permanent, content) in [
        (Permanent::default(), Content::NameOfStation(b"factory")),
        (Permanent { name: Some(b"robot".to_vec()), ..stored() }, Content::NameOfStation(b"other")),
        (stored(), Content::NameOfStation(b"factory")),
    ] {
        let renames = content == Content::NameOfStation(b"other");
        let mut rig = with(Some(permanent));
        assert!(set(&mut rig, &[(PERMANENTLY, content)]).is_empty());
        assert_eq!(rig.events(), [LinkEvent::Store]);
        rig.establish(&connect_request(RtClass::Class1, true));
        rig.device.stored(rig.now, true);
        assert_eq!(rig.events().is_empty(), !renames, "{content:?}");
        assert_eq!(rig.device.has_controller(), !renames);
    }
}

#[test]
fn a_connection_goes_on_when_the_present_address_is_stored() {
    let mut rig = DeviceRig::around(Device::new(
        DeviceConfig { permanent: Some(Permanent::default()), ..config() },
        Instant::ZERO,
    ));
    let block = Block { qualifier: PERMANENTLY, content: Content::Ip(suite(2)) };
    let frame = request(MAC, |w| emit(w, Dcp::SetRequest, 8, 0, [block]));
    assert!(rig.receive(Port::Ethernet, &frame).is_empty());
    assert_eq!(rig.events(), [LinkEvent::Store]);
    rig.establish(&connect_request(RtClass::Class1, true));
    rig.device.stored(rig.now, true);
    assert_eq!((rig.events(), rig.device.has_controller()), (vec![], true));
}
