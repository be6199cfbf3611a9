//! The GSDML file, parsed and compared with a running controller and device.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::cell::Cell;
use std::collections::BTreeSet;
use std::net::Ipv4Addr;
use std::rc::Rc;
use std::time::Duration;

use machine::ethernet::{EthernetHeader, Mac};
use machine::wire::FRAME_CAPACITY;
use machine::{Instant, Machine};
use profinet::description::{Description, Identity};
use profinet::rt::{Transport, UDP_PORT};
use profinet::{ArConfig, ControllerConfig, Device, DeviceConfig, MauType, Parameter, lldp};
use protocol::buses::ProfinetController;
use protocol::fieldbus::{LinkEvent, StationId};
use protocol::stations::{PROFINET_PLC, PROFINET_ROBOT as ROBOT};
use roxmltree::{Document, Node};
use virtual_time::{Carrier, Clock, Event, Impairment, Pair, PairConfig, Side};

fn text() -> String {
    let [_, (_, text), _] = devices::files();
    text
}

/// Returns the only element of this name.
fn only_element<'a>(document: &'a Document<'_>, name: &str) -> Node<'a, 'a> {
    let named: Vec<_> = document.descendants().filter(|node| node.has_tag_name((NAMESPACE, name))).collect();
    assert_eq!(named.len(), 1, "elements {name}");
    named[0]
}

const NAMESPACE: &str = "http://www.profibus.com/GSDML/2003/11/DeviceProfile";

fn number(node: Node<'_, '_>, attribute: &str) -> u32 {
    let text = node.attribute(attribute).unwrap();
    text.strip_prefix("0x").map_or_else(|| text.parse(), |text| u32::from_str_radix(text, 16)).unwrap()
}

/// Returns the bytes of a `DataItem`.
fn data_bytes(item: Node<'_, '_>) -> u32 {
    match item.attribute("DataType").unwrap() {
        "Unsigned8" => 1,
        "Unsigned16" => 2,
        "Unsigned32" | "Float32" => 4,
        "Unsigned64" => 8,
        "OctetString" => number(item, "Length"),
        other => panic!("no type of a member: {other}"),
    }
}

#[test]
fn the_data_are_named_as_the_fields_of_the_images() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let text_of = |node: Node<'_, '_>| {
        let id = node.attribute("TextId").unwrap();
        let text = document
            .descendants()
            .find(|text| text.attribute("TextId") == Some(id) && text.has_attribute("Value"));
        text.unwrap().attribute("Value").unwrap()
    };
    let place_of = |direction: &str, name: &str| {
        let data = document.descendants().find(|node| node.has_tag_name((NAMESPACE, direction))).unwrap();
        let items = data.children().filter(Node::is_element);
        items.take_while(|item| text_of(*item) != name).map(data_bytes).sum::<u32>()
    };
    for (direction, name, first) in [
        ("Input", "status", 0),
        ("Input", "executed", 8),
        ("Input", "pose 4", 80),
        ("Input", "check", 116),
        ("Output", "life counter", 2),
        ("Output", "slot 0 target 1", 36),
        ("Output", "slot 4 kind", 254),
    ] {
        assert_eq!(place_of(direction, name), first, "{name}");
    }
    let bits: Vec<_> =
        document.descendants().filter(|node| node.has_tag_name((NAMESPACE, "BitDataItem"))).collect();
    let execute = bits.iter().find(|bit| text_of(**bit) == "EXECUTE").unwrap();
    assert_eq!(number(*execute, "BitOffset"), 1);
}

#[test]
fn the_name_of_the_file_has_the_parts_that_engineering_systems_expect() {
    let [_, (name, _), _] = devices::files();
    let parts: Vec<_> = name.strip_suffix(".xml").unwrap().split('-').collect();
    let [gsdml, version, vendor, _, date] = parts[..] else { unreachable!("{name}") };
    assert_eq!((gsdml, version, date.len()), ("GSDML", "V2.4", 8));
    let text = text();
    let document = Document::parse(&text).unwrap();
    let named: Vec<_> =
        document.descendants().filter(|node| node.has_tag_name((NAMESPACE, "VendorName"))).collect();
    assert!(named.iter().all(|node| node.attribute("Value") == Some(vendor)) && named.len() == 2);
    assert!(text.contains("GSDML-DeviceProfile-V2.4.xsd"), "the schema of the version in the name");
}

#[test]
fn the_identity_is_that_of_the_running_device() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let identity = only_element(&document, "DeviceIdentity");
    let Identity { vendor, device } = ROBOT.identity;
    assert_eq!((number(identity, "VendorID"), number(identity, "DeviceID")), (vendor.into(), device.into()));
    let access_point = only_element(&document, "DeviceAccessPointItem");
    let value = |name| only_element(&document, name).attribute("Value").unwrap().to_owned();
    assert_eq!(access_point.attribute("DNS_CompatibleName"), Some(ROBOT.order_id));
    assert!(profinet::is_station_name(ROBOT.order_id.as_bytes()));
    assert_eq!(value("OrderNumber"), ROBOT.order_id);
    assert_eq!(value("HardwareRelease"), ROBOT.hardware_revision.to_string());
    let [major, minor, patch] = ROBOT.software_revision;
    assert_eq!(value("SoftwareRelease"), format!("V{major}.{minor}.{patch}"));
    for required in ["CheckDeviceID_Allowed", "NameOfStationNotTransferable", "PNIO_Version"] {
        assert!(access_point.has_attribute(required), "{required}");
    }
    assert!(only_element(&document, "InterfaceSubmoduleItem").has_attribute("SupportedProtocols"));
}

#[test]
fn the_protocols_beside_profinet_are_those_that_the_running_device_speaks() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let interface = only_element(&document, "InterfaceSubmoduleItem");
    assert_eq!(interface.attribute("SupportedProtocols"), Some("LLDP"));
    let access_point = only_element(&document, "DeviceAccessPointItem");
    assert_eq!(access_point.attribute("LLDP_NoD_Supported"), Some("true"));

    let frame = announcement();
    let (header, payload) = EthernetHeader::parse(&frame).unwrap();
    assert_eq!((header.destination, header.ether_type), (lldp::MULTICAST, lldp::ETHER_TYPE));
    assert!(lldp::Pdu::parse(payload).is_ok());
}

/// Returns the first frame of the running device: its LLDP announcement.
fn announcement() -> Vec<u8> {
    let config = DeviceConfig {
        mac: Mac([2, 0, 0, 0, 0, 2]),
        station_name: ROBOT.order_id.into(),
        permanent: None,
        address: None,
        mask: Ipv4Addr::UNSPECIFIED,
        description: ROBOT,
        controllers: machine::Allowed::default(),
    };
    let mut device = Device::new(config, Instant::ZERO);
    device.handle_timeout(Instant::ZERO);
    let mut buf = [0; FRAME_CAPACITY];
    let sent = device.poll_transmit(Instant::ZERO, &mut buf).unwrap();
    buf[..sent.len].to_vec()
}

#[test]
fn the_port_has_the_medium_that_the_running_device_announces_among_those_of_the_file() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let listed: Vec<_> = only_element(&document, "MAUTypeList")
        .children()
        .filter(Node::is_element)
        .map(|item| number(item, "Value"))
        .collect();
    assert_eq!(listed, MauType::ALL.iter().map(|it| it.code().into()).collect::<Vec<u32>>());
    let frame = announcement();
    let (_, payload) = EthernetHeader::parse(&frame).unwrap();
    let announced = lldp::Pdu::parse(payload).unwrap().mac_phy.unwrap().mau_type;
    assert!(listed.contains(&announced.into()), "{announced} is not in {listed:?}");
}

#[test]
fn the_records_of_the_operator_are_written_at_the_access_point() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let writable: Vec<_> = document
        .descendants()
        .filter_map(|node| {
            let records = node.attribute("Writeable_IM_Records")?;
            Some((number(node, "SubmoduleIdentNumber"), records))
        })
        .collect();
    let access_point = ROBOT.submodules().next().unwrap().1.ident;
    assert_eq!(writable, [(access_point, "1 2 3 4")]);
}

#[test]
fn every_module_and_submodule_has_its_slot_number_and_lengths() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let mut found = BTreeSet::new();
    let modules = document.descendants().filter(|node| {
        node.has_tag_name((NAMESPACE, "DeviceAccessPointItem"))
            || node.has_tag_name((NAMESPACE, "ModuleItem"))
    });
    for module in modules {
        let id = module.attribute("ID").unwrap();
        let reference = document.descendants().find(|node| node.attribute("ModuleItemTarget") == Some(id));
        let slot = number(reference.unwrap_or(module), "FixedInSlots");
        for item in module.descendants().filter(|node| node.has_attribute("SubmoduleIdentNumber")) {
            let subslot =
                if item.has_attribute("SubslotNumber") { "SubslotNumber" } else { "FixedInSubslots" };
            let len = |direction| {
                let data = item.descendants().filter(|node| node.has_tag_name((NAMESPACE, direction)));
                data.flat_map(|node| node.children()).filter(Node::is_element).map(data_bytes).sum::<u32>()
            };
            let numbers = [number(module, "ModuleIdentNumber"), number(item, "SubmoduleIdentNumber")];
            found.insert((slot, number(item, subslot), numbers, [len("Input"), len("Output")]));
        }
    }
    let described = ROBOT.modules.iter().flat_map(|module| {
        module.submodules.iter().map(|submodule| {
            let lengths = [submodule.input_len.into(), submodule.output_len.into()];
            (module.slot.into(), submodule.subslot.into(), [module.ident, submodule.ident], lengths)
        })
    });
    assert_eq!(found, described.collect());
}

#[test]
fn every_referenced_text_and_every_identifier_exists_once() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let mut ids = BTreeSet::new();
    for id in document.descendants().filter_map(|node| node.attribute("ID")) {
        assert!(ids.insert(id), "{id} is there twice");
    }
    let is_text = |node: &Node<'_, '_>| node.has_tag_name((NAMESPACE, "Text"));
    let texts: Vec<_> =
        document.descendants().filter(is_text).filter_map(|node| node.attribute("TextId")).collect();
    let known: BTreeSet<_> = texts.iter().copied().collect();
    assert_eq!(known.len(), texts.len());
    let used =
        document.descendants().filter(|node| !is_text(node)).filter_map(|node| node.attribute("TextId"));
    assert_eq!(known, used.collect());
}

type Bus = Pair<ProfinetController, Device>;

/// Connects our controller and our device at this cycle.
fn bus(cycle: Duration, description: Description) -> Bus {
    let [plc, robot] = [Ipv4Addr::new(192, 168, 64, 1), Ipv4Addr::new(192, 168, 64, 2)];
    let mask = Ipv4Addr::new(255, 255, 255, 0);
    let start = Instant::from_millis(1);
    let controller = ControllerConfig {
        mac: Mac([2, 0, 0, 0, 0, 1]),
        station_name: "plc".into(),
        address: plc,
        mask,
        description: PROFINET_PLC,
        seed: 1,
    };
    let wanted = ArConfig {
        station_name: "robot".into(),
        mac: None,
        address: robot,
        description,
        parameters: vec![Parameter::interface_adjust()],
        transport: Transport::Rt1,
        cycle,
        watchdog_cycles: 3,
    };
    let device = DeviceConfig {
        mac: Mac([2, 0, 0, 0, 0, 2]),
        station_name: b"robot".to_vec(),
        permanent: None,
        address: Some(robot),
        mask,
        description: ROBOT,
        controllers: machine::Allowed::default(),
    };
    let links = [Impairment { delay: Duration::from_micros(5), ..Impairment::default() }; 2];
    let addresses = [Some(plc), Some(robot)];
    let mut device = Device::new(device, start);
    device.set_inputs(|_, _, data| data.fill(7));
    let pair = PairConfig { seed: 1, clocks: [Clock::default(); 2], links, addresses };
    Bus::new(ProfinetController::new(controller, vec![wanted], start).unwrap(), device, pair)
}

fn comes_up(bus: &mut Bus) -> bool {
    while let Some(event) = bus.next_event(Instant::from_millis(10_000)) {
        if event == Event::A((StationId::FIRST, LinkEvent::Up)) {
            return true;
        }
    }
    false
}

#[test]
fn data_is_exchanged_at_every_send_clock_including_the_shortest_interval() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let timing = only_element(&document, "TimingProperties");
    let numbers = |attribute| {
        let list = timing.attribute(attribute).unwrap().split(' ');
        list.map(|number| number.parse::<u32>().unwrap()).collect::<Vec<_>>()
    };
    let clocks = numbers("SendClock");
    assert!(clocks.contains(&32), "1 ms is what every device has to have");
    for clock in &clocks {
        // Our controller's send clock is 1 ms if the cycle is longer.
        assert!(comes_up(&mut bus(Duration::from_nanos(31_250) * *clock, ROBOT)), "{clock} × 31.25 µs");
    }
    for ratio in numbers("ReductionRatio") {
        assert!(comes_up(&mut bus(Duration::from_millis(ratio.into()), ROBOT)), "1 ms × {ratio}");
    }
    let least = number(only_element(&document, "DeviceAccessPointItem"), "MinDeviceInterval");
    assert_eq!(least, ROBOT.min_device_interval.into());
    assert_eq!(clocks.iter().min(), Some(&least));
    let shorter = Description { min_device_interval: 1, ..ROBOT };
    let cycle = Duration::from_nanos(31_250) * (least / 2);
    assert!(!comes_up(&mut bus(cycle, shorter)), "a controller that does not know of the interval");
}

#[test]
fn the_longest_frames_have_the_length_in_the_file_including_status_bytes() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let lengths = only_element(&document, "IOConfigData");
    let [input, output] = ["MaxInputLength", "MaxOutputLength"].map(|name| number(lengths, name) as usize);
    let mut bus = bus(Duration::from_millis(1), ROBOT);
    assert!(comes_up(&mut bus));
    let longest = Rc::new(Cell::new([0, 0]));
    let tapped = Rc::clone(&longest);
    bus.set_tap(move |tap| {
        assert!(!matches!(tap.carrier, Carrier::Udp { to, .. } if to.port() == UDP_PORT));
        // Datagrams of connection management have no Ethernet header here.
        let Carrier::Ethernet = tap.carrier else { return };
        let mut all = tapped.get();
        let longest = &mut all[usize::from(tap.from == Side::A)];
        *longest = tap.frame.len().max(*longest);
        tapped.set(all);
    });
    bus.next_event(Instant::from_millis(20_000));
    // Two addresses, tag and EtherType, FrameID; cycle counter, data status, transfer status.
    assert_eq!(longest.get().map(|len| len - (12 + 4 + 2 + 2) - 4), [input, output]);
}
