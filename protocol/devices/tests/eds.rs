//! The EDS file, parsed and compared with a running adapter: the test opens every connection and reads every
//! attribute in the file.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::cip::{General, Path, Reply};
use ethernet_ip::connection::{
    ConnectionType, OpenReply, OpenRequest, Parameters, Priority, Transport, Triad,
};
use ethernet_ip::cpf::{Item, Packet, kind, write_item};
use ethernet_ip::description::Role;
use ethernet_ip::encapsulation::{Command, HEADER_LEN, Header};
use ethernet_ip::{Adapter, AdapterConfig};
use machine::wire::{FRAME_CAPACITY, LittleEndian, Reader, Writer};
use machine::{Instant, Machine, Port, Source, StreamChange, StreamId};
use protocol::stations::ETHERNET_IP_ROBOT;

/// Sections, their entries, and the entries' fields without quotation marks.
struct Eds(BTreeMap<String, BTreeMap<String, Vec<String>>>);

impl Eds {
    fn read() -> Self {
        let [(_, text), ..] = devices::files();
        let mut sections: BTreeMap<String, BTreeMap<String, Vec<String>>> = BTreeMap::new();
        let mut section = String::new();
        let mut entry = String::new();
        for line in text.lines() {
            let line = line.split_once('$').map_or(line, |(line, _)| line).trim();
            if let Some(name) = line.strip_prefix('[').and_then(|name| name.strip_suffix(']')) {
                name.clone_into(&mut section);
                assert!(
                    sections.insert(section.clone(), BTreeMap::new()).is_none(),
                    "[{section}] is there twice"
                );
                continue;
            }
            entry.push_str(line);
            if let Some(whole) = entry.strip_suffix(';') {
                let (keyword, fields) = whole.split_once('=').unwrap_or_else(|| panic!("no entry: {whole}"));
                let entries = sections.get_mut(&section).unwrap();
                let fields = split(fields);
                assert!(
                    entries.insert(keyword.trim().to_owned(), fields).is_none(),
                    "{keyword} is there twice"
                );
                entry.clear();
            }
        }
        assert_eq!(entry, "", "the last entry does not end");
        Self(sections)
    }

    fn fields(&self, section: &str, keyword: &str) -> &[String] {
        let entries = self.0.get(section).unwrap_or_else(|| panic!("there is no [{section}]"));
        entries.get(keyword).unwrap_or_else(|| panic!("[{section}] has no {keyword}"))
    }

    fn number(&self, section: &str, keyword: &str) -> u32 {
        number(&self.fields(section, keyword)[0])
    }

    fn text(&self, section: &str, keyword: &str) -> &str {
        &self.fields(section, keyword)[0]
    }
}

/// Splits fields at commas. No comma is inside quotation marks; this is checked.
fn split(fields: &str) -> Vec<String> {
    let fields: Vec<_> = fields.split(',').map(str::trim).collect();
    assert!(fields.iter().all(|field| field.matches('"').count() % 2 == 0), "{fields:?}");
    // `=>` in a name would be taken for a keyword; no name contains it.
    fields.iter().map(|field| field.trim_matches('"').to_owned()).collect()
}

fn number(field: &str) -> u32 {
    match field.strip_prefix("0x") {
        Some(hexadecimal) => u32::from_str_radix(hexadecimal, 16).unwrap(),
        None => field.parse().unwrap(),
    }
}

fn path(field: &str) -> Vec<u8> {
    field.split(' ').map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

/// An adapter with one client, at time zero.
struct AdapterUnderTest {
    adapter: Adapter,
    stream: StreamId,
    session: u32,
    serial: u16,
}

impl AdapterUnderTest {
    fn new() -> Self {
        let adapter = Adapter::new(AdapterConfig {
            description: &ETHERNET_IP_ROBOT,
            serial_number: 1,
            address: Ipv4Addr::new(192, 168, 64, 2),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            gateway: Ipv4Addr::UNSPECIFIED,
            mac: [2, 0, 0, 0, 0, 2],
            first_id: 1,
            originators: machine::Allowed::default(),
        });
        let mut asked = Self { adapter, stream: StreamId(0), session: 0, serial: 0 };
        asked.connect_from(1);
        asked
    }

    /// Goes on as another host.
    fn connect_from(&mut self, host: u8) {
        self.stream = StreamId(host.into());
        let peer = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, host), 50_000);
        self.adapter.handle_stream(Instant::ZERO, self.stream, StreamChange::Accepted(peer));
        self.session = 0;
        let (registered, _) = self.say(Command::RegisterSession, &[1, 0, 0, 0]);
        self.session = registered.session;
    }

    fn say(&mut self, command: Command, data: &[u8]) -> (Header, Vec<u8>) {
        let mut buf = vec![0; FRAME_CAPACITY];
        let len = Header::request(command, self.session).emit(&mut buf, |writer| writer.bytes(data)).unwrap();
        let from = Source { port: Port::Stream(self.stream), peer: None };
        self.adapter.handle_frame(Instant::ZERO, from, &buf[..len]);
        let reply = self.adapter.poll_transmit(Instant::ZERO, &mut buf).unwrap();
        (Header::parse(&buf).unwrap(), buf[HEADER_LEN..reply.len].to_vec())
    }

    /// Sends a CIP request; returns the data of its reply, or its status.
    fn request(&mut self, cip: &[u8]) -> Result<Vec<u8>, (u8, u16)> {
        let mut buf = [0; 512];
        let mut writer = Writer::<LittleEndian>::new(&mut buf);
        writer.zeros(6);
        writer.u16(2);
        write_item(&mut writer, kind::NULL_ADDRESS, |_| {});
        write_item(&mut writer, kind::UNCONNECTED_DATA, |writer| writer.bytes(cip));
        let len = writer.finish().unwrap();
        let (_, data) = self.say(Command::SendRRData, &buf[..len]);
        let mut reader = Reader::<LittleEndian>::new(&data);
        reader.skip(6).unwrap();
        let Some(Item::UnconnectedData(reply)) = Packet::parse(reader).unwrap().data else { panic!() };
        let reply = Reply::parse(reply).unwrap();
        match reply.general {
            General::Success => Ok(reply.data.to_vec()),
            general => Err((general.into(), reply.additional_status(0).unwrap_or(0))),
        }
    }

    /// Reads a number by Get_Attribute_Single.
    fn attribute(&mut self, class: u32, instance: u32, attribute: u8) -> u32 {
        let data =
            self.request(&[0x0E, 3, 0x20, class as u8, 0x24, instance as u8, 0x30, attribute]).unwrap();
        data.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
    }

    fn open(&mut self, request: &OpenRequest<'_>) -> Result<OpenReply, (u8, u16)> {
        let mut buf = [0; 256];
        let mut writer = Writer::<LittleEndian>::new(&mut buf);
        writer.bytes(&[0x54, 2, 0x20, 6, 0x24, 1]);
        self.serial += 1;
        let triad = Triad { connection_serial: self.serial, ..request.triad };
        OpenRequest { triad, ..*request }.emit(&mut writer, false);
        let len = writer.finish().unwrap();
        self.request(&buf[..len]).map(|data| OpenReply::parse(&data).unwrap())
    }
}

#[test]
fn the_identity_is_that_of_the_adapter() {
    let (eds, mut adapter) = (Eds::read(), AdapterUnderTest::new());
    for (keyword, attribute) in [("VendCode", 1), ("ProdType", 2), ("ProdCode", 3)] {
        assert_eq!(eds.number("Device", keyword), adapter.attribute(1, 1, attribute), "{keyword}");
    }
    let revision = eds.number("Device", "MajRev") | eds.number("Device", "MinRev") << 8;
    assert_eq!(revision, adapter.attribute(1, 1, 4));
    let name = adapter.request(&[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 7]).unwrap();
    assert_eq!(eds.text("Device", "ProdName").as_bytes(), &name[1..]);
    assert_eq!(eds.text("Device", "VendName"), ETHERNET_IP_ROBOT.vendor_name);
    assert_eq!(eds.text("Device Classification", "Class1"), "EtherNetIP");
}

#[test]
fn every_assembly_exists_with_its_path_and_size() {
    let (eds, mut adapter) = (Eds::read(), AdapterUnderTest::new());
    let named =
        eds.0["Assembly"].iter().filter_map(|(key, fields)| Some((key.strip_prefix("Assem")?, fields)));
    let mut instances = Vec::new();
    for (instance, fields) in named {
        let instance = number(instance);
        let size = number(&fields[2]);
        assert_eq!(adapter.attribute(4, instance, 4), size, "assembly {instance}");
        let path = path(&fields[1]);
        let data = adapter.request(&[&[0x0E, path.len() as u8 / 2][..], &path].concat()).unwrap();
        assert_eq!(data.len(), size as usize, "the data of assembly {instance}");
        let mut bits = 0;
        let members = fields[6..].chunks(2).filter(|member| !member[0].is_empty());
        for member in members {
            bits += number(&member[0]);
            if !member[1].is_empty() {
                let parameter = eds.fields("Params", &member[1]);
                assert_eq!(8 * number(&parameter[5]), number(&member[0]), "{parameter:?}");
            }
        }
        assert_eq!(bits, 8 * size, "the members of assembly {instance}");
        let described = ETHERNET_IP_ROBOT.assembly(instance).unwrap();
        assert_eq!((described.name, u32::from(described.size)), (&*fields[0], size));
        instances.push(instance);
    }
    assert_eq!(instances.len(), ETHERNET_IP_ROBOT.assemblies.len());
}

#[test]
fn the_members_of_the_images_have_the_names_of_their_fields_in_their_order() {
    let eds = Eds::read();
    for (instance, first, last) in [(100, "status", "services"), (150, "control", "slot 4 tool and base")] {
        let fields = eds.fields("Assembly", &format!("Assem{instance}"));
        let parameters = fields[6..].iter().filter(|field| field.starts_with("Param"));
        let names: Vec<_> = parameters.map(|parameter| eds.fields("Params", parameter)[6].as_str()).collect();
        assert_eq!((names[0], names[names.len() - 1]), (first, last));
        assert!(names.contains(&"life counter") && names.contains(&"check"), "{names:?}");
    }
}

/// Builds the Forward_Open that a scanner makes of connection N of the file.
fn forward_open(eds: &Eds, number_of: usize, path: &[u8], rpi_us: u32) -> OpenRequest<'static> {
    let fields = eds.fields("Connection Manager", &format!("Connection{number_of}"));
    let flags = number(&fields[1]);
    assert_eq!(flags & 0b1111, 0b0101, "of fixed size both ways");
    let run_idle = match flags >> 8 & 7 {
        4 => 4,
        3 => 0,
        format => panic!("a real-time format that nothing here has: {format}"),
    };
    assert_eq!(flags >> 12 & 7, 0, "T→O without a header");
    let size = |field: &String, header| Parameters {
        redundant_owner: false,
        kind: ConnectionType::PointToPoint,
        priority: Priority::Scheduled,
        variable: false,
        size: u16::try_from(number(field)).unwrap() + 2 + header,
    };
    OpenRequest {
        o_t_id: 0,
        t_o_id: 0x7000_0000 + number_of as u32,
        triad: Triad { connection_serial: 0, vendor: 1, originator_serial: 1 },
        multiplier: 5,
        o_t_rpi_us: rpi_us,
        o_t: size(&fields[3], run_idle),
        t_o_rpi_us: rpi_us,
        t_o: size(&fields[6], 0),
        transport: Transport::CYCLIC,
        path: Path(path.to_vec().leak()),
    }
}

#[test]
fn every_connection_is_opened_as_the_file_describes_it() {
    let eds = Eds::read();
    let connections = eds.0["Connection Manager"].keys().filter(|key| key.starts_with("Connection")).count();
    assert_eq!(connections, 3);
    let roles = [Role::Consumed, Role::InputOnlyHeartbeat, Role::ListenOnlyHeartbeat];
    let mut adapter = AdapterUnderTest::new();
    for (index, role) in roles.into_iter().enumerate() {
        let fields = eds.fields("Connection Manager", &format!("Connection{}", index + 1));
        assert_eq!(
            (number(&fields[0]) & 0xFFFF, number(&fields[0]) >> 16 & 7),
            (1 << 1, 0b111),
            "class 1, any trigger"
        );
        assert_eq!(number(&fields[0]) >> 24, 1 << (2 - index), "{role:?}");
        let path = path(&fields[14]);
        let produced = ETHERNET_IP_ROBOT.role(Role::Produced).unwrap();
        let consumed = ETHERNET_IP_ROBOT.role(role).unwrap();
        assert_eq!((&*fields[2], &*fields[5]), ("Param1", "Param1"));
        assert_eq!(fields[4], format!("Assem{}", consumed.instance));
        assert_eq!(fields[7], format!("Assem{}", produced.instance));
        assert_eq!((&*fields[10], &*fields[11]), ("0", "Assem151"));
        let request = forward_open(&eds, index + 1, &path, 1_000);
        assert_eq!(
            (request.o_t.size, request.t_o.size),
            (consumed.connection_size(), produced.connection_size())
        );
        for trigger in [0x00, 0x10, 0x20] {
            let mut adapter = AdapterUnderTest::new();
            if role == Role::ListenOnlyHeartbeat {
                adapter.open(&forward_open(&eds, 2, &self::path("20 04 24 97 2C 98 2C 64"), 1_000)).unwrap();
            }
            let request = OpenRequest { transport: Transport(trigger | 1), ..request };
            assert!(adapter.open(&request).is_ok(), "{role:?}, trigger {trigger:02X}");
        }
        // All connections at the same time; each also as a multicast, which the file allows.
        adapter.open(&request).unwrap();
        if role != Role::Consumed {
            let t_o = Parameters { kind: ConnectionType::Multicast, ..request.t_o };
            adapter.open(&OpenRequest { t_o, ..request }).unwrap();
        }
    }
}

#[test]
fn the_limits_of_the_packet_interval_are_those_of_the_adapter() {
    let eds = Eds::read();
    let parameter = eds.fields("Params", "Param1");
    assert_eq!((number(&parameter[4]), &*parameter[5], &*parameter[7]), (0xC8, "4", "us"), "a UDINT in µs");
    let [least, most, proposed] = [9, 10, 11].map(|index| number(&parameter[index]));
    let path = path("20 04 24 97 2C 96 2C 64");
    let opens = |rpi_us| {
        AdapterUnderTest::new().open(&forward_open(&eds, 1, &path, rpi_us)).map(|opened| opened.t_o_api_us)
    };
    assert_eq!([least, most, proposed].map(opens), [Ok(least), Ok(most), Ok(proposed)]);
    assert_eq!([least - 1, most + 1].map(opens), [Err((1, 0x0112)); 2]);
}

#[test]
fn the_adapter_accepts_exactly_as_many_connections_as_the_file_says() {
    let (eds, mut adapter) = (Eds::read(), AdapterUnderTest::new());
    let [owner, input_only, listen_only] =
        ["20 04 24 97 2C 96 2C 64", "20 04 24 97 2C 98 2C 64", "20 04 24 97 2C 99 2C 64"].map(path);
    let size = Parameters { priority: Priority::Low, variable: true, ..forward_open(&eds, 1, &owner, 1).o_t };
    let explicit = OpenRequest {
        o_t: size,
        t_o: size,
        transport: Transport::EXPLICIT,
        path: Path(&[0x20, 2, 0x24, 1]),
        ..forward_open(&eds, 1, &owner, 1_000_000)
    };
    let (mut io, mut messages) = (0, 0);
    // One host gets all but the last one of most kinds, which is for another host.
    for host in [3, 4] {
        adapter.connect_from(host);
        for (number, path) in [(1, &owner), (2, &input_only), (3, &listen_only)] {
            while adapter.open(&forward_open(&eds, number, path, 1_000)).is_ok() {
                io += 1;
            }
        }
        while adapter.open(&explicit).is_ok() {
            messages += 1;
        }
    }
    for keyword in ["MaxIOProducers", "MaxIOConsumers", "MaxIOProduceConsume", "MaxConsumersPerMcast"] {
        assert_eq!(eds.number("Capacity", keyword), io, "{keyword}");
    }
    assert_eq!(eds.number("Capacity", "MaxMsgConnections"), messages);
    let spec = eds.fields("Capacity", "TSpec1");
    let least = number(&eds.fields("Params", "Param1")[9]);
    assert_eq!((&*spec[0], number(&spec[1]), number(&spec[2])), ("TxRx", 262, 1_000_000 / least));
}

#[test]
fn every_class_has_the_revision_and_the_instances_that_the_adapter_reports() {
    let (eds, mut adapter) = (Eds::read(), AdapterUnderTest::new());
    let mut classes = Vec::new();
    for (section, entries) in &eds.0 {
        let Some(code) = entries.get("Object_Class_Code") else { continue };
        let class = number(&code[0]);
        assert_eq!(adapter.attribute(class, 0, 1), eds.number(section, "Revision"), "[{section}]");
        assert_eq!(adapter.attribute(class, 0, 2), eds.number(section, "MaxInst"), "[{section}]");
        if class != 2 {
            let instances = eds.number(section, "Number_Of_Static_Instances");
            assert_eq!(adapter.attribute(class, 0, 3), instances, "[{section}]");
        }
        classes.push(class);
    }
    // The message router's own list, which begins with its length.
    let listed = adapter.request(&[0x0E, 3, 0x20, 2, 0x24, 1, 0x30, 1]).unwrap();
    let mut listed: Vec<_> =
        listed[2..].chunks(2).map(|code| u32::from(code[0]) | u32::from(code[1]) << 8).collect();
    listed.sort_unstable();
    classes.sort_unstable();
    assert_eq!(classes, listed);
    assert_eq!(number(&eds.fields("Port", "Port1")[3]), adapter.attribute(0xF4, 1, 2));
}
