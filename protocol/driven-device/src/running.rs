//! The device as time passes: script, reports and frames.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{
    DownCause, Duration, Instant, LinkEvent, Machine, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};

use crate::device::{DriveEvent, DrivenDevice};
use crate::stack::{Stack, stack};
use crate::table::InputChange;
use crate::value::SignalValue;

/// Time between two values of the script.
const TICK: Duration = Duration::from_millis(1);

/// Largest number of events that wait for the owner.
const MOST_EVENTS: usize = 256;

impl DrivenDevice {
    fn report(&mut self, event: DriveEvent) {
        if self.events.len() < MOST_EVENTS {
            self.events.push_back(event);
        }
    }

    /// Takes over cyclic data that have arrived.
    fn follow(&mut self, now: Instant) {
        if !self.stack.poll_received() {
            return;
        }
        while self.stack.poll_received() {}
        let change = self.stack.read_inputs(&mut self.inputs);
        self.is_changed |= change == InputChange::Changed || !self.has_inputs;
        self.has_inputs = change != InputChange::Invalid;
        if self.has_inputs {
            self.arrivals.record(now);
        }
    }

    fn tick(&mut self, now: Instant) {
        if self.run_at.is_some_and(|at| at <= now) {
            self.run(true);
        }
        let seconds = now.since(self.start).as_secs_f64();
        for placed in &self.scripted {
            let value = placed.output.source().value_at(seconds);
            // A value beyond the type is refused at the start; later ones wrap or are left out.
            if let Ok(value) = SignalValue::wrapped(&placed.signal, value) {
                let _ = self.outputs.set(&placed.signal, &value);
            }
        }
        if !self.scripted.is_empty() {
            self.write_outputs();
        }
        self.follow_accesses(now);
        self.follow_alarms();
        let is_due = self.reported_at.is_none_or(|at| at + self.report_every <= now);
        if self.is_changed && self.has_inputs && is_due {
            (self.is_changed, self.reported_at) = (false, Some(now));
            self.report(DriveEvent::Inputs);
        }
    }

    fn follow_accesses(&mut self, now: Instant) {
        if let Some(asked) = self.asked.take() {
            match self.stack.answer() {
                Some(result) => self.report(DriveEvent::Answer(asked.answered(result))),
                None => self.asked = Some(asked),
            }
        }
        if self.asked.is_some() || !self.stack.is_up() {
            return;
        }
        let Some(access) = self.accesses.pop_front() else { return };
        match self.stack.access(now, &access) {
            Ok(()) => self.asked = Some(access),
            Err(reason) => self.report(DriveEvent::Answer(access.answered(Err(reason)))),
        }
    }

    fn follow_alarms(&mut self) {
        while let Some(words) = self.stack.poll_alarm(&self.file) {
            self.report(DriveEvent::Alarm(words));
        }
    }

    /// Notes an event of the connection, and what is known with it.
    fn note(&mut self, event: LinkEvent) {
        match event {
            LinkEvent::Up => {
                (self.has_been_up, self.was_lost) = (true, false);
                let identity = self.stack.identity(&self.chosen);
                self.report(DriveEvent::Identity(identity));
                for difference in self.stack.differences(&self.chosen) {
                    self.differs = true;
                    self.report(DriveEvent::Difference(difference));
                }
                self.write_outputs();
                self.report(DriveEvent::Up);
            }
            LinkEvent::Down(down) => {
                let details = self.stack.explain();
                self.was_lost |= !self.is_leaving;
                // A device that is not that of the file refuses, or is refused.
                self.differs |= down.cause == DownCause::Refused;
                self.has_inputs = false;
                self.arrivals.pause();
                if let Some(asked) = self.asked.take() {
                    // Taken also without a use for it, so that the stack accepts the next access.
                    let lost = || Err("the connection ended before the answer; ask again".to_owned());
                    let result = self.stack.answer().unwrap_or_else(lost);
                    self.report(DriveEvent::Answer(asked.answered(result)));
                }
                self.report(DriveEvent::Down(down, details));
            }
            LinkEvent::Conflict(conflict) => self.report(DriveEvent::Conflict(conflict)),
            LinkEvent::SetAddress { .. } | LinkEvent::Store | LinkEvent::Foreign(_) | LinkEvent::Owner(_) => {
            }
        }
    }
}

impl Machine for DrivenDevice {
    type Event = DriveEvent;

    fn ports(&self) -> &[PortRequest] {
        stack!(&self.stack, machine => machine.ports())
    }

    fn dscp(&self, port: Port) -> u8 {
        stack!(&self.stack, machine => machine.dscp(port))
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        stack!(&self.stack, machine => machine.group(port, index))
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        stack!(&self.stack, machine => Machine::neighbour(machine.as_ref(), address))
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        stack!(&mut self.stack, machine => machine.handle_wrong_neighbour(now, address, found));
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        stack!(&mut self.stack, machine => machine.handle_frame(now, from, frame));
        self.follow(now);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        stack!(&mut self.stack, machine => machine.handle_broadcast(now, from, frame));
        self.follow(now);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        stack!(&mut self.stack, machine => machine.handle_stream(now, stream, change));
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        stack!(&mut self.stack, machine => machine.poll_stream())
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.next_tick <= now {
            self.tick(now);
            self.next_tick = now + TICK;
        }
        stack!(&mut self.stack, machine => machine.handle_timeout(now));
        self.follow(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        stack!(&mut self.stack, machine => machine.poll_transmit(now, buf))
    }

    fn poll_event(&mut self) -> Option<DriveEvent> {
        while self.events.is_empty() {
            let event = self.stack.poll_link()?;
            self.note(event);
        }
        self.events.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Instant::earlier(Some(self.next_tick), stack!(&self.stack, machine => machine.poll_timeout()))
    }
}
