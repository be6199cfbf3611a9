//! The contract between a machine and its driver.

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
    /// Raw Ethernet, as [`Port::Ethernet`], whatever destination address a frame has. The interface becomes promiscuous.
    AnyEthernet {
        /// The EtherType of the frames to receive, behind a priority tag if they have one.
        ether_type: u16,
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
    /// The sender's address; `None` on [`Port::Ethernet`], where the frame contains it.
    pub peer: Option<SocketAddrV4>,
}

/// A frame that a machine wrote into the buffer it was given.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Transmit {
    /// The port to send it from.
    pub port: Port,
    /// The receiver's address; `None` on [`Port::Ethernet`] and [`Port::Stream`].
    pub to: Option<SocketAddrV4>,
    /// Length in bytes of the frame, from the buffer's start.
    pub len: usize,
}

/// A machine's own number for a TCP connection that it opens, which distinguishes it from its others.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Attempt(pub u16);

/// A change of a TCP connection's state.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StreamChange {
    /// This peer connected at [`Machine::listen_port`].
    Accepted(SocketAddrV4),
    /// The requested connection is open.
    Connected(Attempt),
    /// The requested connection could not be made.
    NotConnected(Attempt),
    /// An open connection was closed.
    Closed,
}

/// A machine's request about TCP connections.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StreamRequest {
    /// Make a connection. The driver numbers it and reports `Connected` or `NotConnected` by [`Machine::handle_stream`].
    /// A new request with the same attempt replaces one that is not open yet.
    Connect {
        /// The peer to connect to.
        to: SocketAddrV4,
        /// The machine's own number for it.
        attempt: Attempt,
    },
    /// Close this connection once the bytes handed out for it are sent. The driver reports nothing more about it.
    Close(StreamId),
}

/// Frame, request and event that a machine may have for its driver. It has none of a kind that is not set.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Pending {
    /// A frame for [`Machine::poll_transmit`].
    pub frame: bool,
    /// A request for [`Machine::poll_stream`].
    pub request: bool,
    /// An event for [`Machine::poll_event`].
    pub event: bool,
}

impl Pending {
    /// It may have anything.
    pub const ANYTHING: Self = Self { frame: true, request: true, event: true };
}

/// A protocol endpoint, a PLC or a robot: plain state without clock, socket, thread or async.
///
/// There are four kinds of methods. *Getters* change nothing. *Handlers* (`handle_*`) report what happened to the
/// machine. *Commands* (any other `&mut self` method) tell it what the owner wants. *Polls* (`poll_*`) return what
/// follows.
///
/// The order: after one handler or command, call [`poll_transmit`](Self::poll_transmit), then
/// [`poll_stream`](Self::poll_stream), then [`poll_event`](Self::poll_event), each until it returns `None`, then read
/// [`poll_timeout`](Self::poll_timeout) again. `now` never runs backwards. No handler panics, blocks, or allocates
/// once the connection is up.
pub trait Machine {
    /// What the machine reports to its owner.
    type Event;

    /// Handles a received frame. If the machine cannot use it, the machine counts it and goes on.
    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]);

    /// Handles a datagram that was sent to every station of the network. This matters only to a machine that must not
    /// answer at the same time as all others; by default it is handled like any frame.
    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.handle_frame(now, from, frame);
    }

    /// Handles the opening or closing of a TCP connection. Machines without TCP ignore it.
    fn handle_stream(&mut self, _now: Instant, _stream: StreamId, _change: StreamChange) {}

    /// Returns the ports that the driver opens before it runs the machine. They never change. Frames of a port that
    /// is listed first are handled first.
    fn ports(&self) -> &[PortRequest];

    /// Returns the TCP port on which the driver accepts connections for this machine, if any. It never changes.
    fn listen_port(&self) -> Option<u16> {
        None
    }

    /// Returns the next connection to make or to close. Machines without TCP return `None`.
    ///
    /// A peer that does not read must not stall the driver: if more than a few frames wait for one connection, the
    /// driver closes it and reports `Closed`.
    fn poll_stream(&mut self) -> Option<StreamRequest> {
        None
    }

    /// Returns the DSCP, 0 to 63, of packets that leave by this port. The driver asks for each frame between
    /// [`poll_transmit`](Self::poll_transmit) and sending it. For TCP connections that it has not numbered yet, it
    /// asks with number 0.
    fn dscp(&self, _port: Port) -> u8 {
        0
    }

    /// Returns a multicast group whose datagrams the machine receives at this UDP port, besides those for its own
    /// address: the first group at index 0, and `None` behind the last one. The driver asks after each wake, and joins
    /// and leaves groups accordingly.
    fn group(&self, _port: Port, _index: usize) -> Option<Ipv4Addr> {
        None
    }

    /// Returns the MAC address at which datagrams to this IP address must arrive; `None` if whoever has the address may get
    /// them, as for a station that was found by its IP address alone.
    ///
    /// The driver asks before each datagram. If the host would send to another MAC address, because its table of neighbours
    /// is out of date or another station has the same IP address, the driver corrects the table. Where it may not, it sends
    /// nothing and calls [`handle_wrong_neighbour`](Self::handle_wrong_neighbour).
    fn neighbour(&self, _address: Ipv4Addr) -> Option<Mac> {
        None
    }

    /// Handles that a datagram was not sent: the host would send it to `found`, and not to the station that
    /// [`neighbour`](Self::neighbour) returned.
    fn handle_wrong_neighbour(&mut self, _now: Instant, _address: Ipv4Addr, _found: Mac) {}

    /// Handles the timeout: the instant of [`poll_timeout`](Self::poll_timeout) has come, or passed if the driver is
    /// late.
    fn handle_timeout(&mut self, now: Instant);

    /// Returns what the machine may have for the polls below. A driver may leave out those of what it does not have; this costs less
    /// than asking. By default it may have anything.
    fn pending(&self, _now: Instant) -> Pending {
        Pending::ANYTHING
    }

    /// Writes the next frame to send into `buf`, which holds at least [`crate::wire::FRAME_CAPACITY`] bytes.
    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit>;

    /// Returns the next event for the owner.
    fn poll_event(&mut self) -> Option<Self::Event>;

    /// Returns when to call [`handle_timeout`](Self::handle_timeout) next.
    fn poll_timeout(&self) -> Option<Instant>;
}

/// Implements what a [`Machine`] asks the driver for (ports, connections, DSCP, groups, neighbours) by passing on what one of its
/// fields asks for. For a machine that contains another one:
///
/// ```
/// use machine::{Instant, Machine, Source, Transmit};
///
/// struct Counting<M> {
///     inner: M,
///     frames: u64,
/// }
///
/// impl<M: Machine> Machine for Counting<M> {
///     type Event = M::Event;
///
///     machine::forward_ports!(inner);
///
///     fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
///         self.frames += 1;
///         self.inner.handle_frame(now, from, frame);
///     }
///
///     fn handle_timeout(&mut self, now: Instant) {
///         self.inner.handle_timeout(now);
///     }
///
///     fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
///         self.inner.poll_transmit(now, buf)
///     }
///
///     fn poll_event(&mut self) -> Option<Self::Event> {
///         self.inner.poll_event()
///     }
///
///     fn poll_timeout(&self) -> Option<Instant> {
///         self.inner.poll_timeout()
///     }
/// }
/// ```
#[macro_export]
macro_rules! forward_ports {
    ($inner:ident) => {
        fn ports(&self) -> &[$crate::PortRequest] {
            $crate::Machine::ports(&self.$inner)
        }

        fn listen_port(&self) -> Option<u16> {
            $crate::Machine::listen_port(&self.$inner)
        }

        fn poll_stream(&mut self) -> Option<$crate::StreamRequest> {
            $crate::Machine::poll_stream(&mut self.$inner)
        }

        fn dscp(&self, port: $crate::Port) -> u8 {
            $crate::Machine::dscp(&self.$inner, port)
        }

        fn group(&self, port: $crate::Port, index: usize) -> Option<core::net::Ipv4Addr> {
            $crate::Machine::group(&self.$inner, port, index)
        }

        fn neighbour(&self, address: core::net::Ipv4Addr) -> Option<$crate::ethernet::Mac> {
            $crate::Machine::neighbour(&self.$inner, address)
        }
    };
}
