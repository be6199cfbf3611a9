//! What the cyclic thread waits for: a list of sockets of fixed length, whose places change hands.

use std::os::fd::{AsRawFd, BorrowedFd};
use std::time::Duration;

use rustix::event::PollFlags;
use rustix::io::Errno;

/// A place without a socket: the kernel passes over negative numbers.
const VACANT: libc::pollfd = libc::pollfd { fd: -1, events: 0, revents: 0 };

/// Places for sockets, each with what it is waited for and what came of it.
#[derive(Debug)]
pub(crate) struct WaitSet {
    places: Box<[libc::pollfd]>,
}

impl WaitSet {
    /// A set with so many vacant places.
    pub(crate) fn new(places: usize) -> Self {
        Self { places: vec![VACANT; places].into_boxed_slice() }
    }

    /// Waits for `what` on this socket from now on, or for nothing at that place.
    pub(crate) fn set(&mut self, place: usize, what: Option<(BorrowedFd<'_>, PollFlags)>) {
        if let Some(entry) = self.places.get_mut(place) {
            *entry = what.map_or(VACANT, |(socket, events)| libc::pollfd {
                fd: socket.as_raw_fd(),
                events: events.bits() as libc::c_short,
                revents: 0,
            });
        }
    }

    /// What the last wait brought at this place; errors and hang-ups are among it unasked.
    pub(crate) fn ready(&self, place: usize) -> PollFlags {
        self.places
            .get(place)
            .map_or(PollFlags::empty(), |entry| PollFlags::from_bits_retain(entry.revents as u16))
    }

    /// Waits until one of the sockets is ready, for as long as this at most; for ever without a limit.
    pub(crate) fn wait(&mut self, limit: Option<Duration>) -> Result<(), Errno> {
        let limit = limit.map(|limit| libc::timespec {
            tv_sec: limit.as_secs().try_into().unwrap_or(libc::time_t::MAX),
            tv_nsec: limit.subsec_nanos().into(),
        });
        let limit = limit.as_ref().map_or(std::ptr::null(), std::ptr::from_ref);
        // The kernel looks at every place, so the vacant ones at the end stay out.
        let used = self.places.iter().rposition(|entry| entry.fd >= 0).map_or(0, |last| last + 1);
        // SAFETY: the first `used` entries are there and nobody else holds them; the kernel reads them and writes
        // their `revents`, during the call only. `limit` is null or points to a `timespec` that lives longer.
        let result =
            unsafe { libc::ppoll(self.places.as_mut_ptr(), used as libc::nfds_t, limit, std::ptr::null()) };
        if result >= 0 {
            return Ok(());
        }
        let error = Errno::from_io_error(&std::io::Error::last_os_error()).unwrap_or(Errno::IO);
        for entry in &mut self.places {
            entry.revents = 0;
        }
        Err(error)
    }
}
