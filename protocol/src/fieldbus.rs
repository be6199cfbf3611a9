//! What a node needs from any bus: one image in each direction, and events of the connection.

use core::fmt;

pub use machine::{Counters, Down, DownCause, LinkEvent};
use machine::{Instant, Machine};

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

    /// Closes the connection as its standard demands, or gives up the attempt to connect.
    fn disconnect(&mut self, now: Instant);

    /// Writes why the peer refused the last connection and what it offers instead, if that is more than [`Down`]
    /// contains; otherwise writes nothing.
    fn explain(&self, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Returns the frame counters since the start.
    fn counters(&self) -> Counters;

    /// Reports the result of [`LinkEvent::SetAddress`]: whether the owner could set the address.
    fn address_set(&mut self, _now: Instant, _done: bool) {}
}
