//! Name and address that are set permanently, and what a reset leaves of them.

use profinet::Permanent;
use profinet::dcp::{Block, BlockError, Code, Content, IpSuite, Service as Dcp, emit};

use super::discovery::{request, results};
use super::*;

/// The qualifiers of a Set for now and permanently.
const FOR_NOW: u16 = 0;
const PERMANENTLY: u16 = 1;

const fn suite(last: u8) -> IpSuite {
    let gateway = Ipv4Addr::UNSPECIFIED;
    IpSuite { address: Ipv4Addr::new(192, 168, 64, last), mask: MASK, gateway }
}

/// Returns a device whose owner stored this.
pub(super) fn with(permanent: Option<Permanent>) -> DeviceRig {
    let address = permanent.as_ref().and_then(|permanent| permanent.address).map(|suite| suite.address);
    DeviceRig::around(Device::new(
        DeviceConfig { station_name: b"factory".to_vec(), permanent, address, ..config() },
        Instant::ZERO,
    ))
}

/// Sends a Set; returns what is answered at once.
pub(super) fn set(rig: &mut DeviceRig, blocks: &[(u16, Content<'_>)]) -> Sent {
    let blocks = blocks.iter().map(|(qualifier, content)| Block { qualifier: *qualifier, content: *content });
    let frame = request(MAC, |w| emit(w, Dcp::SetRequest, 8, 0, blocks));
    rig.receive(Port::Ethernet, &frame)
}

/// Does what the owner does, and returns the answer and what it stored last.
pub(super) fn own(rig: &mut DeviceRig, mut stored: Permanent, works: bool) -> (Sent, Permanent) {
    let mut sent = rig.drain();
    sent.extend(rig.probe());
    while let Some(event) = rig.device.poll_event() {
        match event {
            LinkEvent::SetAddress { .. } => rig.device.address_set(rig.now, true),
            LinkEvent::Store => {
                let (name, address, maintenance) = rig.device.to_store();
                if works {
                    let (name, maintenance) = (name.map(<[u8]>::to_vec), maintenance.copied());
                    stored = Permanent { name, address, maintenance };
                }
                rig.device.stored(rig.now, works);
            }
            other => panic!("{other:?}"),
        }
        sent.extend(rig.drain());
    }
    (sent, stored)
}

/// Returns a name and an address, and nothing else.
fn robot() -> Permanent {
    Permanent { name: Some(b"robot".to_vec()), address: Some(suite(7)), maintenance: None }
}

fn named(name: &str) -> Permanent {
    Permanent { name: Some(name.into()), ..Permanent::default() }
}

#[test]
fn name_and_address_that_are_set_permanently_are_there_after_a_restart() {
    let mut rig = with(Some(Permanent::default()));
    let blocks = [(PERMANENTLY, Content::NameOfStation(b"robot")), (PERMANENTLY, Content::Ip(suite(7)))];
    assert!(set(&mut rig, &blocks).is_empty(), "it is answered when it is stored");
    assert_eq!(rig.device.station_name(), b"factory");
    let (sent, stored) = own(&mut rig, Permanent::default(), true);
    assert_eq!(results(&sent), [(Code::NAME_OF_STATION, BlockError::None), (Code::IP, BlockError::None)]);
    assert_eq!(rig.device.station_name(), b"robot");
    assert_eq!(stored, robot());

    let mut rig = with(Some(stored));
    assert_eq!(rig.device.station_name(), b"robot");
    let again = set(&mut rig, &blocks);
    assert_eq!(results(&again).len(), 2, "nothing changes, so nothing is stored");
    assert_eq!(rig.events(), []);
}

#[test]
fn a_set_for_now_removes_what_was_stored_of_the_same_kind_only() {
    let all = robot();
    let mut rig = with(Some(all.clone()));
    set(&mut rig, &[(FOR_NOW, Content::Ip(suite(8)))]);
    let (sent, stored) = own(&mut rig, all.clone(), true);
    assert_eq!(results(&sent), [(Code::IP, BlockError::None)]);
    assert_eq!(stored, named("robot"));

    let mut rig = with(Some(all.clone()));
    set(&mut rig, &[(FOR_NOW, Content::NameOfStation(b"other"))]);
    let (_, stored) = own(&mut rig, all, true);
    assert_eq!(stored, Permanent { name: None, ..robot() });
    assert_eq!(rig.device.station_name(), b"other");
}

#[test]
fn what_the_owner_cannot_store_is_refused_and_nothing_changes() {
    let mut rig = with(Some(Permanent::default()));
    set(&mut rig, &[(PERMANENTLY, Content::NameOfStation(b"robot"))]);
    let (sent, _) = own(&mut rig, Permanent::default(), false);
    assert_eq!(results(&sent), [(Code::NAME_OF_STATION, BlockError::NotPossible)]);
    assert_eq!(rig.device.station_name(), b"factory");

    let mut rig = with(None);
    for content in [Content::NameOfStation(b"robot"), Content::Ip(suite(7))] {
        let sent = set(&mut rig, &[(PERMANENTLY, content)]);
        assert_eq!(results(&sent)[0].1, BlockError::NotPossible, "an owner without storage");
    }
    assert_eq!(rig.events(), []);
    let sent = set(&mut rig, &[(FOR_NOW, Content::NameOfStation(b"robot"))]);
    assert_eq!(results(&sent), [(Code::NAME_OF_STATION, BlockError::None)]);
}

#[test]
fn while_the_owner_stores_another_change_is_refused_and_a_repetition_waits() {
    let mut rig = with(Some(Permanent::default()));
    let blocks = [(PERMANENTLY, Content::NameOfStation(b"robot"))];
    assert!(set(&mut rig, &blocks).is_empty());
    assert!(set(&mut rig, &blocks).is_empty());
    let other = request(MAC, |w| emit(w, Dcp::SetRequest, 9, 0, [Content::NameOfStation(b"other").into()]));
    let sent = rig.receive(Port::Ethernet, &other);
    assert_eq!(results(&sent), [(Code::NAME_OF_STATION, BlockError::Resource)]);
    let (sent, stored) = own(&mut rig, Permanent::default(), true);
    assert_eq!((results(&sent).len(), stored), (1, named("robot")));
}

#[test]
fn a_name_that_is_stored_only_when_a_controller_has_connected_ends_its_connection() {
    let mut rig = with(Some(Permanent::default()));
    set(&mut rig, &[(PERMANENTLY, Content::NameOfStation(b"robot"))]);
    assert_eq!(rig.events(), [LinkEvent::Store]);
    rig.establish(&connect_request(RtClass::Class1, true));
    rig.device.stored(rig.now, true);
    let [LinkEvent::Down(down)] = rig.events()[..] else { panic!("the connection is over") };
    assert_eq!(down.code, 0xCF81_FD1F);
}

#[test]
fn a_reset_of_the_communication_parameters_leaves_neither_name_nor_address() {
    for (qualifier, content) in [
        (2 << 1, Content::ResetToFactory),
        (2 << 1 | 1, Content::ResetToFactory),
        (8 << 1, Content::ResetToFactory),
        (0, Content::FactoryReset),
    ] {
        let all = robot();
        let mut rig = with(Some(all.clone()));
        assert!(set(&mut rig, &[(qualifier, content)]).is_empty());
        let mut events = rig.events().into_iter();
        let Some(LinkEvent::SetAddress { address, mask, gateway }) = events.next() else {
            panic!("the address goes")
        };
        assert_eq!([address, mask, gateway], [Ipv4Addr::UNSPECIFIED; 3]);
        rig.device.address_set(rig.now, true);
        let (sent, stored) = own(&mut rig, all, true);
        assert_eq!(results(&sent)[0].1, BlockError::None, "{content:?}");
        assert_eq!((rig.device.station_name(), stored), (&b"factory"[..], Permanent::default()));
    }
}

#[test]
fn other_modes_of_a_reset_are_refused_and_change_nothing() {
    let all = robot();
    let mut rig = with(Some(all));
    for mode in [0, 1, 3, 4, 5, 9, 10, 0x7FFF] {
        let sent = set(&mut rig, &[(mode << 1, Content::ResetToFactory)]);
        let refused = [(Code::RESET_TO_FACTORY, BlockError::SuboptionNotSupported)];
        assert_eq!(results(&sent), refused, "mode {mode}");
    }
    assert_eq!((rig.events(), rig.device.station_name()), (vec![], &b"robot"[..]));
}
