//! What a node needs of a bus, whichever it is: one image each way, and news of the connection.

use core::fmt;

use machine::wire::ByteOrder;
pub use machine::{Counters, Down, DownCause, LinkEvent};
use machine::{Instant, Machine};

use crate::image::Image;

/// A bus endpoint that carries one [`Image`] each way.
pub trait Fieldbus: Machine<Event = LinkEvent> {
    /// The byte order in which this bus carries numbers.
    type Order: ByteOrder;

    /// The image that goes out with the next cyclic frame and with every one after it.
    fn set_output(&mut self, image: &Image);

    /// The last image that the peer sent and marked as good; none before the first one and after the link is lost.
    fn input(&self) -> Option<Image>;

    /// Ends the connection as the standard wants it, or gives up the attempt to connect.
    fn disconnect(&mut self, now: Instant);

    /// Writes why the peer refused the last connection and what it has instead, where that is more than
    /// [`Down`] holds; otherwise nothing.
    fn explain(&self, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// What was sent, received and refused since the start.
    fn counters(&self) -> Counters;

    /// The owner did what [`LinkEvent::SetAddress`] asked for, or could not.
    fn address_set(&mut self, _now: Instant, _done: bool) {}
}
