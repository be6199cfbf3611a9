//! A cable that loses, delays, doubles, corrupts and is cut: two veth pairs and a thread between them.
//!
//! ```text
//!   one end ══ veth ══ │ middle: a network of its own │ ══ veth ══ other end
//!                      └ one thread, two raw sockets ┘
//! ```
//!
//! What becomes of a frame is decided by the links of the virtual cable, with the same plan and the same seed. The thread
//! sleeps until a frame comes or one is due, has SCHED_FIFO where the host allows it, and neither allocates, locks nor logs
//! once it runs. Whoever wants to know what passes the ends asks it, by a [`Witness`]: nobody else knows which frame met
//! with which fault.
//!
//! The kernel leaves the checksums of what it sends over a veth to a receiver that knows that nothing can go wrong there;
//! frames that come by hand need them. So both ends have to fill them in: [`Interface::fill_in_checksums`].

mod frame;
mod middle;
mod witness;

use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use machine::Instant;
use rustix::event::PollFlags;
use rustix::io::Errno;
use socket2::Socket;
use virtual_time::{LinkCounters, Side};

use crate::capture::Note;
use crate::packet_socket::{self, FrameBuffer};
use crate::recorder::RecorderError;
use crate::socket_option::{self, ON};
use crate::wait::WaitSet;
use crate::{Interface, Notifier, PortError, allocation, clock, scheduling};

pub use middle::Plan;
pub use witness::{See, Witness};

use middle::{Due, Middle};
use witness::{Passed, Teller, Writer};

/// Frames that are taken from one end before the other gets its turn.
const BATCH: usize = 64;

/// A cable that impairs frames; it does until it is stopped or let go of.
#[derive(Debug)]
pub struct ImpairedCable {
    shared: Arc<Shared>,
    waker: Notifier,
    thread: Option<JoinHandle<u64>>,
    writer: Option<Writer>,
}

/// What a cable that was stopped did.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Stopped {
    /// To the frames of each sender, until the last one.
    pub counters: [LinkCounters; 2],
    /// How often its thread allocated once it ran, where somebody counts.
    pub allocations: u64,
}

/// What the thread is shared, and what it tells. Every part stands for itself, so no order of them matters.
#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    paused: AtomicBool,
    discard: AtomicBool,
    /// When both ends were ready, by the thread's clock; 0 before.
    ready_ns: AtomicU64,
    /// Nodes that were killed and are not noted yet.
    killed: [AtomicBool; 2],
    /// [`LinkCounters`] of each sender.
    counters: [[AtomicU64; 5]; 2],
    /// Frames of which nobody was shared, since the writer was behind.
    left_out: AtomicU64,
}

impl ImpairedCable {
    /// Starts to pass frames between two interfaces of this thread's network, each the near end of a cable to a node: the
    /// first one's node is the sender of the plan's first link. Needs `CAP_NET_RAW`.
    ///
    /// # Errors
    ///
    /// The kernel does not give sockets, or a thread.
    pub fn start(ends: [&Interface; 2], plan: &Plan, witnesses: [Witness; 2]) -> Result<Self, PortError> {
        let [first, second] = ends;
        let sockets = [open(first)?, open(second)?];
        let failed = |reason| PortError::ethernet(first.name(), reason);
        let shared = Arc::new(Shared::default());
        let waker = Notifier::new().map_err(failed)?;
        let (teller, writer) = witness::start(witnesses, &shared).map_err(failed)?;
        let mut passing = Passing {
            sockets,
            middle: Middle::new(plan),
            teller,
            shared: Arc::clone(&shared),
            notifier: waker.clone(),
        };
        let body = move || {
            // Without it the cable is as slow as the host is busy; the nodes say what is refused.
            let _ = scheduling::make_real_time();
            passing.run()
        };
        let thread = std::thread::Builder::new().name("cable".to_owned()).spawn(body).map_err(failed)?;
        Ok(Self { shared, waker, thread: Some(thread), writer: Some(writer) })
    }

    /// Both ends are ready: the plan's cuts count from now.
    pub fn set_ready(&self) {
        self.shared.ready_ns.store(clock::now().as_nanos(), Ordering::Relaxed);
        self.waker.notify();
    }

    /// Says beside the next frames that the node at this end is killed.
    pub fn note_killed(&self, node: Side) {
        if let Some(killed) = self.shared.killed.get(node.index()) {
            killed.store(true, Ordering::Relaxed);
        }
        self.waker.notify();
    }

    /// Tells the witnesses nothing, or everything again.
    pub fn pause(&self, paused: bool) {
        self.shared.paused.store(paused, Ordering::Relaxed);
    }

    /// What it did to the frames of each sender so far.
    #[must_use]
    pub fn counters(&self) -> [LinkCounters; 2] {
        self.shared.counters.each_ref().map(|counters| {
            let [sent, lost, duplicated, reordered, corrupted] =
                counters.each_ref().map(|counter| counter.load(Ordering::Relaxed));
            LinkCounters { sent, lost, duplicated, reordered, corrupted }
        })
    }

    /// Ends it, with its captures where they are `wanted` or on disk already.
    ///
    /// # Errors
    ///
    /// A capture could not be written, or frames are missing in it.
    pub fn stop(mut self, wanted: bool) -> Result<Stopped, RecorderError> {
        self.shared.discard.store(!wanted, Ordering::Relaxed);
        self.end()
    }

    fn end(&mut self) -> Result<Stopped, RecorderError> {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.waker.notify();
        let allocations = self.thread.take().map_or(0, |thread| thread.join().unwrap_or(0));
        // Behind the thread's end the ring is complete.
        self.writer.take().map_or(Ok(()), Writer::finish)?;
        Ok(Stopped { counters: self.counters(), allocations })
    }
}

impl Drop for ImpairedCable {
    fn drop(&mut self) {
        let _ = self.end();
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

/// The thread between the ends.
struct Passing {
    sockets: [Socket; 2],
    middle: Middle,
    teller: Teller,
    shared: Arc<Shared>,
    notifier: Notifier,
}

impl Passing {
    /// Passes frames on until it is told to stop; returns how often it allocated.
    fn run(&mut self) -> u64 {
        let mut waits = WaitSet::new(3);
        waits.set(0, Some((self.notifier.as_fd(), PollFlags::IN)));
        for (index, socket) in self.sockets.iter().enumerate() {
            waits.set(1 + index, Some((socket.as_fd(), PollFlags::IN)));
        }
        let mut buffer = FrameBuffer::new();
        allocation::arm();
        while !self.shared.stop.load(Ordering::Relaxed) {
            let limit = self.middle.deadline().map(|due| due.since(clock::now()));
            // An interrupted wait is one that ends early.
            if !matches!(waits.wait(limit), Ok(()) | Err(Errno::INTR)) {
                break;
            }
            self.listen();
            if !waits.ready(0).is_empty() {
                self.notifier.clear();
            }
            for from in [Side::A, Side::B] {
                if !waits.ready(1 + from.index()).is_empty() {
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

    /// Takes up what it is shared.
    fn listen(&mut self) {
        match self.shared.ready_ns.load(Ordering::Relaxed) {
            0 => {}
            ready => self.middle.set_ready(Instant::from_nanos(ready)),
        }
        for (side, killed) in [Side::A, Side::B].into_iter().zip(&self.shared.killed) {
            if killed.swap(false, Ordering::Relaxed) {
                self.teller.note(Note::Killed(side));
            }
        }
    }

    fn take(&mut self, from: Side, buffer: &mut FrameBuffer) {
        for _ in 0..BATCH {
            // None waits, or the interface has a moment's trouble; if that lasts, the nodes notice.
            let Ok(packet) = packet_socket::receive(&self.sockets[from.index()], buffer) else { return };
            let fate = self.middle.take(clock::now(), from, packet.data);
            let (since_1970, at) = (packet.since_1970, clock::instant_of(packet.since_1970));
            self.teller.passed(Passed { at, since_1970, end: from, sent: true, fate }, packet.data);
            // In between, so that a batch delays nothing that is due.
            self.deliver();
        }
    }

    fn deliver(&mut self) {
        loop {
            let now = clock::now();
            match self.middle.next_due(now) {
                None => return,
                Some(Due::Change(note)) => self.teller.note(note),
                Some(Due::Frame { to, fate, frame }) => {
                    let since_1970 = clock::utc();
                    // What the kernel does not take is lost on the cable; the receiver's counters say so.
                    let _ = self.sockets[to.index()].send(frame);
                    self.teller.passed(Passed { at: now, since_1970, end: to, sent: false, fate }, frame);
                }
            }
        }
    }

    fn count(&self) {
        for (shared, LinkCounters { sent, lost, duplicated, reordered, corrupted }) in
            self.shared.counters.iter().zip(self.middle.counters())
        {
            for (to, count) in shared.iter().zip([sent, lost, duplicated, reordered, corrupted]) {
                to.store(count, Ordering::Relaxed);
            }
        }
    }
}
