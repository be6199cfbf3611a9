//! The contract between a machine and whoever drives it.

use core::net::{Ipv4Addr, SocketAddrV4};

use crate::Instant;
use crate::ethernet::Mac;

/// Where frames enter and leave a machine.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub enum Port {
    /// Raw Ethernet: a frame is destination, source, an optional 802.1Q tag, EtherType and payload, without FCS.
    Ethernet,
    /// UDP over IPv4, bound to this local port, 0 for one that the driver chooses: a frame is one datagram's payload.
    Udp(u16),
    /// One TCP connection: a frame is the next piece of an ordered byte stream, cut anywhere.
    Stream(StreamId),
}

/// A port that a machine needs open.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PortRequest {
    /// Raw Ethernet, as [`Port::Ethernet`].
    Ethernet {
        /// The EtherType of the frames to receive, behind a priority tag if they have one.
        ether_type: u16,
        /// Multicast groups whose frames are received beside those for the interface's own address.
        groups: &'static [Mac],
    },
    /// UDP over IPv4, as [`Port::Udp`] with this number.
    Udp(u16),
}

/// A TCP connection, numbered by the driver and never used again for another one.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct StreamId(pub u32);

/// Where a frame came from.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Source {
    /// The port that it arrived on.
    pub port: Port,
    /// The sender's address; none on [`Port::Ethernet`], where the frame has it.
    pub peer: Option<SocketAddrV4>,
}

/// A frame that a machine wrote into the buffer it was given.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Transmit {
    /// The port that it leaves by.
    pub port: Port,
    /// The receiver's address; none on [`Port::Ethernet`] and [`Port::Stream`].
    pub to: Option<SocketAddrV4>,
    /// Length in bytes of the frame, from the buffer's start.
    pub len: usize,
}

/// What happened to a TCP connection apart from bytes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StreamChange {
    /// The connection is up, accepted from or made to this peer.
    Opened(SocketAddrV4),
    /// The connection is gone, or could not be made.
    Closed,
}

/// What a machine wants of the driver's TCP connections.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StreamRequest {
    /// Make a connection. The driver numbers it and answers by [`Machine::handle_stream`]: `Opened`, or `Closed`
    /// where it cannot be made. A machine asks for one connection at a time to a peer: a new request takes the place
    /// of one that is still under way.
    Connect {
        /// The peer to connect to.
        to: SocketAddrV4,
    },
    /// End this connection once the bytes handed out for it are sent. Nothing more is reported of it.
    Close(StreamId),
}

/// A protocol endpoint, a PLC or a robot: plain state without clock, socket, thread or async.
///
/// There are four kinds of methods. *Getters* change nothing. *Handlers* (`handle_*`) bring in what happened.
/// *Commands* (any other `&mut self` method) bring in what the owner wants. *Polls* (`poll_*`) hand out what
/// follows from it.
///
/// The order: after one handler or command, call [`poll_transmit`](Self::poll_transmit), then
/// [`poll_stream`](Self::poll_stream), then [`poll_event`](Self::poll_event), each until it returns `None`, then read
/// [`poll_timeout`](Self::poll_timeout) anew.
/// `now` never runs backwards. No handler panics, blocks, or allocates once the machine is up.
pub trait Machine {
    /// What the machine tells its owner.
    type Event;

    /// A frame arrived. Whatever is in it, the machine counts it and goes on.
    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]);

    /// A datagram arrived that was sent to every station of the network. It matters where all of them would answer at
    /// the same time; to other machines it is a frame like any other.
    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.handle_frame(now, from, frame);
    }

    /// A TCP connection opened or closed. Machines without TCP ignore it.
    fn handle_stream(&mut self, _now: Instant, _stream: StreamId, _change: StreamChange) {}

    /// The ports that the driver opens before it runs the machine. They never change. Frames of a port that is listed
    /// first are handled first.
    fn ports(&self) -> &[PortRequest];

    /// The TCP port on which the driver accepts connections for this machine, if it wants any. It never changes.
    fn listen_port(&self) -> Option<u16> {
        None
    }

    /// The next connection to make or to end. Machines without TCP want none.
    ///
    /// A peer that does not read must not stall the driver: where more than a few frames wait for one connection,
    /// the driver ends it and reports `Closed`.
    fn poll_stream(&mut self) -> Option<StreamRequest> {
        None
    }

    /// The DSCP, 0 to 63, that packets leaving by this port are to carry. The driver asks for each frame between
    /// [`poll_transmit`](Self::poll_transmit) and sending it. For TCP connections that it has not numbered yet it asks
    /// with number 0.
    fn dscp(&self, _port: Port) -> u8 {
        0
    }

    /// The multicast group whose datagrams the machine takes at this UDP port, beside those for its own address. The
    /// driver asks after each wake, and joins and leaves.
    fn group(&self, _port: Port) -> Option<Ipv4Addr> {
        None
    }

    /// The instant of [`poll_timeout`](Self::poll_timeout) has come (or passed: the driver may be late).
    fn handle_timeout(&mut self, now: Instant);

    /// Writes the next frame to send into `buf`, which holds at least [`crate::wire::FRAME_CAPACITY`] bytes.
    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit>;

    /// The next event for the owner.
    fn poll_event(&mut self) -> Option<Self::Event>;

    /// When [`handle_timeout`](Self::handle_timeout) is to be called next.
    fn poll_timeout(&self) -> Option<Instant>;
}
