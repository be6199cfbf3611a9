//! The real-time driver: one machine, its ports on one interface or several, one thread, absolute deadlines.
//!
//! A wake has five steps:
//!
//! 1. Frames, a limited batch from each port. After a stall of the host, the frames that arrived meanwhile are
//!    handled before a watchdog checks for them. A deadline that passes while they are handled is met first; the rest,
//!    beginning with the next port, on whichever interface, waits for the next wake.
//! 2. The machine's timeout, if it is due. A wake that is on time does this first, so that a frame that just arrived
//!    does not delay what is to be sent now.
//! 3. TCP, one piece of each connection, until the machine's next deadline; the rest waits for the next wake.
//! 4. The owner.
//! 5. Sleep until the machine's next deadline or a frame, whichever is first. Frames of many stations wake it together
//!    ([`Pace`]).
//!
//! After each change the driver sends everything that the machine has to send. Nothing here allocates, locks or logs.

use std::hint::spin_loop;
use std::ops::ControlFlow;
use std::os::fd::AsFd as _;

use machine::arp::ArpPacket;
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, InterfaceId, Multihomed, Port, Source, StreamRequest, Tick, Transmit};
use rustix::event::PollFlags;
use rustix::io::Errno;

use crate::interfaces::{InterfacePort, Interfaces};
use crate::neighbours::Neighbours;
use crate::pace::Pace;
use crate::stream::{StreamEvent, Streams};
use crate::wait::{Awaited, SocketSet, Waits};
use crate::{Interface, Notifier, Owner, PortError, Received, Statistics, allocation, clock};

/// Frames taken from one port before the other ports get their turn: more than arrive during a host stall of 40 ms from a
/// station with a cycle of 1 ms.
const BATCH: usize = 64;

/// Frames taken from one port in addition for each ms of a stall: those of 128 stations with that cycle. They are handled in
/// much less time than they took to arrive, so that a flood cannot make one stall lead to the next.
const BATCH_PER_MS: u128 = 128;

/// The thread wakes this long before its deadline and busy-waits for the rest. A sleep ends some 10 µs late,
/// sometimes more, sometimes less, and a frame that arrives meanwhile would be handled first.
const EARLY: Duration = Duration::from_micros(30);

/// A wake up to this late counts as on time: frames that arrived meanwhile wait until what is due was sent.
const ON_TIME: Duration = Duration::from_micros(200);

/// Entry of the notifier among the sockets that are no ports; those of TCP follow it.
const NOTIFIER: usize = 0;

/// Why the loop ended without its owner ending it.
#[derive(Debug, thiserror::Error)]
pub enum DriverError {
    /// The network adapter, or the other end of a veth pair, was removed.
    #[error("network interface `{interface}` is gone: it was removed while the node was running")]
    InterfaceGone {
        /// The interface.
        interface: String,
    },
    /// The kernel refused to wait for the sockets.
    #[error("waiting for frames: {0}")]
    Poll(Errno),
}

/// A machine with its open ports.
#[derive(Debug)]
pub struct Driver<M> {
    machine: M,
    interfaces: Interfaces,
    streams: Streams,
    notifier: Notifier,
    receive_buffer: Box<[u8; FRAME_CAPACITY]>,
    send_buffer: Box<[u8; FRAME_CAPACITY]>,
    /// What is known of the neighbours at each interface.
    neighbours: Box<[Neighbours]>,
    statistics: Statistics,
}

impl<M: Multihomed> Driver<M> {
    /// Creates a driver for a machine without starting it; `notifier` wakes it. `interfaces` is the machine's interface, or
    /// all of them in the order of their [`InterfaceId`]s; two may be the same one.
    ///
    /// Opens the machine's ports, and the TCP ports on which it accepts connections, if it has any.
    ///
    /// # Errors
    ///
    /// A port is taken, opening it is not permitted, or the machine has another number of interfaces.
    pub fn new(
        machine: M,
        interfaces: impl Into<Vec<Interface>>,
        notifier: Notifier,
    ) -> Result<Self, PortError> {
        let interfaces = Interfaces::open(&machine, interfaces.into())?;
        let streams = Streams::open(&machine, &interfaces)?;
        let neighbours = interfaces.iter().map(|_| Neighbours::new()).collect();
        Ok(Self {
            machine,
            interfaces,
            streams,
            notifier,
            receive_buffer: Box::new([0; FRAME_CAPACITY]),
            send_buffer: Box::new([0; FRAME_CAPACITY]),
            neighbours,
            statistics: Statistics::default(),
        })
    }

    /// Returns the machine.
    pub const fn machine(&self) -> &M {
        &self.machine
    }

    /// Closes the ports and returns the machine.
    pub fn into_machine(self) -> M {
        self.machine
    }

    /// Returns the driver's counters so far.
    pub const fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Runs the machine on this thread until the owner ends the loop or an interface is gone.
    pub fn run(&mut self, owner: &mut impl Owner<M>) -> Result<(), DriverError> {
        let Self {
            machine,
            interfaces,
            streams,
            notifier,
            receive_buffer,
            send_buffer,
            neighbours,
            statistics,
        } = self;
        let ports = interfaces.ports();
        let open = || -> Result<Waits, Errno> {
            let mut waits =
                Waits { ports: SocketSet::new(ports.len())?, others: SocketSet::new(1 + streams.waits())? };
            let for_frames = |socket| Some(Awaited { socket, events: PollFlags::IN, id: 0 });
            for (index, port) in ports.iter().enumerate() {
                waits.ports.set(index, for_frames(port.open.as_fd()))?;
            }
            waits.others.set(NOTIFIER, for_frames(notifier.as_fd()))?;
            Ok(waits)
        };
        let mut waits = open().map_err(DriverError::Poll)?;
        let send_buffer = &mut **send_buffer;
        let mut run = Run {
            machine,
            interfaces,
            turn: 0,
            pace: Pace::new(clock::now()),
            streams,
            send_buffer,
            neighbours,
            statistics,
            owner,
        };
        let counting = allocation::arm();
        let result = run.until_the_end(&mut waits, notifier, &mut **receive_buffer);
        statistics.allocations = counting.then(allocation::count);
        allocation::disarm();
        result
    }
}

/// Busy-waits until `wake` if it is close.
fn spin_until(wake: Option<Instant>) {
    if let Some(wake) = wake.filter(|wake| wake.since(clock::now()) <= EARLY) {
        while clock::now() < wake {
            spin_loop();
        }
    }
}

/// Returns whether this deadline passed a moment ago.
fn is_on_time(deadline: Option<Instant>) -> bool {
    let now = clock::now();
    deadline.is_some_and(|due| due <= now && now.since(due) < ON_TIME)
}

/// Returns how many frames may wait at a port after a stall, besides a batch.
fn frames_in(stall: Duration) -> usize {
    usize::try_from(stall.as_micros() * BATCH_PER_MS / 1_000).unwrap_or(usize::MAX / 2)
}

/// The parts of a driver that one wake uses.
struct Run<'a, M, O> {
    machine: &'a mut M,
    interfaces: &'a Interfaces,
    /// The port whose frames are taken first.
    turn: usize,
    pace: Pace,
    streams: &'a mut Streams,
    send_buffer: &'a mut [u8],
    neighbours: &'a mut [Neighbours],
    statistics: &'a mut Statistics,
    owner: &'a mut O,
}

impl<M: Multihomed, O: Owner<M>> Run<'_, M, O> {
    fn until_the_end(
        &mut self,
        waits: &mut Waits,
        notifier: &Notifier,
        buf: &mut [u8],
    ) -> Result<(), DriverError> {
        let mut deadline = None;
        loop {
            let (taken, sent) = (self.statistics.taken(), self.statistics.sent);
            if (is_on_time(deadline) && self.timeout(deadline.take())?.is_break())
                || self.frames(deadline, &waits.ports, buf)?.is_break()
                || self.timeout(deadline)?.is_break()
                || self.streams(&waits.others, buf)?.is_break()
                || self.wake()?.is_break()
            {
                return Ok(());
            }
            deadline = self.machine.poll_timeout();
            if self.statistics.taken() > taken && self.statistics.sent == sent {
                self.pace.count_wakeup(clock::now());
            }
            let pause = self.pace.pause(clock::now());
            let wake = [deadline, self.owner.deadline(), self.streams.deadline()].into_iter().flatten().min();
            self.streams.follow(|on| self.machine.dscp(on, Streams::UNNUMBERED));
            for InterfacePort { on, open } in self.interfaces.ports() {
                let groups = (0..).map_while(|index| self.machine.group(*on, open.port(), index));
                open.update_groups(groups);
            }
            self.streams.await_in(&mut waits.others, NOTIFIER + 1).map_err(DriverError::Poll)?;
            let now = clock::now();
            let early = wake.map(|wake| wake.since(now).saturating_sub(EARLY));
            let limit = early.into_iter().chain(pause.map(|until| until.since(now))).min();
            match waits.wait(pause.is_some(), limit) {
                Ok(()) | Err(Errno::INTR) => {}
                Err(error) => return Err(DriverError::Poll(error)),
            }
            self.statistics.wakeups += 1;
            if !waits.others.ready(NOTIFIER).is_empty() {
                notifier.clear();
            }
            spin_until(wake);
        }
    }

    /// Gives the machine the frames of all ports that have some, until a deadline passes. If `waited_for` had passed before
    /// the first frame, it waits: the host was stalled, and a port may have as many frames as came meanwhile.
    fn frames(
        &mut self,
        waited_for: Option<Instant>,
        waits: &SocketSet,
        buf: &mut [u8],
    ) -> Result<ControlFlow<()>, DriverError> {
        let (mut was_stalled, mut batch) = (None, BATCH);
        let ports = self.interfaces.ports();
        let (before, first) = ports.split_at_checked(self.turn).unwrap_or_default();
        let indexed = (self.turn..).zip(first).chain(before.iter().enumerate());
        for (index, InterfacePort { on, open: port }) in indexed {
            if waits.ready(index).is_empty() {
                continue;
            }
            let mut taken = 0;
            while taken < batch {
                taken += 1;
                match port.receive(buf) {
                    Ok(Received::Frame { len, peer, to_all }) => {
                        self.statistics.received += 1;
                        let from = Source { port: port.port(), peer };
                        let (now, frame) = (clock::now(), buf.get(..len).unwrap_or_default());
                        if from.port == Port::Ethernet && ArpPacket::from_frame(frame).is_some() {
                            self.forget_neighbours(*on);
                        }
                        if to_all {
                            self.machine.handle_broadcast(now, *on, from, frame);
                        } else {
                            self.machine.handle_frame(now, *on, from, frame);
                        }
                        if self.drain(now)?.is_break() {
                            return Ok(ControlFlow::Break(()));
                        }
                        // Usually there is one frame, after which nothing is asked.
                        match was_stalled {
                            None => {
                                let stall = waited_for.filter(|due| *due <= now).map(|due| now.since(due));
                                batch += stall.map_or(0, frames_in);
                                was_stalled = Some(stall.is_some());
                            }
                            Some(false) if self.machine.poll_timeout().is_some_and(|due| due <= now) => {
                                self.turn = (index + 1) % ports.len();
                                return Ok(ControlFlow::Continue(()));
                            }
                            Some(_) => {}
                        }
                    }
                    Ok(Received::Discarded) => self.statistics.discarded += 1,
                    Err(Errno::AGAIN) => break,
                    Err(error) => {
                        self.statistics.receive_errors += 1;
                        self.check_interface(*on, error)?;
                        break;
                    }
                }
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Calls the machine's timeout if it is due.
    fn timeout(&mut self, waited_for: Option<Instant>) -> Result<ControlFlow<()>, DriverError> {
        let now = clock::now();
        if let Some(due) = waited_for.filter(|due| *due <= now) {
            self.statistics.lateness.record(&Tick { due, lateness: now.since(due), skipped: 0 });
        }
        if self.machine.poll_timeout().is_some_and(|due| due <= now) {
            self.machine.handle_timeout(now);
            self.pace.count_deadline();
            return self.drain(now);
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Handles each TCP connection that is ready, and accepts clients.
    fn streams(&mut self, waits: &SocketSet, buf: &mut [u8]) -> Result<ControlFlow<()>, DriverError> {
        self.streams.begin_round(clock::now(), waits, NOTIFIER + 1);
        loop {
            let now = clock::now();
            match self.streams.next_event(now, buf) {
                Some(StreamEvent::Change(on, id, change)) => self.machine.handle_stream(now, on, id, change),
                Some(StreamEvent::Piece(on, id, len)) => {
                    self.statistics.received += 1;
                    let from = Source { port: Port::Stream(id), peer: None };
                    self.machine.handle_frame(now, on, from, buf.get(..len).unwrap_or_default());
                }
                None => break,
            }
            if self.drain(now)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
            if self.machine.poll_timeout().is_some_and(|due| due <= clock::now()) {
                break;
            }
        }
        self.statistics.streams = self.streams.statistics();
        Ok(ControlFlow::Continue(()))
    }

    fn wake(&mut self) -> Result<ControlFlow<()>, DriverError> {
        let now = clock::now();
        let flow = self.owner.wake(now, self.machine, self.statistics);
        let drained = self.drain(now)?;
        Ok(if flow.is_break() { flow } else { drained })
    }

    /// Sends everything that the machine has to send and reports its events, as its contract requires after each
    /// change.
    fn drain(&mut self, now: Instant) -> Result<ControlFlow<()>, DriverError> {
        let mut flow = ControlFlow::Continue(());
        loop {
            while let Some((on, transmit)) = self.machine.poll_transmit(now, self.send_buffer) {
                self.send(now, on, transmit)?;
            }
            while let Some((on, request)) = self.machine.poll_stream() {
                match request {
                    StreamRequest::Connect { to, attempt } => {
                        self.streams.connect(on, to, attempt, |id| self.machine.dscp(on, Port::Stream(id)));
                    }
                    StreamRequest::Close(id) => self.streams.close(now, id),
                }
            }
            let Some(event) = self.machine.poll_event() else {
                return Ok(flow);
            };
            if self.owner.event(now, self.machine, event).is_break() {
                flow = ControlFlow::Break(());
            }
        }
    }

    fn send(
        &mut self,
        now: Instant,
        on: InterfaceId,
        Transmit { port, to, len }: Transmit,
    ) -> Result<(), DriverError> {
        if let Some(address) = to.map(|to| *to.ip())
            && let Some(interface) = self.interfaces.get(on)
            && let Some(neighbours) = self.neighbours.get_mut(usize::from(on.0))
            && let wanted = self.machine.neighbour(on, address)
            && let Err(found) = neighbours.check(interface, address, wanted)
        {
            self.statistics.misdirected += 1;
            self.machine.handle_wrong_neighbour(now, on, address, found);
            return Ok(());
        }
        let frame = self.send_buffer.get(..len).unwrap_or_default();
        let dscp = self.machine.dscp(on, port);
        if let Port::Stream(id) = port {
            self.streams.send(id, dscp, frame);
            self.statistics.sent += 1;
            return Ok(());
        }
        let open = self.interfaces.port(on, port);
        match open.map_or(Err(Errno::NOTCONN), |open| open.send(frame, to, dscp)) {
            Ok(()) => self.statistics.sent += 1,
            Err(error) => {
                self.statistics.send_errors += 1;
                self.statistics.last_send_error = Some(error);
                self.check_interface(on, error)?;
            }
        }
        Ok(())
    }

    /// Forgets which entries of the host's table of neighbours were right, since ARP may have changed them. Interfaces of the
    /// machine that are the same one of the host share its table.
    fn forget_neighbours(&mut self, on: InterfaceId) {
        let changed = self.interfaces.get(on).map(Interface::index);
        for (interface, neighbours) in self.interfaces.iter().zip(&mut *self.neighbours) {
            if Some(interface.index()) == changed {
                neighbours.forget();
            }
        }
    }

    /// Returns an error if the interface is gone. A cable without carrier is not an error.
    fn check_interface(&self, on: InterfaceId, error: Errno) -> Result<(), DriverError> {
        if matches!(error, Errno::NXIO | Errno::NODEV | Errno::NETDOWN)
            && let Some(interface) = self.interfaces.get(on)
            && !interface.exists()
        {
            return Err(DriverError::InterfaceGone { interface: interface.name().to_owned() });
        }
        Ok(())
    }
}
