//! The devices as time passes: script, reports and frames.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{
    DownCause, Duration, Instant, LinkEvent, Machine, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};

use crate::bus::DrivenBus;
use crate::device::{DriveEvent, DrivenDevice};
use crate::earlier;
use crate::parameter::ParameterAccess;
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

    /// Takes over cyclic data that have arrived for the device of this number.
    fn follow(&mut self, now: Instant, stack: &Stack, number: usize) {
        let change = stack.read_inputs(number, &mut self.inputs);
        self.is_changed |= change == InputChange::Changed || !self.has_inputs;
        self.has_inputs = change != InputChange::Invalid;
        if self.has_inputs {
            self.arrivals.record(now);
        }
    }

    /// Gives the outputs to the stack.
    pub(crate) fn write_outputs(&mut self, stack: &mut Stack, number: usize) {
        self.is_written = true;
        stack.write_outputs(number, &self.outputs, self.is_running);
    }

    fn tick(&mut self, now: Instant, stack: &mut Stack, number: usize) {
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
        if !self.scripted.is_empty() || !self.is_written {
            self.write_outputs(stack, number);
        }
        (self.is_up, self.counters) = (stack.is_up(number), stack.counters(number));
        self.follow_accesses(now, stack, number);
        while let Some(words) = stack.poll_alarm(number, &self.file) {
            self.report(DriveEvent::Alarm(words));
        }
        let is_due = self.reported_at.is_none_or(|at| at + self.report_every <= now);
        if self.is_changed && self.has_inputs && is_due {
            (self.is_changed, self.reported_at) = (false, Some(now));
            self.report(DriveEvent::Inputs);
        }
    }

    fn follow_accesses(&mut self, now: Instant, stack: &mut Stack, number: usize) {
        if let Some(asked) = self.asked.take() {
            match stack.answer(number) {
                Some(result) if asked.is_diagnosis => self.note_earlier(&asked, result),
                Some(result) => self.report(DriveEvent::Answer(asked.answered(result))),
                None => self.asked = Some(asked),
            }
        }
        if self.asked.is_some() || !self.is_up {
            return;
        }
        let Some(access) = self.accesses.pop_front() else { return };
        match stack.access(now, number, &access) {
            Ok(()) => self.asked = Some(access),
            Err(_) if access.is_diagnosis => {}
            Err(reason) => self.report(DriveEvent::Answer(access.answered(Err(reason)))),
        }
    }

    /// Notes the answer to a read of what was wrong before the connection. A device need not have it, so a refusal is nothing.
    fn note_earlier(&mut self, asked: &ParameterAccess, result: Result<Vec<u8>, String>) {
        let Ok(bytes) = result else { return };
        let earlier = earlier::read(&self.file, &self.chosen, &asked.parameter.target, &bytes);
        earlier.words.into_iter().for_each(|words| self.report(DriveEvent::Earlier(words)));
        for difference in earlier.differences {
            self.differs = true;
            self.report(DriveEvent::Difference(difference));
        }
        earlier.reads.into_iter().rev().for_each(|read| self.accesses.push_front(read));
    }

    /// Notes an event of the connection, and what is known with it.
    fn note(&mut self, event: LinkEvent, stack: &mut Stack, number: usize) {
        match event {
            LinkEvent::Up => {
                (self.has_been_up, self.was_lost) = (true, false);
                let identity = stack.identity(number, &self.chosen);
                self.report(DriveEvent::Identity(identity));
                for difference in stack.differences(number, &self.chosen) {
                    self.differs = true;
                    self.report(DriveEvent::Difference(difference));
                }
                self.write_outputs(stack, number);
                self.accesses.retain(|access| !access.is_diagnosis);
                let first = earlier::first(&self.chosen);
                first.into_iter().rev().for_each(|read| self.accesses.push_front(read));
                self.report(if stack.is_null(number) { DriveEvent::Configured } else { DriveEvent::Up });
            }
            LinkEvent::Down(down) => {
                let details = stack.explain(number);
                self.was_lost |= !self.is_leaving;
                // A device that is not that of the file refuses, or is refused.
                self.differs |= down.cause == DownCause::Refused;
                self.has_inputs = false;
                self.arrivals.pause();
                if let Some(asked) = self.asked.take_if(|asked| asked.is_diagnosis) {
                    // Taken, so that the stack accepts the next access; it is asked again after the next connection.
                    drop((asked, stack.answer(number)));
                }
                if let Some(asked) = self.asked.take() {
                    // Taken also without a use for it, so that the stack accepts the next access.
                    let lost = || Err("the connection ended before the answer; ask again".to_owned());
                    let result = stack.answer(number).unwrap_or_else(lost);
                    self.report(DriveEvent::Answer(asked.answered(result)));
                }
                self.report(DriveEvent::Down(down, details));
            }
            LinkEvent::Conflict(conflict) => self.report(DriveEvent::Conflict(conflict)),
            // The alarms themselves are reported.
            LinkEvent::SetAddress { .. }
            | LinkEvent::Store
            | LinkEvent::Foreign(_)
            | LinkEvent::Owner(_)
            | LinkEvent::Health => {}
        }
        (self.is_up, self.counters) = (stack.is_up(number), stack.counters(number));
    }
}

impl DrivenBus {
    /// Takes over cyclic data that have arrived.
    fn follow(&mut self, now: Instant) {
        let mut received = self.stack.poll_received();
        while let Some(number) = received {
            received = self.stack.poll_received();
            // A device whose data came twice has only the newer ones.
            if let Some(device) = self.devices.get_mut(number).filter(|_| received != Some(number)) {
                device.follow(now, &self.stack, number);
            }
        }
    }
}

impl Machine for DrivenBus {
    type Event = (usize, DriveEvent);

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
            for (number, device) in self.devices.iter_mut().enumerate() {
                device.tick(now, &mut self.stack, number);
            }
            self.next_tick = now + TICK;
        }
        stack!(&mut self.stack, machine => machine.handle_timeout(now));
        self.follow(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if std::mem::take(&mut self.is_touched) {
            for (number, device) in self.devices.iter_mut().enumerate().filter(|(_, it)| !it.is_written) {
                device.write_outputs(&mut self.stack, number);
            }
        }
        stack!(&mut self.stack, machine => machine.poll_transmit(now, buf))
    }

    fn poll_event(&mut self) -> Option<(usize, DriveEvent)> {
        loop {
            let mut devices = self.devices.iter_mut().enumerate();
            let event = devices.find_map(|(number, device)| Some((number, device.events.pop_front()?)));
            if event.is_some() {
                return event;
            }
            let (number, event) = self.stack.poll_link()?;
            if let Some(device) = self.devices.get_mut(number) {
                device.note(event, &mut self.stack, number);
            }
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Instant::earlier(Some(self.next_tick), stack!(&self.stack, machine => machine.poll_timeout()))
    }
}
