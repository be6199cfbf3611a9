//! A cable that loses, delays, duplicates and corrupts frames, and that can be cut: two veth pairs and a thread between
//! them.
//!
//! ```text
//!   one end ══ veth ══ │ forwarder: a network of its own │ ══ veth ══ other end
//!                      └ one thread, two raw sockets ┘
//! ```
//!
//! The links of the virtual cable decide what happens to each frame, by the same plan and the same seed. The thread
//! sleeps until a frame arrives or is due; it has SCHED_FIFO if the host allows it, and neither allocates, locks nor
//! logs once it runs. To know what passes the ends, give the cable an [`Observer`]: only the cable knows which fault
//! affected which frame.
//!
//! Over a veth, the kernel leaves checksums out, since no bit can flip there, and marks the frame as checked. Frames
//! that a raw socket forwards lose the mark and need their checksums. So both ends have to fill them in:
//! [`Interface::fill_in_checksums`].

mod forwarder;
mod frame;
mod observer;

use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use machine::{Duration, Instant};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use socket2::Socket;
use virtual_time::{ImpairmentPlan, LinkCounters, Side};

use crate::handover::{EndRequest, Ending};
use crate::packet_socket::{self, FrameBuffer};
use crate::recorder::RecorderError;
use crate::socket_option::{self, ON};
use crate::{Interface, Notifier, PortError, allocation, clock, scheduling};
use capture_file::CableEvent;

pub use observer::{FrameCallback, Observer};

use forwarder::{DueWork, Forwarder};
use observer::{ObservedFrame, ObserverSender, Writer};

/// Frames taken from one end before the other end gets its turn.
const BATCH: usize = 64;

/// Effect of a cut besides lost frames.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum AtCut {
    /// Nothing: both ends keep their carriers, as the ends of a cable between two switches.
    KeepsCarrier,
    /// Both ends lose their carriers until it is mended: stations that pass frames on turn them round there. Needs
    /// `CAP_NET_ADMIN`.
    LosesCarrier,
}

/// A cable that impairs frames until it is stopped or dropped.
#[derive(Debug)]
pub struct ImpairedCable {
    shared: Arc<Shared>,
    waker: Notifier,
    thread: Option<JoinHandle<u64>>,
    writer: Option<Writer>,
}

/// Result of a stopped cable.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Stopped {
    /// Counters of the frames of each sender, up to the last one.
    pub counters: [LinkCounters; 2],
    /// Allocations of its thread once it ran, if the program counts them.
    pub allocations: u64,
}

/// State shared with the thread. The parts are independent of each other, so the order of accesses does not matter.
#[derive(Debug, Default)]
struct Shared {
    end: EndRequest,
    paused: AtomicBool,
    /// When both ends were ready, by the thread's clock; 0 before.
    ready_ns: AtomicU64,
    /// Nodes that were killed and have no comment in the captures yet.
    killed: [AtomicBool; 2],
    /// [`LinkCounters`] of each sender.
    counters: [[AtomicU64; 6]; 2],
}

impl ImpairedCable {
    /// Starts to pass frames between two interfaces of this thread's network. Each is the near end of a cable to a
    /// node; the first one's node is the sender on the plan's first link. Needs `CAP_NET_RAW`.
    ///
    /// # Errors
    ///
    /// The sockets or the thread cannot be created.
    pub fn start(
        ends: [&Interface; 2],
        plan: &ImpairmentPlan,
        at_cut: AtCut,
        observers: [Observer; 2],
    ) -> Result<Self, PortError> {
        let [first, second] = ends;
        let sockets = [open(first)?, open(second)?];
        let failed = |reason| PortError::ethernet(first.name(), reason);
        let shared = Arc::new(Shared::default());
        let waker = Notifier::new().map_err(failed)?;
        let (observers, writer) = observer::start(observers, &shared).map_err(failed)?;
        let ends = ends.map(Interface::clone);
        let mut forwarding = ForwardingThread {
            sockets,
            switched: (at_cut == AtCut::LosesCarrier).then_some(ends),
            forwarder: Forwarder::new(plan),
            observers,
            shared: Arc::clone(&shared),
            notifier: waker.clone(),
        };
        let body = move || {
            // Without real-time scheduling the cable is as slow as the host is busy; the nodes report what the host
            // refuses.
            let _ = scheduling::make_real_time();
            forwarding.run()
        };
        let thread = std::thread::Builder::new().name("cable".to_owned()).spawn(body).map_err(failed)?;
        Ok(Self { shared, waker, thread: Some(thread), writer: Some(writer) })
    }

    /// Starts the times of the plan's cuts: both ends are ready.
    pub fn set_ready(&self) {
        self.shared.ready_ns.store(clock::now().as_nanos(), Ordering::Relaxed);
        self.waker.notify();
    }

    /// Adds a comment beside the next frames: the node at this end was killed.
    pub fn note_killed(&self, node: Side) {
        if let Some(killed) = self.shared.killed.get(node.index()) {
            killed.store(true, Ordering::Relaxed);
        }
        self.waker.notify();
    }

    /// Pauses the observers, or continues them.
    pub fn pause(&self, paused: bool) {
        self.shared.paused.store(paused, Ordering::Relaxed);
    }

    /// Returns what was done to the frames of each sender so far.
    #[must_use]
    pub fn counters(&self) -> [LinkCounters; 2] {
        self.shared.counters.each_ref().map(|counters| {
            let [sent, lost, duplicated, reordered, corrupted, corrupted_on_wire] =
                counters.each_ref().map(|counter| counter.load(Ordering::Relaxed));
            LinkCounters { sent, lost, duplicated, reordered, corrupted, corrupted_on_wire }
        })
    }

    /// Stops the cable. Captures that are held in memory are written only if `wanted`.
    ///
    /// # Errors
    ///
    /// A capture could not be written, or frames are missing in it.
    pub fn stop(mut self, wanted: bool) -> Result<Stopped, RecorderError> {
        self.end(if wanted { Ending::Keep } else { Ending::Discard })
    }

    fn end(&mut self, ending: Ending) -> Result<Stopped, RecorderError> {
        // The thread passes the request on to the writer with the ring's end.
        self.shared.end.set(ending);
        self.waker.notify();
        let allocations = self.thread.take().map_or(0, |thread| thread.join().unwrap_or(0));
        // The thread has ended, so the ring is complete.
        self.writer.take().map_or(Ok(()), Writer::finish)?;
        Ok(Stopped { counters: self.counters(), allocations })
    }
}

impl Drop for ImpairedCable {
    fn drop(&mut self) {
        let _ = self.end(Ending::Keep);
    }
}

fn open(interface: &Interface) -> Result<Socket, PortError> {
    let opened = packet_socket::open(interface, packet_socket::ALL, |socket| {
        socket.set_nonblocking(true)?;
        packet_socket::prepare_receive(socket)?;
        socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_IGNORE_OUTGOING, &ON)
    });
    opened.map_err(|reason| PortError::ethernet(interface.name(), reason))
}

/// What the thread between the ends works with.
struct ForwardingThread {
    sockets: [Socket; 2],
    /// Interfaces that are down while the cable is cut.
    switched: Option<[Interface; 2]>,
    forwarder: Forwarder,
    observers: ObserverSender,
    shared: Arc<Shared>,
    notifier: Notifier,
}

impl ForwardingThread {
    /// Passes frames on until it is stopped; returns how often it allocated.
    fn run(&mut self) -> u64 {
        let mut buffer = FrameBuffer::new();
        allocation::arm();
        while self.shared.end.get().is_none() {
            let limit = self.forwarder.deadline().map(|due| due.since(clock::now()));
            let Ok([is_notified, from_a, from_b]) = self.wait(limit) else { break };
            self.listen();
            if is_notified {
                self.notifier.clear();
            }
            for (from, is_ready) in [(Side::A, from_a), (Side::B, from_b)] {
                if is_ready {
                    self.take(from, &mut buffer);
                }
            }
            self.deliver();
            self.count();
        }
        let allocations = allocation::count();
        allocation::disarm();
        allocations
    }

    /// Waits for the notifier and both ends, and returns which are ready. An interruption is an early end of the wait.
    fn wait(&self, limit: Option<Duration>) -> Result<[bool; 3], Errno> {
        let [a, b] = &self.sockets;
        let mut awaited = [self.notifier.as_fd(), a.as_fd(), b.as_fd()]
            .map(|socket| PollFd::from_borrowed_fd(socket, PollFlags::IN));
        let limit = limit.and_then(|limit| Timespec::try_from(limit).ok());
        match poll(&mut awaited, limit.as_ref()) {
            Ok(_) => Ok(awaited.map(|socket| !socket.revents().is_empty())),
            Err(Errno::INTR) => Ok([false; 3]),
            Err(error) => Err(error),
        }
    }

    /// Applies what other threads asked for.
    fn listen(&mut self) {
        match self.shared.ready_ns.load(Ordering::Relaxed) {
            0 => {}
            ready => self.forwarder.set_ready(Instant::from_nanos(ready)),
        }
        for (side, killed) in [Side::A, Side::B].into_iter().zip(&self.shared.killed) {
            if killed.swap(false, Ordering::Relaxed) {
                self.observers.note(CableEvent::Killed(side));
            }
        }
    }

    fn take(&mut self, from: Side, buffer: &mut FrameBuffer) {
        for _ in 0..BATCH {
            // No frame waits, or the interface fails for a moment; if it keeps failing, the nodes notice.
            let Ok(packet) = packet_socket::receive(&self.sockets[from.index()], buffer) else { return };
            let effect = self.forwarder.take(clock::now(), from, packet.data);
            let (since_1970, at) = (packet.since_1970, clock::instant_of(packet.since_1970));
            self.observers
                .observe(ObservedFrame { at, since_1970, end: from, sent: true, effect }, packet.data);
            // Between frames, so that a batch does not delay a frame that is due.
            self.deliver();
        }
    }

    fn deliver(&mut self) {
        loop {
            let now = clock::now();
            match self.forwarder.next_due(now) {
                None => return,
                Some(DueWork::Change(note)) => {
                    self.switch_ends(note == CableEvent::Mended);
                    self.observers.note(note);
                }
                Some(DueWork::Frame { to, effect, frame }) => {
                    let since_1970 = clock::utc();
                    // A frame that the kernel refuses is lost on the cable; the receiver's counters show it.
                    let _ = self.sockets[to.index()].send(frame);
                    self.observers
                        .observe(ObservedFrame { at: now, since_1970, end: to, sent: false, effect }, frame);
                }
            }
        }
    }

    /// Takes the ends down, or brings them up: the other ends of both veth pairs lose their carriers, or get them back.
    fn switch_ends(&self, on: bool) {
        for end in self.switched.iter().flatten() {
            // Without the right to it the cable only loses frames.
            let _ = if on { end.set_up() } else { end.set_down() };
        }
    }

    fn count(&self) {
        for (shared, link) in self.shared.counters.iter().zip(self.forwarder.counters()) {
            let LinkCounters { sent, lost, duplicated, reordered, corrupted, corrupted_on_wire } = link;
            for (to, count) in
                shared.iter().zip([sent, lost, duplicated, reordered, corrupted, corrupted_on_wire])
            {
                to.store(count, Ordering::Relaxed);
            }
        }
    }
}
