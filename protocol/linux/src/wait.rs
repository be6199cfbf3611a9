//! The sockets that the cyclic thread waits for.
//!
//! The kernel keeps the list (epoll(7)), so a wait costs what is ready, not what is open: a PLC of 64 adapters has as many TCP
//! connections, which are idle in the cyclic phase.

use std::os::fd::{BorrowedFd, OwnedFd};
use std::time::Duration;

use rustix::buffer::spare_capacity;
use rustix::event::epoll::{self, CreateFlags, EventData, EventFlags};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// A socket to wait for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Awaited<'a> {
    pub(crate) socket: BorrowedFd<'a>,
    /// Events to wait for. Errors and hang-ups are always included.
    pub(crate) events: PollFlags,
    /// Another one for each socket of an entry: the kernel gives a new socket the number of a closed one.
    pub(crate) id: u32,
}

/// Entries for sockets, each with what occurred there last.
pub(crate) struct SocketSet {
    epoll: OwnedFd,
    entries: Vec<WaitEntry>,
    found: Vec<epoll::Event>,
}

#[derive(Clone)]
struct WaitEntry {
    /// Number of the socket that the kernel has in its list, and what it waits for.
    listed: Option<(u32, PollFlags)>,
    ready: PollFlags,
}

const VACANT: WaitEntry = WaitEntry { listed: None, ready: PollFlags::empty() };

impl SocketSet {
    /// Creates a set of vacant entries.
    pub(crate) fn new(entries: usize) -> Result<Self, Errno> {
        let epoll = epoll::create(CreateFlags::CLOEXEC)?;
        Ok(Self { epoll, entries: vec![VACANT; entries], found: Vec::with_capacity(entries) })
    }

    /// Waits for a socket in this entry from now on; `None` if the socket of this entry is closed, which the kernel has taken
    /// from its list. The set grows where a socket needs an entry beyond its end.
    pub(crate) fn set(&mut self, entry: usize, awaited: Option<Awaited<'_>>) -> Result<(), Errno> {
        if awaited.is_some() && entry >= self.entries.len() {
            self.entries.resize(entry + 1, VACANT);
            self.found.reserve(self.entries.len());
        }
        let Some(place) = self.entries.get_mut(entry) else { return Ok(()) };
        let wanted = awaited.map(|awaited| (awaited.id, awaited.events));
        if place.listed == wanted {
            return Ok(());
        }
        if let Some(Awaited { socket, events, id }) = awaited {
            let data = EventData::new_u64(entry as u64);
            let flags = EventFlags::from_bits_retain(events.bits().into());
            let is_listed = place.listed.is_some_and(|(listed, _)| listed == id);
            let added =
                if is_listed { Err(Errno::EXIST) } else { epoll::add(&self.epoll, socket, data, flags) };
            match added {
                Err(Errno::EXIST) => epoll::modify(&self.epoll, socket, data, flags)?,
                added => added?,
            }
        }
        place.listed = wanted;
        Ok(())
    }

    /// Returns the events that the last wait found for this entry; errors and hang-ups are always included.
    pub(crate) fn ready(&self, entry: usize) -> PollFlags {
        self.entries.get(entry).map_or(PollFlags::empty(), |entry| entry.ready)
    }

    /// Forgets what the last wait found and, if something may be ready, asks the kernel what is.
    fn update(&mut self, may_be_ready: bool) -> Result<(), Errno> {
        for event in self.found.drain(..) {
            if let Some(entry) = self.entries.get_mut(event.data.u64() as usize) {
                entry.ready = PollFlags::empty();
            }
        }
        if !may_be_ready {
            return Ok(());
        }
        let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
        epoll::wait(&self.epoll, spare_capacity(&mut self.found), Some(&at_once))?;
        for event in &self.found {
            if let Some(entry) = self.entries.get_mut(event.data.u64() as usize) {
                entry.ready = PollFlags::from_bits_retain({ event.flags }.bits() as u16);
            }
        }
        Ok(())
    }
}

/// The sockets of a driver.
pub(crate) struct Waits {
    /// Those of the ports, in their order.
    pub(crate) ports: SocketSet,
    /// The notifier and the sockets of TCP, in this order.
    pub(crate) others: SocketSet,
}

impl Waits {
    /// Waits until one of the sockets is ready, at most for `limit`, or for ever without a limit. With `beyond_ports` a frame at
    /// a port does not end the wait; which ports have frames is found all the same.
    pub(crate) fn wait(&mut self, beyond_ports: bool, limit: Option<Duration>) -> Result<(), Errno> {
        let mut sets = [&self.others, &self.ports].map(|set| PollFd::new(&set.epoll, PollFlags::IN));
        let awaited = sets.get_mut(..if beyond_ports { 1 } else { 2 }).unwrap_or_default();
        let limit = limit.and_then(|limit| Timespec::try_from(limit).ok());
        let waited = poll(awaited, limit.as_ref());
        let [others, ports] = sets.map(|set| !set.revents().is_empty());
        self.others.update(waited.is_ok() && others)?;
        self.ports.update(waited.is_ok() && (ports || beyond_ports))?;
        waited.map(drop)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::os::fd::{AsFd as _, OwnedFd};
    use std::os::unix::net::UnixStream;

    use super::*;

    /// Limit of waits that end at once.
    const LIMIT: Option<Duration> = Some(Duration::from_secs(10));
    const AT_ONCE: Option<Duration> = Some(Duration::ZERO);

    fn waits(ports: usize, others: usize) -> Waits {
        Waits { ports: SocketSet::new(ports).unwrap(), others: SocketSet::new(others).unwrap() }
    }

    fn readable(socket: &UnixStream, id: u32) -> Option<Awaited<'_>> {
        Some(Awaited { socket: socket.as_fd(), events: PollFlags::IN, id })
    }

    #[test]
    fn a_socket_with_the_number_of_a_closed_one_is_waited_for() {
        let mut waits = waits(0, 2);
        let (first, _peer) = UnixStream::pair().unwrap();
        let (second, mut peer) = UnixStream::pair().unwrap();
        waits.others.set(0, readable(&first, 1)).unwrap();
        // Closes the first one and gives its number to the second one, in one step: other tests open sockets meanwhile.
        let mut first = OwnedFd::from(first);
        rustix::io::dup2(&second, &mut first).unwrap();
        drop(second);
        let second = UnixStream::from(first);
        waits.others.set(0, readable(&second, 2)).unwrap();
        peer.write_all(b"x").unwrap();
        waits.wait(false, LIMIT).unwrap();
        assert_eq!(waits.others.ready(0), PollFlags::IN);
    }

    #[test]
    fn a_socket_that_moves_to_another_entry_is_found_there() {
        let mut waits = waits(0, 2);
        let (socket, mut peer) = UnixStream::pair().unwrap();
        waits.others.set(0, readable(&socket, 1)).unwrap();
        waits.others.set(1, readable(&socket, 1)).unwrap();
        waits.others.set(0, None).unwrap();
        peer.write_all(b"x").unwrap();
        waits.wait(false, LIMIT).unwrap();
        assert_eq!([waits.others.ready(0), waits.others.ready(1)], [PollFlags::empty(), PollFlags::IN]);
    }

    #[test]
    fn a_wait_beyond_the_ports_lasts_its_time_and_finds_their_frames() {
        let mut waits = waits(1, 1);
        let (port, mut station) = UnixStream::pair().unwrap();
        waits.ports.set(0, readable(&port, 0)).unwrap();
        station.write_all(b"x").unwrap();
        let before = std::time::Instant::now();
        waits.wait(true, Some(Duration::from_millis(2))).unwrap();
        assert!(before.elapsed() >= Duration::from_millis(2));
        assert_eq!(waits.ports.ready(0), PollFlags::IN);
    }

    #[test]
    fn what_was_ready_once_is_not_ready_for_ever() {
        let mut waits = waits(2, 0);
        let (quiet, _idle) = UnixStream::pair().unwrap();
        let (mut port, mut station) = UnixStream::pair().unwrap();
        waits.ports.set(0, readable(&quiet, 0)).unwrap();
        waits.ports.set(1, readable(&port, 0)).unwrap();
        station.write_all(b"x").unwrap();
        waits.wait(false, LIMIT).unwrap();
        assert_eq!([waits.ports.ready(0), waits.ports.ready(1)], [PollFlags::empty(), PollFlags::IN]);
        std::io::Read::read_exact(&mut port, &mut [0]).unwrap();
        waits.wait(false, AT_ONCE).unwrap();
        assert!(waits.ports.ready(1).is_empty());
    }

    #[test]
    fn a_socket_is_no_longer_waited_for_once_nothing_of_it_is_wanted() {
        let mut waits = waits(0, 1);
        let (listener, mut client) = UnixStream::pair().unwrap();
        waits.others.set(0, readable(&listener, 0)).unwrap();
        waits
            .others
            .set(0, Some(Awaited { socket: listener.as_fd(), events: PollFlags::empty(), id: 0 }))
            .unwrap();
        client.write_all(b"x").unwrap();
        waits.wait(false, AT_ONCE).unwrap();
        assert!(waits.others.ready(0).is_empty());
        waits.others.set(0, readable(&listener, 0)).unwrap();
        waits.wait(false, AT_ONCE).unwrap();
        assert_eq!(waits.others.ready(0), PollFlags::IN);
    }
}
