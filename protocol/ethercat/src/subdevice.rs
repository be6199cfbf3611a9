//! A SubDevice: the chip, and the application behind it, which follows the MainDevice's requests for states and owns
//! process data and mailbox.

mod checks;
mod mail;

use alloc::boxed::Box;
use alloc::vec;

use machine::{Duration, Instant};

use crate::al::{AlState, AlStatusCode, StateMachine};
use crate::config::DeviceConfig;
use crate::description::Description;
use crate::dictionary::Dictionary;
use crate::esc::{Esc, Sync};
use crate::event::{Event, Sink};
use crate::layout::{Layout, Usage};
use crate::mailbox::{Emergency, File, Mailbox};
use crate::sii_image::image_of;

/// A SubDevice.
#[derive(Debug)]
pub(crate) struct SubDevice {
    description: &'static Description,
    checks_modules: bool,
    layout: Layout,
    pub(crate) esc: Esc,
    al: StateMachine,
    inputs: Box<[u8]>,
    outputs: Box<[u8]>,
    has_outputs: bool,
    /// An error that the MainDevice has not acknowledged keeps the outputs closed.
    is_stopped: bool,
    dictionary: Dictionary,
    mailbox: Option<Mailbox>,
    file: File,
    /// Time that the application takes for an answer.
    answer_delay: Duration,
    /// When the request in AL control is followed.
    al_due: Option<Instant>,
    /// When the message in the mailbox is answered.
    mailbox_due: Option<Instant>,
    /// Whether the MainDevice had started SYNC signals when the device came to SAFE-OP.
    uses_sync: bool,
    /// When the SYNC signals have stayed away for too long, in OP.
    sync_due: Option<Instant>,
}

impl SubDevice {
    pub(crate) fn new(config: &DeviceConfig) -> Self {
        let description = config.description;
        let layout = Layout::new(description, config.sync_managers);
        let names = (config.serial_number, config.alias);
        let image = match config.eeprom {
            [] => image_of(description, names, config.pdo_configuration, config.sync_managers),
            given => given.to_vec(),
        };
        let len = |usage| layout.len(usage);
        let clock = description.has_clocks().then_some(config.clock);
        let ram = layout.ram();
        let mut device = Self {
            description,
            checks_modules: config.checks_modules,
            layout,
            esc: Esc::new(image, config.eeprom_delay, clock, ram),
            al: StateMachine::new(),
            inputs: vec![0; len(Usage::Inputs)].into_boxed_slice(),
            outputs: vec![0; len(Usage::Outputs)].into_boxed_slice(),
            has_outputs: false,
            is_stopped: false,
            dictionary: Dictionary::new(description, config.pdo_configuration, config.serial_number),
            mailbox: description.mailbox.map(|mailbox| Mailbox::new(mailbox.len)),
            file: File::new(description.mailbox.map_or(0, |mailbox| mailbox.file_capacity)),
            answer_delay: config.answer_delay,
            al_due: None,
            mailbox_due: None,
            uses_sync: false,
            sync_due: None,
        };
        device.start();
        device
    }

    /// Sets everything except the EEPROM to its value after power-on.
    pub(crate) fn power_on(&mut self, now: Instant, sink: &mut Sink<'_>) {
        let before = self.state();
        self.esc.reset(now);
        self.al = StateMachine::new();
        (self.al_due, self.mailbox_due, self.sync_due) = (None, None, None);
        self.uses_sync = false;
        self.start();
        let (state, code) = self.state();
        if (state, code) != before {
            sink.push(Event::StateChanged { state, code });
        }
    }

    fn start(&mut self) {
        (self.has_outputs, self.is_stopped) = (false, false);
        self.reset_mailbox();
        self.show_status();
        self.lock_mailbox(true);
        self.lock_process_data(true);
    }

    pub(crate) const fn state(&self) -> (AlState, AlStatusCode) {
        (self.al.state(), self.al.error())
    }

    /// Returns the outputs, in OP once they have come.
    pub(crate) fn outputs(&self) -> Option<&[u8]> {
        (self.al.state() == AlState::Op && self.has_outputs).then_some(&self.outputs)
    }

    pub(crate) fn inputs_mut(&mut self) -> &mut [u8] {
        &mut self.inputs
    }

    pub(crate) const fn set_answer_delay(&mut self, delay: Duration) {
        self.answer_delay = delay;
    }

    pub(crate) const fn dictionary(&self) -> &Dictionary {
        &self.dictionary
    }

    pub(crate) const fn dictionary_mut(&mut self) -> &mut Dictionary {
        &mut self.dictionary
    }

    /// Returns an entry's value, as the application uses it: one that is mapped into the outputs while there are some.
    pub(crate) fn number(&self, index: u16, subindex: u8) -> Option<u64> {
        self.dictionary.number(index, subindex, &self.inputs, self.outputs().unwrap_or_default())
    }

    /// Sets an entry's value, in the inputs where it is mapped there.
    pub(crate) fn set_number(&mut self, index: u16, subindex: u8, number: u64) -> Option<()> {
        let inputs = &mut self.inputs;
        if self.dictionary.set_number((index, subindex, number), inputs, &mut self.outputs)? {
            self.publish_inputs();
        }
        Some(())
    }

    pub(crate) const fn file(&self) -> &File {
        &self.file
    }

    /// Queues an emergency. Returns whether the mailbox runs and had room.
    pub(crate) fn raise(&mut self, emergency: Emergency) -> bool {
        let running = self.al.state() >= AlState::PreOp;
        let raised = running && self.mailbox.as_mut().is_some_and(|mailbox| mailbox.raise(emergency));
        self.send_mail();
        raised
    }

    /// Passes the inputs to the chip.
    pub(crate) fn publish_inputs(&mut self) {
        if self.al.state() < AlState::SafeOp {
            return;
        }
        for (index, range) in self.layout.parts(Usage::Inputs) {
            self.esc.put(index, self.inputs.get(range).unwrap_or_default());
        }
    }

    /// Falls to SAFE-OP, or stays below it, with an error of the device itself.
    pub(crate) fn fail(&mut self, code: AlStatusCode, sink: &mut Sink<'_>) {
        self.al.fail(AlState::SafeOp, code);
        self.has_outputs = false;
        self.sync_due = None;
        self.show_status();
        self.stop_outputs();
        sink.push(Event::StateChanged { state: self.al.state(), code });
    }

    /// Closes the outputs until the MainDevice acknowledges the error, so that they do not count in the working counter
    /// (ETG.1020). A device that has none shows its error by the inputs.
    fn stop_outputs(&mut self) {
        self.is_stopped = true;
        let has_outputs = self.layout.len(Usage::Outputs) > 0;
        for (index, _) in self.layout.parts(if has_outputs { Usage::Outputs } else { Usage::Inputs }) {
            self.esc.lock(index, true);
        }
    }

    /// Handles the changes that a frame made while it passed.
    pub(crate) fn serve(&mut self, now: Instant, sink: &mut Sink<'_>) {
        let changes = self.esc.take_changes();
        if changes.reset {
            return self.power_on(now, sink);
        }
        if changes.sync_managers {
            self.watch_sync_managers(now, sink);
        }
        if changes.al_control {
            // A MainDevice that repeats its request does not make the application start over.
            self.al_due = Instant::earlier(self.al_due, Some(now + self.answer_delay));
        }
        if changes.written & self.bit(Usage::MailboxReceive) != 0 {
            self.mailbox_due = Some(now + self.answer_delay);
        }
        if changes.read & self.bit(Usage::MailboxSend) != 0 {
            self.note_read_mail();
            self.send_mail();
            // A request that waited for room for its answer.
            self.mailbox_due = self.mailbox_due.or(Some(now));
        }
        if changes.sync_managers {
            self.repeat_mail();
        }
        if self.al.state() == AlState::Op {
            for (index, range) in self.layout.parts(Usage::Outputs) {
                if changes.written & (1 << index) != 0
                    && let Some(data) = self.esc.take(index)
                    && let Some(own) = self.outputs.get_mut(range).filter(|own| own.len() == data.len())
                {
                    own.copy_from_slice(data);
                    self.has_outputs = true;
                }
            }
        }
        self.advance(now, sink);
    }

    /// Does what is due.
    pub(crate) fn advance(&mut self, now: Instant, sink: &mut Sink<'_>) {
        if self.al_due.is_some_and(|due| due <= now) {
            self.al_due = None;
            self.follow_request(now, sink);
        }
        if self.mailbox_due.is_some_and(|due| due <= now) {
            self.mailbox_due = None;
            self.receive_mail(sink);
        }
        if self.esc.watchdog_expires(now) && self.al.state() == AlState::Op && self.heeds_watchdog() {
            self.fail(AlStatusCode::WATCHDOG, sink);
        }
        while let Some((sync, system_time_ns)) = self.esc.pulse(now) {
            if self.sync_due.is_some() {
                self.sync_due = self.next_sync_due(now).or(self.sync_due);
            }
            sink.push(match sync {
                Sync::Sync0 => Event::Sync0 { system_time_ns },
                Sync::Sync1 => Event::Sync1 { system_time_ns },
            });
        }
        if self.sync_due.is_some_and(|due| due <= now) {
            self.fail(AlStatusCode::FATAL_SYNC_ERROR, sink);
        }
    }

    /// Returns when something is due.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        [self.mailbox_due, self.sync_due, self.esc.deadline()].into_iter().fold(self.al_due, Instant::earlier)
    }

    fn bit(&self, usage: Usage) -> u8 {
        self.layout.find(usage).map_or(0, |(index, _)| 1 << index)
    }

    fn follow_request(&mut self, now: Instant, sink: &mut Sink<'_>) {
        // Without the configuration from its EEPROM, the chip gives the application no access.
        if !self.esc.is_loaded() {
            return;
        }
        let (before, was_stopped) = (self.state(), self.is_stopped);
        let mut al = self.al;
        al.request(self.esc.al_control(), |state| self.check(state));
        self.al = al;
        let after = self.state();
        self.show_status();
        if before == after {
            return;
        }
        self.enter(now, before.0);
        let is_error = after.1 != AlStatusCode::NO_ERROR;
        if is_error && (was_stopped || before.0 == AlState::Op || after.1 == AlStatusCode::NO_SYNC_ERROR) {
            self.stop_outputs();
        }
        sink.push(Event::StateChanged { state: after.0, code: after.1 });
    }

    /// Starts what the device has in the new state, and stops what it does not have there.
    fn enter(&mut self, now: Instant, before: AlState) {
        let state = self.al.state();
        self.is_stopped = false;
        self.lock_process_data(state < AlState::SafeOp);
        if state == AlState::Init {
            self.lock_mailbox(true);
            self.reset_mailbox();
        } else if before == AlState::Init {
            self.start_mailbox();
        }
        self.publish_inputs();
        if state < AlState::SafeOp {
            self.uses_sync = false;
        } else if before < AlState::SafeOp {
            let period = self.esc.sync_period();
            self.uses_sync = period.is_some();
            let period_ns = period.map(|period| u64::try_from(period.as_nanos()).unwrap_or(u64::MAX));
            self.dictionary.set_synchronisation(period_ns);
        }
        self.sync_due = None;
        if state != AlState::Op {
            self.has_outputs = false;
            return;
        }
        if self.uses_sync {
            self.sync_due = self.next_sync_due(now);
        }
        if self.heeds_watchdog() {
            self.esc.start_watchdog(now);
        }
    }

    /// Returns whether the MainDevice lets the outputs trigger the watchdog. Outputs without a length, whose sync manager
    /// is off, trigger nothing, whatever its control register says.
    fn heeds_watchdog(&self) -> bool {
        let mut outputs = self.layout.parts(Usage::Outputs).filter(|(_, range)| !range.is_empty());
        outputs.any(|(index, _)| {
            let unit = self.esc.sync_manager(index);
            unit.guards() && unit.triggers_watchdog
        })
    }

    /// Returns when the SYNC signals will have stayed away for too long: two periods after the last one, or after the first
    /// one while that is still to come (the limit that Beckhoff's stack sets itself).
    fn next_sync_due(&self, now: Instant) -> Option<Instant> {
        let period = self.esc.sync_period()?;
        let first = self.esc.next_pulse().map_or(now, |next| next.max(now + period));
        Some(first + period)
    }

    pub(crate) fn lock_process_data(&mut self, locked: bool) {
        self.lock([Usage::Outputs, Usage::Inputs], locked);
    }

    fn lock(&mut self, usages: [Usage; 2], locked: bool) {
        for usage in usages {
            for (index, _) in self.layout.parts(usage) {
                self.esc.lock(index, locked);
            }
        }
    }

    fn show_status(&mut self) {
        self.esc.set_al_status(self.al.status(), self.al.error().0);
    }
}
