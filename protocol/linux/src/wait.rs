//! The sockets that the cyclic thread waits for: a list whose entries are reused.

use std::os::fd::{AsRawFd, BorrowedFd};
use std::time::Duration;

use rustix::event::PollFlags;
use rustix::io::Errno;

/// An entry without a socket: the kernel ignores negative descriptors.
const VACANT: libc::pollfd = libc::pollfd { fd: -1, events: 0, revents: 0 };

/// Entries for sockets, each with the events it is waited for and those that occurred.
#[derive(Debug)]
pub(crate) struct WaitSet {
    places: Vec<libc::pollfd>,
}

impl WaitSet {
    /// Creates a set of vacant entries.
    pub(crate) fn new(places: usize) -> Self {
        Self { places: vec![VACANT; places] }
    }

    /// Waits for `what` on this socket from now on, or for nothing in this entry. The set grows where a socket needs an entry
    /// beyond its end.
    pub(crate) fn set(&mut self, place: usize, what: Option<(BorrowedFd<'_>, PollFlags)>) {
        if what.is_some() && place >= self.places.len() {
            self.places.resize(place + 1, VACANT);
        }
        if let Some(entry) = self.places.get_mut(place) {
            *entry = what.map_or(VACANT, |(socket, events)| libc::pollfd {
                fd: socket.as_raw_fd(),
                events: events.bits() as libc::c_short,
                revents: 0,
            });
        }
    }

    /// Returns the events that the last wait found for this entry; errors and hang-ups are always included.
    pub(crate) fn ready(&self, place: usize) -> PollFlags {
        self.places
            .get(place)
            .map_or(PollFlags::empty(), |entry| PollFlags::from_bits_retain(entry.revents as u16))
    }

    /// Waits until one of the sockets is ready, at most for `limit`, or for ever without a limit.
    pub(crate) fn wait(&mut self, limit: Option<Duration>) -> Result<(), Errno> {
        self.wait_beyond(0, limit)
    }

    /// Waits like [`wait`](Self::wait), but not for the first `passed_over` entries. They count as ready, since nobody knows.
    pub(crate) fn wait_beyond(&mut self, passed_over: usize, limit: Option<Duration>) -> Result<(), Errno> {
        let limit = limit.map(|limit| libc::timespec {
            tv_sec: limit.as_secs().try_into().unwrap_or(libc::time_t::MAX),
            tv_nsec: limit.subsec_nanos().into(),
        });
        let limit = limit.as_ref().map_or(std::ptr::null(), std::ptr::from_ref);
        // The kernel reads every entry, so vacant ones at the end are left out.
        let used = self.places.iter().rposition(|entry| entry.fd >= 0).map_or(0, |last| last + 1);
        let (passed_over, awaited) = self.places.split_at_mut(passed_over.min(used));
        for entry in passed_over.iter_mut() {
            entry.revents = entry.events;
        }
        let used = used - passed_over.len();
        // SAFETY: the first `used` entries exist and nobody else borrows them; the kernel reads them and writes their
        // `revents`, only during the call. `limit` is null or points to a `timespec` that outlives the call.
        let result =
            unsafe { libc::ppoll(awaited.as_mut_ptr(), used as libc::nfds_t, limit, std::ptr::null()) };
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
