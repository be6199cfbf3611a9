//! A driver on a thread of its own: commands go in and notices come out through wait-free rings.

use std::ops::ControlFlow;
use std::sync::mpsc;
use std::thread::JoinHandle;

use machine::{Instant, Multihomed};

use crate::handover::{Received, Receiver, Sender, ring};
use crate::{Driver, DriverError, NoticeSender, Notifier, Owner, Statistics, scheduling};

/// Largest number of commands, and of notices, that a ring holds.
const RING_CAPACITY: usize = 64;

/// What the owner of a machine does on the cyclic thread. Like [`Owner`], a task must not block, allocate, lock or
/// log.
pub trait Task<M: Multihomed>: Send + 'static {
    /// What another thread sends to the task.
    type Command: Send + 'static;
    /// What the task reports to another thread.
    type Notice: Send + 'static;

    /// Handles a command; `statistics` are the driver's so far. `Break` ends the thread. A task that does not
    /// implement this ends at its first command.
    fn command(
        &mut self,
        _now: Instant,
        _machine: &mut M,
        _statistics: &Statistics,
        _command: Self::Command,
        _notices: &mut NoticeSender<Self::Notice>,
    ) -> ControlFlow<()> {
        ControlFlow::Break(())
    }

    /// Handles an event of the machine. `Break` ends the thread once everything is sent.
    fn event(
        &mut self,
        now: Instant,
        machine: &mut M,
        event: M::Event,
        notices: &mut NoticeSender<Self::Notice>,
    ) -> ControlFlow<()>;

    /// Handles the instant of [`deadline`](Self::deadline). `Break` ends the thread.
    fn expired(&mut self, _now: Instant, _machine: &mut M) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    /// Inspects the machine after it did what was due, for records.
    fn inspect(&mut self, _now: Instant, _machine: &M) {}

    /// Returns when to call [`expired`](Self::expired), if at all.
    fn deadline(&self) -> Option<Instant> {
        None
    }
}

/// The cyclic thread is 64 commands behind, or it ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the cyclic thread takes no more commands: it is far behind, or it ended")]
pub struct RingFull;

/// Why the thread did not start.
#[derive(Debug, thiserror::Error)]
#[error("starting the cyclic thread: {reason}")]
pub struct StartError {
    reason: std::io::Error,
}

impl From<std::io::Error> for StartError {
    fn from(reason: std::io::Error) -> Self {
        Self { reason }
    }
}

/// A running driver and the rings to its thread.
#[derive(Debug)]
pub struct CyclicThread<M, T: Task<M>>
where
    M: Multihomed,
{
    commands: Sender<T::Command>,
    notices: Receiver<T::Notice>,
    waker: Notifier,
    warning: Option<String>,
    thread: JoinHandle<Ended<M, T>>,
}

/// What the thread itself returns.
#[derive(Debug)]
struct Ended<M, T> {
    driver: Driver<M>,
    task: T,
    result: Result<(), DriverError>,
}

/// What a cyclic thread returns when it ends.
#[derive(Debug)]
pub struct Finished<M, T> {
    /// The driver, with the machine and its statistics.
    pub driver: Driver<M>,
    /// The task, with the data that it collected.
    pub task: T,
    /// Notices dropped because the ring was full.
    pub notices_dropped: u64,
    /// How the loop ended.
    pub result: Result<(), DriverError>,
}

impl<M, T> CyclicThread<M, T>
where
    M: Multihomed + Send + 'static,
    T: Task<M>,
{
    /// Starts the loop. `waker` is the notifier that the driver was created with; `reader` is notified of notices and of
    /// the end.
    pub fn start(driver: Driver<M>, task: T, waker: Notifier, reader: Notifier) -> Result<Self, StartError> {
        let (commands, command_ring) = ring(RING_CAPACITY);
        let (notice_ring, notices) = ring(RING_CAPACITY);
        let (started, start) = mpsc::sync_channel(1);
        let mut owner =
            RingOwner { task, commands: command_ring, notices: NoticeSender::new(notice_ring, reader) };
        let body = move || {
            let _ = started.send(scheduling::make_real_time().refused());
            let mut driver = driver;
            let result = driver.run(&mut owner);
            Ended { driver, task: owner.task, result }
        };
        let thread = std::thread::Builder::new().name("cyclic".to_owned()).spawn(body)?;
        // `start` has no message only if the thread panics before its first line.
        let warning = start.recv().ok().flatten();
        Ok(Self { commands, notices, waker, warning, thread })
    }

    /// Returns what the host refused the thread and how to allow it.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// Sends a command to the task.
    pub fn send(&mut self, command: T::Command) -> Result<(), RingFull> {
        let result = self.commands.send(command).map_err(|_| RingFull);
        self.waker.notify();
        result
    }

    /// Takes the next notice, if there is any. It ends when the loop has ended and all notices are read.
    pub fn next_notice(&mut self) -> Received<T::Notice> {
        self.notices.take()
    }

    /// Waits until the loop ends. The error is a panic on the cyclic thread.
    pub fn join(self) -> std::thread::Result<Finished<M, T>> {
        let Self { notices, thread, .. } = self;
        let Ended { driver, task, result } = thread.join()?;
        Ok(Finished { driver, task, notices_dropped: notices.dropped(), result })
    }
}

struct RingOwner<M: Multihomed, T: Task<M>> {
    task: T,
    commands: Receiver<T::Command>,
    notices: NoticeSender<T::Notice>,
}

impl<M: Multihomed, T: Task<M>> Owner<M> for RingOwner<M, T> {
    fn wake(&mut self, now: Instant, machine: &mut M, statistics: &Statistics) -> ControlFlow<()> {
        self.task.inspect(now, machine);
        // One command per wake: the machine's contract requires that everything is sent between two changes.
        if let Received::Item(command) = self.commands.take() {
            self.task.command(now, machine, statistics, command, &mut self.notices)?;
        }
        if self.task.deadline().is_some_and(|deadline| deadline <= now) {
            self.task.expired(now, machine)?;
        }
        ControlFlow::Continue(())
    }

    fn event(&mut self, now: Instant, machine: &mut M, event: M::Event) -> ControlFlow<()> {
        self.task.event(now, machine, event, &mut self.notices)
    }

    fn deadline(&self) -> Option<Instant> {
        // While a command is pending, the thread does not sleep.
        if self.commands.is_empty() { self.task.deadline() } else { Some(Instant::ZERO) }
    }
}
