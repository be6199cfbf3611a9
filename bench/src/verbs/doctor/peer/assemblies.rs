//! Assemblies of an EtherNet/IP robot, read without a connection: their sizes against those of the setup.

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::ENCAPSULATION_PORT;
use ethernet_ip::cip::class;
use plc_node::dialogue::{AttributeAnswer, Dialogue, malformed};
use protocol::image::IMAGE_LEN;
use protocol::stations::{COMMAND, FEEDBACK};
use setup::{Bus, BusKind, EthernetIp};

use super::unreachable::unreachable;
use crate::verbs::doctor::finding::Finding;

const ASSEMBLIES: &str = "assembly sizes";

/// Attributes of an assembly (volume 1, table 5-5.3): its data, and their number in bytes.
const DATA: u32 = 3;
const SIZE: u32 = 4;

/// An assembly that a connection of the setup uses.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct WantedAssembly {
    /// Data of the command or of the feedback.
    what: &'static str,
    /// Key of its size in `[bus.ethernet_ip.adapter]`.
    key: &'static str,
    instance: u32,
    bytes: u16,
}

/// What a device says of the size of an assembly.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum AssemblySize {
    Bytes(usize),
    /// It has no such assembly.
    Unknown,
    /// It does not say, with this general status.
    Unreported(u8),
}

/// Reads the sizes of the robot's assemblies and judges them; nothing on another bus.
pub(super) fn findings(bus: &Bus, seen: &[Finding]) -> Vec<Finding> {
    let BusKind::EthernetIp(addresses, ethernet_ip) = &bus.kind else { return Vec::new() };
    if let Some(reason) = unreachable(ethernet_ip, seen) {
        return vec![reason.finding(ASSEMBLIES)];
    }
    let wanted = wanted(ethernet_ip);
    vec![match read(addresses.robot, &wanted) {
        Ok(sizes) => judged(&wanted, &sizes),
        Err(error) => {
            let found = format!("cannot read them from {}: {error}", addresses.robot);
            Finding::limited(ASSEMBLIES, found, "the step `connection` decides")
        }
    }]
}

/// Returns the assemblies that a setup expects.
fn wanted(ethernet_ip: &EthernetIp) -> [WantedAssembly; 2] {
    let whole = IMAGE_LEN as u16;
    let [consumed, produced] = match &ethernet_ip.adapter {
        None => [(COMMAND, whole), (FEEDBACK, whole)],
        Some(adapter) => [
            (adapter.consumed_assembly, adapter.consumed_bytes),
            (adapter.produced_assembly, adapter.produced_bytes),
        ],
    };
    [("command", "consumed_bytes", consumed), ("feedback", "produced_bytes", produced)]
        .map(|(what, key, (instance, bytes))| WantedAssembly { what, key, instance, bytes })
}

/// Compares what the device says of each assembly with the setup.
fn judged(wanted: &[WantedAssembly], sizes: &[AssemblySize]) -> Finding {
    let (mut right, mut wrong, mut unreported, mut keys) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (WantedAssembly { what, key, instance, bytes }, size) in wanted.iter().zip(sizes) {
        match size {
            AssemblySize::Bytes(found) if *found == usize::from(*bytes) => {
                right.push(format!("assembly {instance} ({what}) has {found} bytes"));
            }
            AssemblySize::Bytes(found) => {
                wrong.push(format!("assembly {instance} ({what}) has {found} bytes, the setup {bytes}"));
                keys.push(format!("{key} = {found}"));
            }
            AssemblySize::Unknown => {
                wrong.push(format!("the device has no assembly {instance} ({what})"));
            }
            AssemblySize::Unreported(status) => {
                unreported.push(format!("assembly {instance} ({what}): general status 0x{status:02X}"));
            }
        }
    }
    if !wrong.is_empty() {
        let remedy = "give the robot's project assemblies that carry the image, or write those of its device file into [bus.ethernet_ip.adapter]";
        let fix = if keys.is_empty() { remedy.to_owned() } else { format!("{remedy}: {}", keys.join(", ")) };
        return Finding::missing(
            ASSEMBLIES,
            wrong.into_iter().chain(unreported).collect::<Vec<_>>().join("; "),
            fix,
        );
    }
    if !unreported.is_empty() {
        let found = format!("the device does not report: {}", unreported.join("; "));
        return Finding::limited(ASSEMBLIES, found, "the step `connection` decides");
    }
    Finding::good(ASSEMBLIES, format!("as the setup expects: {}", right.join(", ")))
}

/// Reads the size of each assembly over a session of its own.
fn read(robot: Ipv4Addr, wanted: &[WantedAssembly]) -> std::io::Result<Vec<AssemblySize>> {
    let mut dialogue = Dialogue::open(SocketAddrV4::new(robot, ENCAPSULATION_PORT))?;
    wanted.iter().map(|assembly| size_of(&mut dialogue, assembly.instance)).collect()
}

/// Reads attribute 4 of an assembly, or counts the bytes of attribute 3 where the device does not have it.
fn size_of(dialogue: &mut Dialogue, instance: u32) -> std::io::Result<AssemblySize> {
    match size_in(SIZE, dialogue.attribute(class::ASSEMBLY, instance, SIZE)?)? {
        AssemblySize::Bytes(bytes) => Ok(AssemblySize::Bytes(bytes)),
        _ => size_in(DATA, dialogue.attribute(class::ASSEMBLY, instance, DATA)?),
    }
}

/// Returns the size in an answer to the question for an attribute.
fn size_in(attribute: u32, answer: AttributeAnswer) -> std::io::Result<AssemblySize> {
    match answer {
        AttributeAnswer::Bytes(bytes) if attribute == SIZE => match bytes.as_slice() {
            [low, high] => Ok(AssemblySize::Bytes(usize::from(u16::from_le_bytes([*low, *high])))),
            _ => Err(malformed("attribute 4 of its assembly is not a number of 16 bits")),
        },
        AttributeAnswer::Bytes(bytes) => Ok(AssemblySize::Bytes(bytes.len())),
        AttributeAnswer::NoObject => Ok(AssemblySize::Unknown),
        AttributeAnswer::Refused(status) => Ok(AssemblySize::Unreported(status)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ethernet_ip::cip::{General, service};
    use ethernet_ip::cpf::write_unconnected;
    use ethernet_ip::encapsulation::{Command, Header, Message, Reassembly, Status};
    use machine::wire::{LittleEndian, Writer as WireWriter};
    use plc_node::dialogue::parse;
    use std::io::{Read as _, Write as _};
    use std::net::TcpListener;

    type Writer<'a> = WireWriter<'a, LittleEndian>;

    /// Returns the size in the bytes of an answer.
    fn size_in(attribute: u32, data: &[u8]) -> std::io::Result<AssemblySize> {
        parse(data).and_then(|answer| super::size_in(attribute, answer))
    }

    /// Returns an answer to SendRRData with the reply of an object.
    fn answered(service: u8, general: u8, data: &[u8]) -> Vec<u8> {
        let mut buf = [0; 600];
        let mut writer = Writer::new(&mut buf);
        write_unconnected(&mut writer, |writer| {
            writer.bytes(&[service | 0x80, 0, general, 0]);
            writer.bytes(data);
        });
        let len = writer.finish().unwrap();
        buf[..len].to_vec()
    }

    #[test]
    fn the_size_is_attribute_4_or_the_length_of_the_data_and_every_other_answer_is_distinguished() {
        let of = |attribute, general, data: &[u8]| {
            size_in(attribute, &answered(service::GET_ATTRIBUTE_SINGLE, general, data)).unwrap()
        };
        assert_eq!(of(SIZE, 0, &[0x00, 0x01]), AssemblySize::Bytes(256));
        assert_eq!(of(DATA, 0, &[7; 64]), AssemblySize::Bytes(64));
        assert_eq!(of(DATA, 0, &[]), AssemblySize::Bytes(0));
        assert_eq!(of(SIZE, General::PathDestinationUnknown.into(), &[]), AssemblySize::Unknown);
        assert_eq!(of(SIZE, General::ObjectDoesNotExist.into(), &[]), AssemblySize::Unknown);
        assert_eq!(of(SIZE, 0x14, &[]), AssemblySize::Unreported(0x14));
        let whole = answered(service::GET_ATTRIBUTE_SINGLE, 0, &[0x00, 0x01]);
        for len in 0..whole.len() - 2 {
            assert!(size_in(SIZE, &whole[..len]).is_err(), "cut after {len} bytes");
        }
        assert!(size_in(SIZE, &answered(service::GET_ATTRIBUTE_SINGLE, 0, &[1, 2, 3, 4])).is_err());
        assert!(size_in(SIZE, &answered(service::RESET, 0, &[0, 1])).is_err());
    }

    #[test]
    fn assemblies_of_other_sizes_are_named_with_the_keys_that_would_fit_them() {
        let setup = setup::setup("B").unwrap();
        let BusKind::EthernetIp(_, ethernet_ip) = &setup.bus.kind else { panic!("EtherNet/IP") };
        let wanted = wanted(ethernet_ip);
        let said = |sizes: [AssemblySize; 2]| {
            let Finding { verdict, found, fix, .. } = judged(&wanted, &sizes);
            format!("{verdict:?}: {found}{}", fix.map_or_else(String::new, |fix| format!(" -> {fix}")))
        };
        let whole = AssemblySize::Bytes(256);
        let cases = [
            [whole, whole],
            [AssemblySize::Bytes(64), AssemblySize::Unreported(8)],
            [AssemblySize::Unknown, whole],
            [AssemblySize::Unreported(0x14), whole],
        ];
        let [good, smaller, unknown, silent] = cases.map(said);
        let both = "assembly 150 (command) has 256 bytes, assembly 100 (feedback) has 256 bytes";
        assert_eq!(good, format!("Good: as the setup expects: {both}"));
        let said = "Missing: assembly 150 (command) has 64 bytes, the setup 256; assembly 100 (feedback): general status 0x08 -> ";
        assert!(
            smaller.starts_with(said) && smaller.ends_with("[bus.ethernet_ip.adapter]: consumed_bytes = 64"),
            "{smaller}"
        );
        assert!(unknown.starts_with("Missing: the device has no assembly 150 (command) -> "), "{unknown}");
        assert!(
            silent.starts_with("Limited: the device does not report: assembly 150 (command)"),
            "{silent}"
        );
    }

    #[test]
    fn a_device_that_answers_in_pieces_is_understood_and_one_that_hangs_up_or_answers_others_is_not() {
        /// Returns what is read from a device that answers each message by `answer`, one byte at a time.
        fn read_from(
            answer: impl Fn(Header, &[u8]) -> Option<Vec<u8>> + Send + 'static,
        ) -> std::io::Result<AssemblySize> {
            let listener = TcpListener::bind("127.0.0.1:0").unwrap();
            let std::net::SocketAddr::V4(device) = listener.local_addr().unwrap() else { panic!("IPv4") };
            let server = std::thread::spawn(move || {
                let (mut stream, _) = listener.accept().unwrap();
                let (mut received, mut bytes) = (Reassembly::default(), [0; 512]);
                while let Ok(count @ 1..) = stream.read(&mut bytes) {
                    received.push(&bytes[..count]).unwrap();
                    while let Some(Message::Whole(header, data)) = received.next_message() {
                        let Some(answer) = answer(header, data) else { return };
                        for byte in answer {
                            if stream.write_all(&[byte]).is_err() {
                                return;
                            }
                        }
                    }
                }
            });
            let found = Dialogue::open(device).and_then(|mut dialogue| size_of(&mut dialogue, 100));
            server.join().unwrap();
            found
        }
        fn message(header: Header, body: &[u8]) -> Vec<u8> {
            let mut buf = [0; 700];
            let len = header.emit(&mut buf, |writer| writer.bytes(body)).unwrap();
            buf[..len].to_vec()
        }
        let session = |header: Header| message(Header { session: 7, ..header }, &[1, 0, 0, 0]);
        let size = answered(service::GET_ATTRIBUTE_SINGLE, 0, &[0x00, 0x01]);
        let answer = read_from(move |header, _| match header.command {
            Command::RegisterSession => Some(session(header)),
            _ => Some(message(header, &size)),
        });
        assert_eq!(answer.unwrap(), AssemblySize::Bytes(256));
        assert!(read_from(|_, _| None).is_err());
        assert!(read_from(move |header, _| (header.session == 0).then(|| session(header))).is_err());
        let refused = read_from(|header, _| Some(message(header.reply(Status::InsufficientMemory), &[])));
        assert!(refused.unwrap_err().to_string().contains("refuses a session"));
        let others =
            read_from(|header, _| Some(message(Header { context: [9; 8], ..header }, &[]).repeat(20)));
        assert!(others.unwrap_err().to_string().contains("answers other questions"));
    }
}
