//! Devices that are up or down together, as a machine.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;

use machine::ethernet::Mac;
use machine::{Counters, Instant, LinkEvent, Machine, PortRequest, Source, Transmit};

use crate::commissioning::Commissioning;
use crate::config::Config;
use crate::foreign;
use crate::lend::lend;
use crate::operation::{PAUSE, operate};
use crate::problem::Problem;
use crate::process::{PLACE, Process};
use crate::script::Scripted;
use crate::slot::Slot;

/// Runs only in the thread of its machine, and moves to another thread together with the machine.
type Operation = Pin<Box<dyn Future<Output = ()> + Send>>;

/// A MainDevice whose devices are up or down together, as the drives of one robot: it brings them to OP and exchanges process
/// data with each cycle. When a device leaves OP, the MainDevice brings it to OP again; when no device answers, it starts
/// over. It changes nothing while another MainDevice drives the devices. [`MainDevice`](crate::MainDevice) drives each device
/// on its own.
pub struct GroupMainDevice {
    config: Config,
    slot: Option<Slot>,
    operation: Scripted<Operation>,
    /// Received frames that earlier operations could not use.
    refused_before: u64,
    /// Frames of other MainDevices that earlier operations heard.
    foreign_before: u64,
    process: Process,
}

impl fmt::Debug for GroupMainDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GroupMainDevice").field("process", &self.process).finish_non_exhaustive()
    }
}

impl GroupMainDevice {
    /// Creates a MainDevice that looks for its devices from `start` on.
    #[must_use]
    pub fn new(config: Config, start: Instant) -> Self {
        Self::at(None, config, start)
    }

    /// Creates the one that drives the device of a slot.
    pub(crate) fn at(slot: Option<Slot>, config: Config, start: Instant) -> Self {
        let process = Process::new(slot, config.output_bytes(), config.input_bytes());
        let operation = operation(&config, slot, start);
        Self { config, slot, operation, refused_before: 0, foreign_before: 0, process }
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

    /// Writes what the first device says of itself in its EEPROM; nothing before it was found.
    ///
    /// # Errors
    ///
    /// That of the writer.
    pub fn write_identity(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.process.device().map_or(Ok(()), |device| write!(words, "{device}"))
    }

    /// Returns whether the last event `Down` was about a device that is not there.
    pub(crate) fn is_missing(&self) -> bool {
        self.process.is_missing()
    }

    /// Returns what a tool for commissioning wants.
    pub(crate) fn commissioning_mut(&mut self) -> &mut Commissioning {
        self.process.commissioning()
    }

    /// Returns whether all devices are in OP and exchange process data.
    pub(crate) const fn is_up(&self) -> bool {
        self.process.is_up()
    }

    /// Returns the source address of its frames.
    pub(crate) fn source(&self) -> Mac {
        foreign::source_address(self.config.mac)
    }

    /// Returns whether an event waits for the owner.
    pub(crate) fn has_event(&self) -> bool {
        self.process.has_event()
    }

    /// Returns the next frame to send, which stays.
    pub(crate) fn next_frame(&self) -> Option<&[u8]> {
        self.operation.next_frame()
    }

    /// Removes the next frame to send.
    pub(crate) const fn drop_frame(&mut self) {
        self.operation.drop_frame();
    }

    /// Handles that another MainDevice was found on the cable.
    pub(crate) fn handle_other(&mut self, now: Instant, mac: Mac) {
        self.operation.hear_other(now, mac);
        self.handle_timeout(now);
    }

    /// Polls the operation. Some answers of devices make ethercrab panic; that must not end the PLC's process.
    fn run(&mut self, now: Instant, poll: impl FnOnce(&mut Scripted<Operation>)) {
        let poll = || lend(PLACE, &mut self.process, || poll(&mut self.operation));
        if catch_unwind(AssertUnwindSafe(poll)).is_err() {
            self.process.fail(now, Problem::Panic);
            self.refused_before += self.operation.refused();
            let start = now + PAUSE;
            self.foreign_before += self.operation.foreign();
            self.operation = operation(&self.config, self.slot, start);
        }
        if self.operation.poll_event().is_some() {
            self.process.closed();
        }
    }
}

fn operation(config: &Config, slot: Option<Slot>, start: Instant) -> Scripted<Operation> {
    let operation: Operation = Box::pin(operate(config.clone(), slot, start));
    Scripted::new(operation, start).on_interface(config.mac)
}

impl Machine for GroupMainDevice {
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
