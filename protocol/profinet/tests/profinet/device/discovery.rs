//! DCP: finding, naming and addressing the device.

use profinet::dcp::{
    self, Block, BlockError, Code, Content, IpSuite, Pdu, Service as Dcp, emit, emit_get_request,
};

use super::*;

pub(super) fn request(destination: Mac, write: impl FnOnce(&mut BlockWriter<'_>)) -> Vec<u8> {
    let mut buf = [0; 1500];
    let header = EthernetHeader { destination, ..ethernet_header() };
    let len = header.emit(&mut buf, write).unwrap();
    buf[..len].to_vec()
}

pub(super) fn identify<'b>(blocks: impl IntoIterator<Item = Content<'b>>) -> Vec<u8> {
    let blocks: Vec<Block<'_>> = blocks.into_iter().map(Block::from).collect();
    request(dcp::IDENTIFY_MULTICAST, |w| emit(w, Dcp::IdentifyRequest, 7, 1, blocks))
}

pub(super) fn set<'b>(blocks: impl IntoIterator<Item = Content<'b>>) -> Vec<u8> {
    let blocks: Vec<Block<'_>> = blocks.into_iter().map(Block::from).collect();
    request(MAC, |w| emit(w, Dcp::SetRequest, 8, 0, blocks))
}

pub(super) fn results(sent: &[(Transmit, Vec<u8>)]) -> Vec<(Code, BlockError)> {
    let [(_, frame)] = sent else { panic!("one answer: {sent:?}") };
    let (_, payload) = EthernetHeader::parse(frame).unwrap();
    let result = |block: Result<Block<'_>, _>| match block.unwrap().content {
        Content::Response { code, error } => (code, error),
        other => panic!("{other:?}"),
    };
    Pdu::parse(payload).unwrap().blocks().map(result).collect()
}

#[test]
fn it_answers_who_asks_for_it_and_nobody_else() {
    let identity = samples::DEVICE.identity;
    let ours = Content::DeviceId { vendor: identity.vendor, device: identity.device };
    for (blocks, answers) in [
        (vec![Content::All], true),
        (vec![Content::NameOfStation(b"device")], true),
        (vec![Content::NameOfStation(b"robot2")], false),
        (vec![Content::NameOfStation(b"device"), ours], true),
        (vec![Content::NameOfStation(b"device"), Content::DeviceId { vendor: 1, device: 1 }], false),
        (vec![Content::DeviceRole(1)], true),
        (vec![Content::DeviceRole(2)], false),
        (vec![Content::DeviceInstance(1)], true),
        (vec![Content::DeviceInstance(2)], false),
        (vec![Content::AliasName(b"port-001.plc")], false),
    ] {
        let mut rig = DeviceRig::new();
        let sent = rig.receive(Port::Ethernet, &identify(blocks.iter().copied()));
        assert_eq!(!sent.is_empty(), answers, "{blocks:?}");
        if let [(_, frame)] = &sent[..] {
            let (header, payload) = EthernetHeader::parse(frame).unwrap();
            assert_eq!((header.destination, header.source), (CONTROLLER_MAC, MAC));
            let pdu = Pdu::parse(payload).unwrap();
            let station = dcp::Station::from_pdu(&pdu).unwrap();
            assert_eq!((pdu.xid, station.name), (7, &b"device"[..]));
            assert_eq!(station.ip.map(|ip| ip.address), Some(ADDRESS));
        }
    }
}

#[test]
fn answers_to_many_stations_are_spread_by_the_delay_factor() {
    let mut rig = DeviceRig::new();
    let blocks = [Content::All.into()];
    let request = request(dcp::IDENTIFY_MULTICAST, |w| emit(w, Dcp::IdentifyRequest, 7, 100, blocks));
    assert!(rig.receive(Port::Ethernet, &request).is_empty());
    assert!(rig.advance(Duration::from_millis(19)).is_empty());
    assert_eq!(rig.advance(Duration::from_millis(1)).len(), 1);
}

#[test]
fn get_tells_values_and_what_is_not_there() {
    let mut rig = DeviceRig::new();
    let wanted = [Code::NAME_OF_STATION, Code::ALIAS_NAME, Code(0x8001)];
    let sent = rig.receive(Port::Ethernet, &request(MAC, |w| emit_get_request(w, 9, &wanted)));
    let (_, payload) = EthernetHeader::parse(&sent[0].1).unwrap();
    let blocks: Vec<_> = Pdu::parse(payload).unwrap().blocks().map(|block| block.unwrap().content).collect();
    assert_eq!(
        blocks,
        [
            Content::NameOfStation(b"device"),
            Content::Response { code: Code::ALIAS_NAME, error: BlockError::SuboptionNotSupported },
            Content::Response { code: Code(0x8001), error: BlockError::OptionNotSupported },
        ]
    );
}

#[test]
fn a_get_that_asks_for_the_longest_name_again_and_again_is_answered_once_for_each_option() {
    let mut rig = DeviceRig::new();
    let name = [[b'a'; 60]; 4].join(&b'.')[..240].to_vec();
    rig.receive(Port::Ethernet, &set([Content::NameOfStation(&name)]));
    assert_eq!(rig.device.station_name(), name);
    let wanted = [[Code::NAME_OF_STATION; 15].as_slice(), &[Code::DEVICE_ID]].concat();
    let sent = rig.receive(Port::Ethernet, &request(MAC, |w| emit_get_request(w, 9, &wanted)));
    let (_, payload) = EthernetHeader::parse(&sent[0].1).unwrap();
    let codes: Vec<_> = Pdu::parse(payload).unwrap().blocks().map(|block| block.unwrap().code()).collect();
    assert_eq!(codes, [Code::NAME_OF_STATION, Code::DEVICE_ID]);
}

#[test]
fn a_name_is_set_if_it_is_one() {
    let mut rig = DeviceRig::new();
    for (name, error) in [
        (&b"cell-1.robot"[..], BlockError::None),
        (b"Robot", BlockError::SuboptionNotSet),
        (b"-robot", BlockError::SuboptionNotSet),
        (b"a..b", BlockError::SuboptionNotSet),
        (b"1.2.3.4", BlockError::SuboptionNotSet),
        (b"port-001", BlockError::SuboptionNotSet),
        (b"port-001-00000.cell", BlockError::SuboptionNotSet),
        (&[b'a'; 64], BlockError::SuboptionNotSet),
        (b"", BlockError::None),
    ] {
        let sent = rig.receive(Port::Ethernet, &set([Content::NameOfStation(name)]));
        assert_eq!(results(&sent), [(Code::NAME_OF_STATION, error)], "{name:?}");
        if error == BlockError::None {
            assert_eq!(rig.device.station_name(), name);
        }
    }
}

#[test]
fn while_a_connection_runs_name_and_address_stay_and_a_reset_is_refused_and_afterwards_they_can_be_set() {
    let suite = |last| {
        Content::Ip(IpSuite { address: Ipv4Addr::new(192, 168, 64, last), mask: MASK, gateway: ADDRESS })
    };
    let gateway = IpSuite { address: ADDRESS, mask: MASK, gateway: Ipv4Addr::new(192, 168, 64, 9) };
    let changes = [
        Content::NameOfStation(b"other"),
        suite(3),
        Content::Ip(gateway),
        Content::FactoryReset,
        Content::ResetToFactory,
    ];
    let mut rig = DeviceRig::connected(RtClass::Class1);
    for change in changes {
        let sent = rig.receive(Port::Ethernet, &set([change]));
        assert_eq!(results(&sent)[0].1, BlockError::InOperation, "{change:?}");
    }
    let same = set([Content::NameOfStation(b"device"), suite(2), Content::Signal(0x0100)]);
    let errors: Vec<_> =
        results(&rig.receive(Port::Ethernet, &same)).iter().map(|(_, error)| *error).collect();
    assert_eq!(errors, [BlockError::None; 3], "what changes nothing is allowed");
    let [LinkEvent::Foreign(report)] = rig.events()[..] else { panic!("one report for all") };
    assert_eq!(report.what, machine::Requested::Name);
    assert_eq!((rig.device.station_name(), rig.device.output(1, 1).is_some()), (&b"device"[..], true));

    rig.control(Operation::Release, control(Command::Release));
    rig.events();
    assert_eq!(results(&rig.receive(Port::Ethernet, &set([changes[0]])))[0].1, BlockError::None);
    assert_eq!(rig.device.station_name(), b"other");
}

#[test]
fn an_address_that_was_being_set_when_the_controller_connected_ends_the_connection() {
    let suite = IpSuite { address: Ipv4Addr::new(192, 168, 64, 3), mask: MASK, gateway: ADDRESS };
    let mut rig = DeviceRig::new();
    rig.receive(Port::Ethernet, &set([Content::Ip(suite)]));
    assert_eq!(rig.events().len(), 1, "the owner is asked first");
    rig.establish(&connect_request(RtClass::Class1, true));
    rig.device.address_set(rig.now, true);
    let [LinkEvent::Down(down)] = rig.events()[..] else { panic!("the connection is over") };
    assert_eq!(down.code, 0xCF81_FD25);
}

#[test]
fn an_address_that_no_host_has_or_that_the_owner_cannot_set_is_refused() {
    let mut rig = DeviceRig::new();
    let ip = |address: [u8; 4], mask: [u8; 4]| {
        Content::Ip(IpSuite { address: address.into(), mask: mask.into(), gateway: address.into() })
    };
    let mask = [255, 255, 255, 0];
    for (content, error) in [
        (ip([224, 0, 0, 1], mask), BlockError::SuboptionNotSet),
        (ip([127, 0, 0, 1], mask), BlockError::SuboptionNotSet),
        (ip([10, 0, 0, 1], [255, 0, 255, 0]), BlockError::SuboptionNotSet),
        (
            Content::Ip(IpSuite {
                gateway: [10, 0, 1, 1].into(),
                address: [10, 0, 0, 1].into(),
                mask: mask.into(),
            }),
            BlockError::SuboptionNotSet,
        ),
    ] {
        assert_eq!(results(&rig.receive(Port::Ethernet, &set([content]))), [(Code::IP, error)]);
    }
    assert!(rig.receive(Port::Ethernet, &set([ip([10, 0, 0, 1], mask)])).is_empty());
    rig.device.address_set(rig.now, false);
    assert_eq!(results(&rig.drain()), [(Code::IP, BlockError::NotPossible)]);
}

#[test]
fn signal_and_reset_are_answered_and_unknown_options_and_lengths_refused_one_by_one() {
    let mut rig = DeviceRig::new();
    let blocks = [
        Content::Start,
        Content::Signal(0x0100),
        Content::AliasName(b"x"),
        Content::Unknown(Code(0x8001), &[]),
        Content::Unknown(Code::IP, &[10, 0, 0, 1]),
        Content::End,
        Content::FactoryReset,
    ];
    assert!(rig.receive(Port::Ethernet, &set(blocks)).is_empty(), "the reset takes the address first");
    rig.device.address_set(rig.now, true);
    let errors: Vec<_> = results(&rig.drain()).iter().map(|(_, error)| *error).collect();
    use BlockError::{None, OptionNotSupported, SuboptionNotSet, SuboptionNotSupported};
    assert_eq!(
        errors,
        [None, None, SuboptionNotSupported, OptionNotSupported, SuboptionNotSet, None, None],
        "a block of a wrong length is refused alone"
    );
}

#[test]
fn identify_requests_with_the_longest_delay_keep_nobody_from_an_answer() {
    let mut rig = DeviceRig::new();
    let slow = request(dcp::IDENTIFY_MULTICAST, |w| {
        emit(w, Dcp::IdentifyRequest, 6, 6_400, [Content::All.into()]);
    });
    for _ in 0..8 {
        assert!(rig.receive(Port::Ethernet, &slow).is_empty());
    }
    assert_eq!(
        rig.receive(Port::Ethernet, &slow).len(),
        1,
        "without a place to wait in the answer goes out at once"
    );
    let get = request(MAC, |w| emit_get_request(w, 9, &[Code::NAME_OF_STATION]));
    assert_eq!(rig.receive(Port::Ethernet, &get).len(), 1);
    assert_eq!(
        results(&rig.receive(Port::Ethernet, &set([Content::NameOfStation(b"a")])))[0].1,
        BlockError::None
    );
    rig.receive(Port::Ethernet, &identify([Content::All]));
    rig.advance(Duration::from_secs(64));
    assert_eq!(rig.device.counters().foreign, 0, "every request is answered");
}

#[test]
fn a_flood_of_requests_fills_the_queue_and_no_more() {
    let mut rig = DeviceRig::new();
    let source = Source { port: Port::Ethernet, peer: None };
    for _ in 0..1_000 {
        rig.device.handle_frame(rig.now, source, &identify([Content::All]));
    }
    assert_eq!(rig.device.counters().foreign, 992, "a driver drains after each frame");
    assert_eq!(rig.drain().len(), 8);
}

#[test]
fn who_changed_something_keeps_others_from_it_for_3_s_and_nobody_from_asking() {
    let from = |source, write: &dyn Fn(&mut BlockWriter<'_>)| {
        let mut buf = [0; 1500];
        let len = EthernetHeader { source, ..ethernet_header() }.emit(&mut buf, write).unwrap();
        buf[..len].to_vec()
    };
    let other = Mac([2, 0, 0, 0, 0, 9]);
    let get = |source| from(source, &|w| emit_get_request(w, 9, &[Code::NAME_OF_STATION]));
    let set = |source, content: Content<'static>| {
        from(source, &move |w| emit(w, Dcp::SetRequest, 8, 0, [content.into()]))
    };
    let name = |source, name| set(source, Content::NameOfStation(name));
    let mut rig = DeviceRig::new();
    // Who asks, or sets what is so already, keeps nobody from anything.
    for request in [get(other), name(other, b"device"), set(other, Content::Signal(0x0100))] {
        assert_eq!(rig.receive(Port::Ethernet, &request).len(), 1);
    }
    rig.receive(Port::Ethernet, &name(CONTROLLER_MAC, b"a"));
    assert_eq!(rig.device.station_name(), b"a");
    rig.advance(Duration::from_millis(2_900));
    assert!(rig.receive(Port::Ethernet, &name(other, b"b")).is_empty());
    assert_eq!(rig.device.station_name(), b"a");
    assert_eq!(rig.receive(Port::Ethernet, &get(other)).len(), 1);
    assert_eq!(rig.receive(Port::Ethernet, &identify([Content::All])).len(), 1);
    // What is ignored does not prolong the time.
    rig.advance(Duration::from_millis(100));
    rig.receive(Port::Ethernet, &name(other, b"b"));
    assert_eq!(rig.device.station_name(), b"b");
}
