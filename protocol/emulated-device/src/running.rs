//! The device as time passes: script, faults and frames.

use std::net::Ipv4Addr;

use ethercat_subdevice::{AlState, AlStatusCode, Emergency, SegmentEnd};
use machine::ethernet::Mac;
use machine::{
    Duration, Instant, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest, Transmit,
};

use crate::device::{DeviceEvent, EmulatedDevice};
use crate::faults::{Alteration, FaultPhase};
use crate::playback::PlacedInput;
use crate::script::FaultKind;
use crate::stack::{Stack, diagnosis, open, raise, stack};

/// Time between two values of the script.
const TICK: Duration = Duration::from_millis(1);

/// Largest number of events that wait for the owner.
const MOST_EVENTS: usize = 256;

impl EmulatedDevice {
    fn report(&mut self, event: DeviceEvent) {
        if self.events.len() < MOST_EVENTS {
            self.events.push_back(event);
        }
    }

    fn is_active(&self, kind: FaultKind) -> bool {
        self.faults.iter().any(|fault| fault.is_active(kind))
    }

    /// Returns by how much frames are handled later now.
    fn delay(&self) -> Option<Duration> {
        let slow = self.faults.iter().filter(|fault| fault.is_active(FaultKind::Slow));
        slow.map(|fault| Duration::from_millis(fault.fault.delay_ms.into())).max()
    }

    fn tick(&mut self, now: Instant) {
        self.follow_faults(now);
        if self.stack.read_outputs(&mut self.outputs) {
            self.report(DeviceEvent::Outputs);
        }
        if !self.is_active(FaultKind::StuckInputs) {
            for placed in &self.playback {
                placed.write(self.start, now, &mut self.inputs, &self.outputs);
            }
        }
        self.stack.write_inputs(&self.inputs, self.alteration.extra_input_bytes());
    }

    fn follow_faults(&mut self, now: Instant) {
        let mut is_changed = false;
        for at in 0..self.faults.len() {
            let Some(fault) = self.faults.get_mut(at) else { return };
            if fault.follow(now) {
                is_changed = true;
                let event = DeviceEvent::Fault(fault.fault.kind, fault.phase == FaultPhase::Active);
                self.report(event);
            }
            self.apply(at);
        }
        if is_changed {
            self.keep_lasting();
        }
        let active = |kind| self.faults.iter().any(move |fault| fault.is_active(kind));
        let missing = self.faults.iter().find(|fault| fault.is_active(FaultKind::ModuleGone));
        let wanted = Alteration {
            is_other_identity: active(FaultKind::WrongIdentity),
            is_longer: active(FaultKind::WrongSize),
            missing_slot: missing.map(|fault| fault.fault.slot),
            refuses: active(FaultKind::Refuse),
            generation: self.alteration.generation,
        };
        if wanted != self.alteration {
            self.restart(now, wanted);
        }
    }

    /// Gives the stack what lasts: the alarms that are active as the diagnosis of an IO-Device, for controllers that connect later,
    /// and the fault of a mailbox.
    fn keep_lasting(&mut self) {
        match &mut self.stack {
            Stack::Profinet(device) => {
                let active = self.faults.iter().filter(|fault| fault.is_active(FaultKind::Alarm));
                device.set_diagnosis(active.map(|timed| diagnosis(&timed.fault)).collect());
            }
            Stack::Ethercat(segment, id) => {
                let active = self.faults.iter().filter(|fault| fault.phase == FaultPhase::Active);
                segment.set_mail_fault(*id, active.filter_map(|fault| fault.fault.kind.mail_fault()).next());
            }
            Stack::EthernetIp(_) => {}
        }
    }

    /// Does what one fault does at its begin, while it lasts, and at its end.
    fn apply(&mut self, at: usize) {
        let Self { stack, faults, chosen, .. } = self;
        let Some(timed) = faults.get_mut(at) else { return };
        let is_active = timed.phase == FaultPhase::Active;
        if timed.phase == FaultPhase::Ending && timed.fault.kind != FaultKind::Alarm {
            timed.phase = FaultPhase::Over;
        }
        match (stack, timed.fault.kind) {
            (Stack::Profinet(device), FaultKind::Alarm) => match timed.phase {
                FaultPhase::Active if !timed.is_sent => {
                    timed.is_sent = raise(device, chosen, &timed.fault, true)
                }
                FaultPhase::Ending if !timed.is_sent || raise(device, chosen, &timed.fault, false) => {
                    timed.phase = FaultPhase::Over;
                }
                _ => {}
            },
            (Stack::Ethercat(segment, id), FaultKind::Emergency) if is_active && !timed.is_sent => {
                timed.is_sent =
                    segment.raise(*id, Emergency { code: timed.fault.code, register: 1, data: [0; 5] });
            }
            (Stack::Ethercat(segment, id), FaultKind::OutOfOp | FaultKind::Refuse) if is_active => {
                let is_op = segment.state(*id).is_some_and(|(state, _)| state == AlState::Op);
                let repeats = timed.fault.kind == FaultKind::Refuse || !timed.is_sent;
                if is_op && repeats {
                    timed.is_sent = true;
                    let code = if timed.fault.code == 0 {
                        AlStatusCode::UNSPECIFIED_ERROR
                    } else {
                        AlStatusCode(timed.fault.code)
                    };
                    segment.fail(*id, code);
                }
            }
            (Stack::Ethercat(segment, id), FaultKind::WorkingCounter) => {
                let is_running = segment.state(*id).is_some_and(|(state, _)| state >= AlState::SafeOp);
                if is_running && is_active != timed.is_sent {
                    timed.is_sent = is_active;
                    segment.set_process_data_locked(*id, is_active);
                }
            }
            _ => {}
        }
    }

    /// Restarts the stack with a changed device, as if another one were there. Connections do not end; they are gone.
    fn restart(&mut self, now: Instant, wanted: Alteration) {
        if matches!(self.stack, Stack::Ethercat(..))
            && wanted.is_other_identity == self.alteration.is_other_identity
            && wanted.is_longer == self.alteration.is_longer
        {
            // A SubDevice that refuses OP does not restart.
            self.alteration = wanted;
            return;
        }
        let wanted = Alteration { generation: self.alteration.generation.wrapping_add(1), ..wanted };
        // The changed device has the form of the first one.
        let Ok((stack, inputs, outputs)) = open(&self.chosen, &wanted, &self.config, now) else { return };
        self.stack = stack;
        if self.leads_on {
            self.lead_on();
        }
        self.keep_lasting();
        self.closing.extend(self.streams.drain(..));
        self.alteration = wanted;
        let kept: Vec<_> = self.playback.drain(..).map(|placed| placed.input).collect();
        (self.inputs, self.outputs) = (inputs, outputs);
        // A place that is gone with its module comes back with it.
        for input in kept {
            if let Ok(placed) = PlacedInput::new(input, &self.inputs, &self.outputs) {
                self.playback.push(placed);
            }
        }
    }

    /// Takes a frame from the wire: it is lost where the device is silent, and held where it is slow.
    fn receive(&mut self, now: Instant, from: Source, frame: &[u8], is_broadcast: bool) {
        if self.is_active(FaultKind::Silent) {
            return;
        }
        match self.delay() {
            Some(delay) => self.held.hold(now + delay, from, frame, is_broadcast),
            None => self.deliver(now, from, frame, is_broadcast),
        }
    }

    /// Connects the port after this SubDevice to the next one of its line.
    pub(crate) fn lead_on(&mut self) {
        self.leads_on = true;
        if let Stack::Ethercat(segment, _) = &mut self.stack {
            segment.lead_on();
        }
    }

    /// Takes a frame that the SubDevices after this one sent back.
    pub(crate) fn handle_returned(&mut self, now: Instant, frame: &[u8]) {
        let is_silent = self.is_active(FaultKind::Silent);
        if let Stack::Ethercat(segment, _) = &mut self.stack
            && !is_silent
        {
            segment.handle_returned(now, frame);
        }
    }

    /// Writes the next frame of a SubDevice in a line, and returns by which end it leaves.
    pub(crate) fn poll_frame(&mut self, now: Instant, buf: &mut [u8]) -> Option<(SegmentEnd, Transmit)> {
        let is_silent = self.is_active(FaultKind::Silent);
        let Stack::Ethercat(segment, _) = &mut self.stack else { return None };
        loop {
            let frame = segment.poll_frame(now, buf)?;
            if !is_silent {
                return Some(frame);
            }
        }
    }

    fn deliver(&mut self, now: Instant, from: Source, frame: &[u8], is_broadcast: bool) {
        stack!(&mut self.stack, machine => match is_broadcast {
            true => machine.handle_broadcast(now, from, frame),
            false => machine.handle_frame(now, from, frame),
        });
    }
}

impl Machine for EmulatedDevice {
    type Event = DeviceEvent;

    fn ports(&self) -> &[PortRequest] {
        stack!(&self.stack, machine => machine.ports())
    }

    fn listen_port(&self) -> Option<u16> {
        stack!(&self.stack, machine => machine.listen_port())
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

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.receive(now, from, frame, false);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.receive(now, from, frame, true);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match change {
            StreamChange::Accepted(_) => self.streams.push(stream),
            StreamChange::Closed => self.streams.retain(|known| *known != stream),
            StreamChange::Connected(_) | StreamChange::NotConnected(_) => {}
        }
        stack!(&mut self.stack, machine => machine.handle_stream(now, stream, change));
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        if let Some(stream) = self.closing.pop_front() {
            return Some(StreamRequest::Close(stream));
        }
        let request = stack!(&mut self.stack, machine => machine.poll_stream());
        if let Some(StreamRequest::Close(stream)) = request {
            self.streams.retain(|known| *known != stream);
        }
        request
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.next_tick <= now {
            self.tick(now);
            self.next_tick = now + TICK;
        }
        while let Some((from, frame, is_broadcast)) = self.held.next(now) {
            self.deliver(now, from, &frame, is_broadcast);
        }
        stack!(&mut self.stack, machine => machine.handle_timeout(now));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let is_silent = self.is_active(FaultKind::Silent);
        loop {
            let transmit = stack!(&mut self.stack, machine => machine.poll_transmit(now, buf))?;
            // A silent device goes on; its frames are lost.
            if !is_silent {
                return Some(transmit);
            }
        }
    }

    fn poll_event(&mut self) -> Option<DeviceEvent> {
        if let Some(event) = self.events.pop_front() {
            return Some(event);
        }
        match &mut self.stack {
            Stack::Profinet(device) => device.poll_event().map(DeviceEvent::Link),
            Stack::EthernetIp(adapter) => adapter.poll_event().map(DeviceEvent::Link),
            Stack::Ethercat(segment, _) => loop {
                match segment.poll_event()?.1 {
                    ethercat_subdevice::Event::StateChanged { state, code } => {
                        return Some(DeviceEvent::State(state, code));
                    }
                    ethercat_subdevice::Event::ObjectWritten { index, subindex } => {
                        return Some(DeviceEvent::ObjectWritten(index, subindex));
                    }
                    _ => {}
                }
            },
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let own = Instant::earlier(Some(self.next_tick), self.held.poll_timeout());
        Instant::earlier(own, stack!(&self.stack, machine => machine.poll_timeout()))
    }
}
