//! What EtherNet/IP needs from the network beyond datagrams: the DSCP in the IP header, multicast groups, and whether
//! a request was sent to everybody. The tests check it in a capture.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufReader, Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddrV4, TcpStream, UdpSocket};
use std::time::Duration;

use capture_file::Retention;
use ethernet_ip::{Adapter, AdapterConfig, ConnectionConfig, ENCAPSULATION_PORT, IO_PORT, ScannerConfig};
use machine::{Machine, Port, PortRequest, Source, Transmit};
use pcap_file::pcapng::{Block, PcapNgReader};
use protocol::buses::EthernetIpScanner;
use protocol::fieldbus::{ControllerBus as _, LinkEvent, StationId};
use protocol::stations::{ETHERNET_IP_ROBOT, ETHERNET_IP_VENDOR};
use protocol_linux::{Interface, Recorder, clock};

use super::test_network::{ADDRESSES, MASK, Progress, TIMEOUT, TestNetwork};

const PLC: Ipv4Addr = ADDRESSES[0];
const ROBOT: Ipv4Addr = ADDRESSES[1];

/// The robot's own group: 239.192.1.0 + 32 · (host − 1).
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 192, 1, 32);

fn adapter(interface: &Interface) -> Adapter {
    Adapter::new(AdapterConfig {
        description: &ETHERNET_IP_ROBOT,
        serial_number: 7,
        address: ROBOT,
        mask: MASK,
        gateway: Ipv4Addr::UNSPECIFIED,
        mac: interface.mac().0,
        first_id: 1,
        originators: machine::Allowed::default(),
    })
}

impl Progress for EthernetIpScanner {
    fn link((_, event): (StationId, LinkEvent)) -> LinkEvent {
        event
    }

    fn progress(&self) -> u64 {
        self.counters(StationId::FIRST).received
    }
}

impl Progress for Adapter {
    fn link(event: LinkEvent) -> LinkEvent {
        event
    }
}

impl Progress for DatagramLog {
    fn link(event: LinkEvent) -> LinkEvent {
        event
    }
}

/// Runs a scanner until it has received 20 frames.
///
/// It ends without closing the connection, so the next scanner has to wait for the adapter's watchdog.
fn exchange(network: &TestNetwork, multicast: bool) {
    let config = ScannerConfig { vendor: ETHERNET_IP_VENDOR, serial_number: 1, first_id: 0x5C00_0000 };
    let connection = ConnectionConfig::exclusive_owner(ROBOT, &ETHERNET_IP_ROBOT, 2_000);
    let connection = ConnectionConfig { multicast, ..connection };
    let scanner =
        network.start(0, |_| EthernetIpScanner::new(config, vec![connection], clock::now()).unwrap());
    scanner.until(if multicast { "20 frames to its group" } else { "20 frames to the scanner alone" }, 20);
    scanner.stop();
}

/// Sets the DSCP of scheduled data, by an explicit message.
fn set_scheduled_dscp(network: &TestNetwork, dscp: u8) {
    let connect = || TcpStream::connect(SocketAddrV4::new(ROBOT, ENCAPSULATION_PORT)).unwrap();
    let mut client = network.ends[0].0.run(connect).unwrap();
    client.set_read_timeout(Some(TIMEOUT)).unwrap();
    let mut register = [0; 28];
    (register[0], register[2], register[24]) = (0x65, 4, 1);
    client.write_all(&register).unwrap();
    let mut registered = [0; 28];
    client.read_exact(&mut registered).unwrap();
    // SendRRData: null address; Set_Attribute_Single of class 48, instance 1, attribute 5.
    let cip = [0x10, 3, 0x20, 0x48, 0x24, 1, 0x30, 5, dscp];
    let mut request = vec![0x6F, 0, 16 + cip.len() as u8, 0];
    request.extend_from_slice(&registered[4..8]);
    request.resize(24 + 6, 0);
    request.extend_from_slice(&[2, 0, 0, 0, 0, 0, 0xB2, 0, cip.len() as u8, 0]);
    request.extend_from_slice(&cip);
    client.write_all(&request).unwrap();
    let mut reply = [0; 24 + 16 + 4];
    client.read_exact(&mut reply).unwrap();
    assert_eq!(reply[40..], [0x90, 0, 0, 0], "the adapter did not take the DSCP");
}

/// An IPv4 packet of the capture: sender, receiver, DSCP and kind.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct SentPacket {
    from: Ipv4Addr,
    to: Ipv4Addr,
    dscp: u8,
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Kind {
    Cyclic,
    Explicit,
}

fn packets(capture: File) -> Vec<SentPacket> {
    let mut reader = PcapNgReader::new(BufReader::new(capture)).unwrap();
    let mut packets = Vec::new();
    while let Some(block) = reader.next_block() {
        let Block::EnhancedPacket(block) = block.unwrap() else { continue };
        let frame = &*block.data;
        if frame.len() < 34 || frame[12..14] != [8, 0] {
            continue;
        }
        let address = |at: usize| Ipv4Addr::new(frame[at], frame[at + 1], frame[at + 2], frame[at + 3]);
        let ports = 14 + 4 * usize::from(frame[14] & 0xF);
        let to_port = u16::from_be_bytes([frame[ports + 2], frame[ports + 3]]);
        let from_port = u16::from_be_bytes([frame[ports], frame[ports + 1]]);
        let kind = match (frame[23], from_port, to_port) {
            (17, IO_PORT, IO_PORT) => Kind::Cyclic,
            // Only segments with data: the kernel's own segments may carry its own DSCP.
            (6, ENCAPSULATION_PORT, _) | (6, _, ENCAPSULATION_PORT) if frame.len() > ports + 60 => {
                Kind::Explicit
            }
            _ => continue,
        };
        assert_eq!(frame[15] & 3, 0, "the two bits below the DSCP are not ours");
        packets.push(SentPacket { from: address(26), to: address(30), dscp: frame[15] >> 2, kind });
    }
    packets
}

pub(crate) fn cyclic_packets_carry_the_dscp_of_the_qos_object_and_a_changed_one_from_the_next_connection_on()
{
    let network = TestNetwork::new();
    let robot = network.start(1, adapter);
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("dscp.pcapng");
    let start = || Recorder::start(&Interface::open("left0").unwrap(), &place, "", Retention::All).unwrap();
    let recorder = network.ends[0].0.run(start).unwrap();
    exchange(&network, false);
    set_scheduled_dscp(&network, 20);
    exchange(&network, true);
    recorder.stop().unwrap();
    robot.stop();
    let capture = File::open(&place).unwrap();

    let packets = packets(capture);
    let of_kind = |packets: &[SentPacket], kind| {
        packets.iter().copied().filter(|p| p.kind == kind).collect::<BTreeSet<_>>()
    };
    let packet = |from, to, dscp, kind| SentPacket { from, to, dscp, kind };
    let commands = packet(PLC, ROBOT, 47, Kind::Cyclic);
    let first_multicast = packets.iter().position(|packet| packet.to == GROUP).unwrap();
    let (before, after) = packets.split_at(first_multicast);
    let to_scanner = packet(ROBOT, PLC, 47, Kind::Cyclic);
    assert_eq!(of_kind(before, Kind::Cyclic), BTreeSet::from([commands, to_scanner]));
    let to_group = packet(ROBOT, GROUP, 20, Kind::Cyclic);
    assert_eq!(of_kind(after, Kind::Cyclic), BTreeSet::from([commands, to_group]));
    // The client that sets the DSCP is a plain socket of this test, without a DSCP.
    let of_client = packet(PLC, ROBOT, 0, Kind::Explicit);
    let of_stacks = [packet(PLC, ROBOT, 27, Kind::Explicit), packet(ROBOT, PLC, 27, Kind::Explicit)];
    assert_eq!(of_kind(&packets, Kind::Explicit), BTreeSet::from([of_client, of_stacks[0], of_stacks[1]]));
}

/// Keeps datagrams that were sent to it or its group, and those that were sent to everybody.
#[derive(Default)]
struct DatagramLog {
    own: Vec<u8>,
    to_all: Vec<u8>,
    last_received: bool,
}

/// Port that it listens to.
const LOG_PORT: u16 = 4_100;

/// The last datagram.
const LAST: u8 = b'z';

impl Machine for DatagramLog {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::Udp(LOG_PORT)]
    }

    fn handle_frame(&mut self, _: machine::Instant, _: Source, frame: &[u8]) {
        self.own.extend(frame);
        self.last_received = frame == [LAST];
    }

    fn handle_broadcast(&mut self, _: machine::Instant, _: Source, frame: &[u8]) {
        self.to_all.extend(frame);
    }

    fn group(&self, _: Port, index: usize) -> Option<Ipv4Addr> {
        (index == 0).then_some(GROUP)
    }

    fn handle_timeout(&mut self, _: machine::Instant) {}

    fn poll_transmit(&mut self, _: machine::Instant, _: &mut [u8]) -> Option<Transmit> {
        None
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        std::mem::take(&mut self.last_received).then_some(LinkEvent::Up)
    }

    fn poll_timeout(&self) -> Option<machine::Instant> {
        None
    }
}

/// Waits until somebody at the robot's end is in its group. A machine joins its groups on its own thread.
fn until_joined(network: &TestNetwork) {
    // The kernel lists an address as a number in the processor's own byte order.
    let group = format!("{:08X}", u32::from_ne_bytes(GROUP.octets()));
    let start = std::time::Instant::now();
    let groups = |_: &Interface| std::fs::read_to_string("/proc/thread-self/net/igmp").unwrap();
    while !network.run(1, groups).contains(&group) {
        assert!(start.elapsed() < TIMEOUT, "nobody joins {GROUP}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

pub(crate) fn a_machine_knows_which_datagrams_went_to_everybody_and_receives_multicasts_of_its_group_only() {
    let network = TestNetwork::new();
    let ear = |_: &Interface| DatagramLog::default();
    let mut ear = network.start(1, ear);
    until_joined(&network);
    let other_group = Ipv4Addr::new(239, 192, 1, 64);
    let send = || {
        let socket = UdpSocket::bind(SocketAddrV4::new(PLC, 0)).unwrap();
        socket.set_broadcast(true).unwrap();
        socket2::SockRef::from(&socket).bind_device(Some(b"left0")).unwrap();
        let say = |to: Ipv4Addr, byte| socket.send_to(&[byte], SocketAddrV4::new(to, LOG_PORT)).unwrap();
        say(ROBOT, b'a');
        say(Ipv4Addr::BROADCAST, b'b');
        say(Ipv4Addr::new(10, 0, 0, 255), b'c');
        say(GROUP, b'd');
        say(other_group, b'e');
        say(ROBOT, LAST);
    };
    network.ends[0].0.run(send).unwrap();
    ear.until_up();
    let ear = ear.stop();
    let DatagramLog { own, to_all, .. } = ear.driver.machine();
    assert_eq!((&own[..], &to_all[..]), (&b"adz"[..], &b"bc"[..]));
}
