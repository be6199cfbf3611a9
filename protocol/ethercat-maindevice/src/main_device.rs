//! The MainDevice as a machine.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;

use machine::{Counters, Instant, LinkEvent, Machine, PortRequest, Source, Transmit};

use crate::config::Config;
use crate::lend::lend;
use crate::operation::{PAUSE, operate};
use crate::problem::Problem;
use crate::process::{PLACE, Process};
use crate::script::Scripted;

/// Runs only in the thread of its machine, and moves to another thread together with the machine.
type Operation = Pin<Box<dyn Future<Output = ()> + Send>>;

/// A MainDevice that drives the devices of its [`Config`]: it brings them to OP and exchanges process data with each
/// cycle. When a device leaves OP, the MainDevice brings it to OP again; when no device answers, it starts over. It changes
/// nothing while another MainDevice drives the devices.
pub struct MainDevice {
    config: Config,
    operation: Scripted<Operation>,
    /// Received frames that earlier operations could not use.
    refused_before: u64,
    /// Frames of other MainDevices that earlier operations heard.
    foreign_before: u64,
    process: Process,
}

impl fmt::Debug for MainDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MainDevice").field("process", &self.process).finish_non_exhaustive()
    }
}

impl MainDevice {
    /// Creates a MainDevice that looks for its devices from `start` on.
    #[must_use]
    pub fn new(config: Config, start: Instant) -> Self {
        let process = Process::new(config.output_bytes(), config.input_bytes());
        let operation = operation(&config, start);
        Self { config, operation, refused_before: 0, foreign_before: 0, process }
    }

    /// Returns the data for the devices, in the order in which they are on the cable. They go out with the next cycle.
    pub fn outputs_mut(&mut self) -> &mut [u8] {
        &mut self.process.outputs
    }

    /// Returns the devices' data from the last good exchange; `None` unless all devices are in OP.
    #[must_use]
    pub fn inputs(&self) -> Option<&[u8]> {
        self.process.is_up().then_some(&self.process.inputs)
    }

    /// Returns the counters of process data: `sent` and `received` are exchanges. An exchange without a good reply is
    /// `lost`, and so are the cycles that pass while it waits for the reply. Replies after that are `late`; frames of other
    /// MainDevices are `foreign`.
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters {
            late: self.refused_before + self.operation.refused(),
            foreign: self.foreign_before + self.operation.foreign(),
            ..self.process.counters
        }
    }

    /// Takes the devices to INIT with the next cycle and ends; without a connection, ends at once.
    pub fn disconnect(&mut self, now: Instant) {
        if self.process.is_up() {
            self.process.leaving = true;
            self.handle_timeout(now);
        } else {
            self.operation.cancel();
            self.process.closed();
        }
    }

    /// Writes details that the last event `Down` does not contain: what was expected and what was found.
    pub fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.process.explain(words)
    }

    /// Polls the operation. Some answers of devices make ethercrab panic; that must not end the PLC's process.
    fn run(&mut self, now: Instant, poll: impl FnOnce(&mut Scripted<Operation>)) {
        let poll = || lend(PLACE, &mut self.process, || poll(&mut self.operation));
        if catch_unwind(AssertUnwindSafe(poll)).is_err() {
            self.process.fail(now, Problem::Panic);
            self.refused_before += self.operation.refused();
            let start = now + PAUSE;
            self.foreign_before += self.operation.foreign();
            self.operation = operation(&self.config, start);
        }
        if self.operation.poll_event().is_some() {
            self.process.closed();
        }
    }
}

fn operation(config: &Config, start: Instant) -> Scripted<Operation> {
    let operation: Operation = Box::pin(operate(config.clone(), start));
    Scripted::new(operation, start).on_interface(config.mac)
}

impl Machine for MainDevice {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.operation.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.run(now, |operation| operation.handle_frame(now, from, frame));
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.run(now, |operation| operation.handle_timeout(now));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.operation.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.process.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.operation.poll_timeout()
    }
}
