//! What a node needs from any bus: one image in each direction for each connection, and events of the connections.
//!
//! A robot has one connection, by a [`Fieldbus`]. The PLC has one with each of its stations, by a [`ControllerBus`].

use core::fmt;
use core::net::Ipv4Addr;

pub use machine::{Counters, Down, DownCause, LinkEvent};
use machine::{Instant, LinkStatus, Machine};
pub use profinet::record::Maintenance;

use crate::image::{Image, Order};

/// A bus endpoint that carries one [`Image`] in each direction.
pub trait Fieldbus: Machine<Event = LinkEvent> {
    /// Returns the order in which this bus carries the bytes of a number. It never changes.
    fn byte_order(&self) -> Order;

    /// Sets the image that is sent with the next cyclic frame and every later one.
    fn set_output(&mut self, image: &Image);

    /// Returns the peer's last image that was marked as good; `None` before the first one and once the connection is
    /// lost.
    fn input(&self) -> Option<Image>;

    /// Returns whether there is an [`input`](Self::input), without a copy of it.
    fn has_input(&self) -> bool {
        self.input().is_some()
    }

    /// Closes the connection as its standard demands, or gives up the attempt to connect.
    fn disconnect(&mut self, now: Instant);

    /// Writes why the peer refused the last connection and what it offers instead, or whose connection ended, if that is more
    /// than [`Down`] contains; otherwise writes nothing.
    fn explain(&self, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Writes what is remarkable about the connection as it is: slower than asked, or held by a station that sends nothing.
    /// Otherwise writes nothing.
    fn remark(&self, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Writes who requested the connection last, what the request asked for and why it was refused; nothing before the first one.
    fn write_request(&self, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Returns the frame counters since the start.
    fn counters(&self) -> Counters;

    /// Returns the number of received frames, as [`counters`](Self::counters) does.
    fn received(&self) -> u64 {
        self.counters().received
    }

    /// Reports the result of [`LinkEvent::SetAddress`]: whether the owner could set the address.
    fn address_set(&mut self, _now: Instant, _done: bool) {}

    /// Returns whether the bus reports state and counters of its interface to others, which the owner sets by
    /// [`set_link`](Self::set_link). It never changes.
    fn wants_link(&self) -> bool {
        false
    }

    /// Sets state and counters of the interface.
    fn set_link(&mut self, _status: &LinkStatus) {}

    /// Returns what the owner has to store at [`LinkEvent::Store`].
    fn to_store(&self) -> ToStore<'_> {
        ToStore::default()
    }

    /// Reports the result of [`LinkEvent::Store`]: whether the owner could store it.
    fn stored(&mut self, _now: Instant, _done: bool) {}
}

/// A station of a [`ControllerBus`]: its number from 0, in the order in which the bus was given its stations.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default, Debug)]
pub struct StationId(pub u16);

impl StationId {
    /// The only station of a bus with one.
    pub const FIRST: Self = Self(0);
}

/// The PLC's end of a bus: one [`Image`] in each direction with each of its stations.
///
/// A station that the bus does not have has no input and no counters, and its output goes nowhere.
pub trait ControllerBus: Machine<Event = (StationId, LinkEvent)> {
    /// Returns the number of stations. It never changes.
    fn stations(&self) -> u16;

    /// Returns the order in which this bus carries the bytes of a number. It never changes.
    fn byte_order(&self) -> Order;

    /// Sets the image that a station is sent with the next cyclic frame and every later one.
    fn set_output(&mut self, station: StationId, image: &Image);

    /// Returns a station's last image that was marked as good; `None` before the first one and once the connection is lost.
    fn input(&self, station: StationId) -> Option<Image>;

    /// Returns whether a station's [`input`](Self::input) is this image: a robot that is slower than the bus repeats it, and then
    /// nobody needs a copy.
    fn repeats(&self, station: StationId, image: &Image) -> bool {
        self.input(station).is_some_and(|input| input == *image)
    }

    /// Returns the next station of which an image has arrived since the last call.
    fn poll_arrival(&mut self) -> Option<StationId>;

    /// Closes the connection to a station as the standard demands, or gives up the attempt to connect.
    fn disconnect(&mut self, now: Instant, station: StationId);

    /// Writes why a station refused the last connection, as [`Fieldbus::explain`].
    fn explain(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result;

    /// Writes what is remarkable about the connection to a station, as [`Fieldbus::remark`].
    fn remark(&self, _station: StationId, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Writes what the device of a station says of itself; nothing where it said nothing, or was not asked.
    fn write_identity(&self, _station: StationId, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Returns the frame counters of a station since the start. Frames that belong to no station count with the first one.
    fn counters(&self, station: StationId) -> Counters;

    /// Returns the number of received frames of a station, as [`counters`](Self::counters) does.
    fn received(&self, station: StationId) -> u64 {
        self.counters(station).received
    }
}

/// What the bus set permanently of its own station, so that it survives a restart. The owner removes what is not there from
/// its storage.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct ToStore<'a> {
    /// The station's name.
    pub name: Option<&'a str>,
    /// Its IP address.
    pub address: Option<StationAddress>,
    /// What the operator of the plant wrote about it.
    pub maintenance: Option<&'a Maintenance>,
}

/// An IP address with its mask and gateway.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct StationAddress {
    /// The station's own address.
    pub address: Ipv4Addr,
    /// Its subnet mask.
    pub mask: Ipv4Addr,
    /// Its gateway; 0.0.0.0 or its own address if it has none.
    pub gateway: Ipv4Addr,
}
