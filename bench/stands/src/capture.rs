//! Captures of a virtual cable: what passes each end, as the packets that a real network would carry.
//!
//! A machine's frame is the payload of a datagram or a piece of a stream. Here it gets the headers that the kernel
//! adds in real mode (RFC 791, 768, 9293), with correct checksums and sequence numbers, so that dissectors see the
//! same connections. TCP's acknowledgements without payload are added at once; they take the cable's delay and meet
//! no fault. ARP is what the machines ask and their hosts answer; it meets no fault either. Times count from 1970-01-01 in true time, so
//! that a seed gives the same bytes on every computer.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::{Path, PathBuf};
use std::time::Duration;

use capture_file::{CableEvent, CaptureFile, Packet, Retention};
use machine::Instant;
use machine::ethernet::Mac;
use virtual_time::{Carrier, Segment, Side, Tapped};

use packet::{Ip, Tcp};

mod packet;

/// Capture at the PLC's interface, in the run directory.
pub const PLC_FILE: &str = "plc.pcapng";
/// Capture at the robot's interface, in the run directory.
pub const ROBOT_FILE: &str = "robot.pcapng";

/// Properties of a virtual cable that its captures need.
#[derive(Clone, Debug)]
pub struct CableConfig {
    /// MAC addresses of the PLC and of the robot.
    pub macs: [Mac; 2],
    /// Time that an acknowledgement takes from end to end.
    pub delay: Duration,
    /// Comment on both interfaces: the injected faults.
    pub about: String,
}

/// The captures of both ends of a virtual cable.
#[derive(Debug)]
pub struct VirtualCapture {
    config: CableConfig,
    ends: [End; 2],
    connections: BTreeMap<(SocketAddrV4, SocketAddrV4), Connection>,
    cut: bool,
    next_number: u64,
    /// The first error in writing a packet.
    broken: Option<(PathBuf, io::Error)>,
}

#[derive(Debug)]
struct End {
    file: CaptureFile,
    /// Packets that passed or will pass, by time: a retransmitted segment is announced in advance.
    waiting: BinaryHeap<Reverse<WaitingPacket>>,
    /// Comment for the next packet.
    note: Option<String>,
}

#[derive(PartialEq, Eq, PartialOrd, Ord, Debug)]
struct WaitingPacket {
    at: Instant,
    number: u64,
    sent: bool,
    comment: Option<String>,
    packet: Vec<u8>,
}

/// One direction of a TCP connection, as its sender sees it.
#[derive(Clone, Default, Debug)]
struct Connection {
    /// Sequence number of its next byte, counted from its SYN.
    next: u32,
    /// Number of bytes that the sender has received from its peer.
    received: u32,
    /// Whether it has received the peer's SYN.
    synchronised: bool,
    peer_closed: bool,
    /// Segment being filled: bytes sent at one instant leave together, as far as they fit.
    leaving: Option<Leaving>,
    /// Segments in flight, in the order in which they were sent.
    under_way: Vec<Sent>,
}

/// Sender, receiver and DSCP of a segment.
#[derive(Clone, Copy, Debug)]
struct SegmentRoute {
    from: Side,
    source: SocketAddrV4,
    to: SocketAddrV4,
    dscp: u8,
}

#[derive(Clone, Debug)]
struct Leaving {
    at: Instant,
    way: SegmentRoute,
    tcp: Tcp,
    gets_through: bool,
    comment: Option<String>,
    bytes: Vec<u8>,
}

#[derive(Clone, Debug)]
struct Sent {
    /// Sequence number behind its last byte.
    end: u32,
    flags: u8,
    packet: Vec<u8>,
}

impl VirtualCapture {
    /// Creates both captures in `directory`.
    ///
    /// # Errors
    ///
    /// A file cannot be created.
    pub fn create(directory: &Path, config: CableConfig, keep: Retention) -> io::Result<Self> {
        let files = [(PLC_FILE, "plc0"), (ROBOT_FILE, "robot0")];
        Self::create_at(directory, files.map(|(file, end)| (file.to_owned(), end.to_owned())), config, keep)
    }

    /// Creates both captures in `directory` in files with these names, of interfaces with these names.
    ///
    /// # Errors
    ///
    /// A file cannot be created.
    pub fn create_at(
        directory: &Path,
        [plc, robot]: [(String, String); 2],
        config: CableConfig,
        keep: Retention,
    ) -> io::Result<Self> {
        let end = |(file, interface): (String, String)| {
            let file = CaptureFile::create(&directory.join(file), &interface, &config.about, keep)?;
            io::Result::Ok(End { file, waiting: BinaryHeap::new(), note: None })
        };
        let ends = [end(plc)?, end(robot)?];
        Ok(Self { config, ends, connections: BTreeMap::new(), cut: false, next_number: 0, broken: None })
    }

    /// Comments a change of the cable or of a node, at both ends beside the next packet there.
    pub fn note(&mut self, note: CableEvent) {
        match note {
            CableEvent::Cut { .. } => self.cut = true,
            CableEvent::Mended => self.cut = false,
            CableEvent::Killed(_) => {}
        }
        for end in &mut self.ends {
            let before = end.note.take().map_or_else(String::new, |before| before + "; ");
            end.note = Some(before + &note.to_string());
        }
    }

    /// Records what passes an end of the cable.
    pub fn see(&mut self, tapped: &Tapped<'_>) {
        self.seal_before(tapped.at);
        let leaves = tapped.end == tapped.from;
        let comment = (!tapped.effect.is_clean()).then(|| tapped.effect.to_string());
        match tapped.carrier {
            Carrier::Ethernet => self.pass(tapped.at, tapped.end, leaves, comment, tapped.frame.to_vec()),
            Carrier::Udp { source, to } => {
                let datagram = packet::udp(source, to, tapped.frame);
                let ip = self.ip(tapped.from, *source.ip(), *to.ip(), tapped.dscp, packet::UDP);
                let mut comment = comment;
                for packet in ip.packets(&datagram) {
                    self.pass(tapped.at, tapped.end, leaves, comment.take(), packet);
                }
            }
            Carrier::Tcp { source, to, segment } => self.segment(tapped, source, to, segment, comment),
        }
        if !matches!((leaves, tapped.carrier), (true, Carrier::Tcp { .. })) {
            self.write(tapped.at);
        }
    }

    /// Writes everything that passed. After this only what passes later can be written.
    ///
    /// # Errors
    ///
    /// A file could not be written, now or earlier.
    pub fn finish(mut self) -> Result<(), (PathBuf, io::Error)> {
        let end = Instant::from_nanos(u64::MAX);
        self.seal_before(end);
        self.write(end);
        if let Some(broken) = self.broken {
            return Err(broken);
        }
        for end in self.ends {
            let path = end.file.path().to_owned();
            end.file.finish().map_err(|error| (path, error))?;
        }
        Ok(())
    }

    fn segment(
        &mut self,
        tapped: &Tapped<'_>,
        source: SocketAddrV4,
        to: SocketAddrV4,
        segment: Segment,
        comment: Option<String>,
    ) {
        let leaves = tapped.end == tapped.from;
        let (sequence, flags) = match segment {
            Segment::Connect => (0, packet::SYN),
            Segment::Accept => (0, packet::SYN | packet::ACK),
            Segment::Refuse => (0, packet::RST | packet::ACK),
            Segment::Data { offset } => (offset.wrapping_add(1), packet::PSH | packet::ACK),
            Segment::Close { offset } => (offset.wrapping_add(1), packet::FIN | packet::ACK),
        };
        if leaves {
            if segment == Segment::Connect {
                self.connections.insert((source, to), Connection::default());
                self.connections.insert((to, source), Connection::default());
            }
            let way = SegmentRoute { from: tapped.from, source, to, dscp: tapped.dscp };
            let connection = self.connections.entry((source, to)).or_default();
            let more = connection.leaving.as_mut().filter(|leaving| leaving.goes_on(tapped, sequence, flags));
            if let Some(leaving) = more {
                leaving.bytes.extend_from_slice(tapped.frame);
            } else {
                self.seal((source, to));
                let connection = self.connections.entry((source, to)).or_default();
                connection.leaving = Some(Leaving {
                    at: tapped.at,
                    way,
                    tcp: Tcp { sequence, acknowledged: connection.acknowledged(), flags },
                    gets_through: !(tapped.effect.lost || tapped.effect.cut),
                    comment,
                    bytes: tapped.frame.to_vec(),
                });
            }
            let connection = self.connections.entry((source, to)).or_default();
            let takes_one = u32::from(flags & (packet::SYN | packet::FIN) != 0);
            let next = sequence.wrapping_add(tapped.frame.len() as u32).wrapping_add(takes_one);
            // A retransmission does not advance the sequence number.
            if next.wrapping_sub(connection.next) < u32::MAX / 2 {
                connection.next = next;
            }
            return;
        }
        self.seal((source, to));
        let reached = sequence.wrapping_add(tapped.frame.len() as u32);
        let connection = self.connections.entry((source, to)).or_default();
        // A driver reads a segment in pieces; it has arrived with the last of them.
        let Some(index) =
            connection.under_way.iter().position(|sent| sent.end == reached && sent.flags == flags)
        else {
            return;
        };
        let Some(Sent { packet, .. }) = connection.under_way.drain(..=index).next_back() else { return };
        self.pass(tapped.at, tapped.end, false, comment, packet);
        self.acknowledge(tapped, source, to, segment);
    }

    /// Adds the receiver's acknowledgement of a segment that arrived.
    fn acknowledge(&mut self, tapped: &Tapped<'_>, source: SocketAddrV4, to: SocketAddrV4, segment: Segment) {
        let answering = self.connections.entry((to, source)).or_default();
        match segment {
            Segment::Connect | Segment::Refuse => {
                answering.synchronised = true;
                return;
            }
            Segment::Accept => answering.synchronised = true,
            Segment::Data { offset } => {
                answering.received = offset.wrapping_add(tapped.frame.len() as u32);
            }
            Segment::Close { .. } => answering.peer_closed = true,
        }
        let tcp =
            Tcp { sequence: answering.next, acknowledged: answering.acknowledged(), flags: packet::ACK };
        let way = SegmentRoute { from: tapped.end, source: to, to: source, dscp: tapped.dscp };
        let packet = self.tcp(way, tcp, &[]);
        self.pass(tapped.at, tapped.end, true, None, packet.clone());
        if !self.cut {
            self.pass(tapped.at + self.config.delay, tapped.end.other(), false, None, packet);
        }
    }

    /// Sends the segment that a sender was still filling.
    fn seal(&mut self, key: (SocketAddrV4, SocketAddrV4)) {
        let leaving = self.connections.get_mut(&key).and_then(|connection| connection.leaving.take());
        let Some(Leaving { at, way, tcp, gets_through, comment, bytes }) = leaving else { return };
        let packet = self.tcp(way, tcp, &bytes);
        if gets_through && let Some(connection) = self.connections.get_mut(&key) {
            let end = tcp.sequence.wrapping_add(bytes.len() as u32);
            connection.under_way.push(Sent { end, flags: tcp.flags, packet: packet.clone() });
        }
        self.pass(at, way.from, true, comment, packet);
    }

    /// Sends the segments that cannot grow any more.
    fn seal_before(&mut self, now: Instant) {
        let over: Vec<_> = self
            .connections
            .iter()
            .filter(|(_, connection)| connection.leaving.as_ref().is_some_and(|leaving| leaving.at < now))
            .map(|(key, _)| *key)
            .collect();
        over.into_iter().for_each(|key| self.seal(key));
    }

    fn tcp(&self, way: SegmentRoute, tcp: Tcp, payload: &[u8]) -> Vec<u8> {
        let SegmentRoute { from, source, to, dscp } = way;
        let ip = self.ip(from, *source.ip(), *to.ip(), dscp, packet::TCP);
        ip.packets(&tcp.segment(source, to, payload)).next().unwrap_or_default()
    }

    fn ip(&self, from: Side, source: Ipv4Addr, to: Ipv4Addr, dscp: u8, protocol: u8) -> Ip {
        let [plc, robot] = self.config.macs;
        let (own, peer) = if from == Side::A { (plc, robot) } else { (robot, plc) };
        Ip { source_mac: own, peer_mac: peer, source, to, dscp, protocol }
    }

    fn pass(&mut self, at: Instant, end: Side, sent: bool, comment: Option<String>, packet: Vec<u8>) {
        self.next_number += 1;
        let number = self.next_number;
        self.end(end).waiting.push(Reverse(WaitingPacket { at, number, sent, comment, packet }));
    }

    /// Writes what passed up to `until`.
    fn write(&mut self, until: Instant) {
        for end in &mut self.ends {
            while end.waiting.peek().is_some_and(|Reverse(passed)| passed.at <= until) {
                let Some(Reverse(passed)) = end.waiting.pop() else { break };
                let comment = match (end.note.take(), passed.comment) {
                    (Some(note), Some(comment)) => Some(format!("{note}; {comment}")),
                    (note, comment) => note.or(comment),
                };
                let written = end.file.write(&Packet {
                    since_1970: Duration::from_nanos(passed.at.as_nanos()),
                    sent: Some(passed.sent),
                    data: &passed.packet,
                    comment: comment.as_deref(),
                });
                if let Err(error) = written {
                    self.broken.get_or_insert_with(|| (end.file.path().to_owned(), error));
                }
            }
        }
    }

    const fn end(&mut self, side: Side) -> &mut End {
        let [plc, robot] = &mut self.ends;
        match side {
            Side::A => plc,
            Side::B => robot,
        }
    }
}

impl Leaving {
    /// Returns whether a piece belongs to this segment.
    fn goes_on(&self, piece: &Tapped<'_>, sequence: u32, flags: u8) -> bool {
        let clean = self.comment.is_none() && piece.effect.is_clean();
        let follows = sequence == self.tcp.sequence.wrapping_add(self.bytes.len() as u32);
        let fits = self.bytes.len() + piece.frame.len() <= usize::from(packet::MAXIMUM_SEGMENT);
        clean && fits && follows && self.at == piece.at && flags == self.tcp.flags && flags & packet::PSH != 0
    }
}

impl Connection {
    /// Returns the sequence number that it expects next, counted from the peer's SYN.
    fn acknowledged(&self) -> u32 {
        u32::from(self.synchronised).wrapping_add(self.received).wrapping_add(u32::from(self.peer_closed))
    }
}
