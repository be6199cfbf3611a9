//! The owner of driven devices: passes their events to the printer, and instructions to the devices.

use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, SyncSender};

use arrayvec::ArrayVec;
use driven_device::{DriveEvent, DrivenBus, DrivenDevice};
use machine::{Duration, Instant};
use protocol_linux::{Owner, Statistics};

use super::report::{ConnectionFigures, MOST_INPUTS, Report};

/// Time for the device to confirm the end of the connection.
const END_WITHIN: Duration = Duration::from_secs(2);

/// Time from one report of the outputs to the next.
const OUTPUTS_EVERY: Duration = Duration::from_millis(100);

/// Instruction from standard input.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum IoInstruction {
    /// Starts or stops the outputs of the device of this name, or of all.
    Run(bool, Option<String>),
    /// Sets an output.
    Set(String, String),
    /// Reads a parameter.
    Read(String),
    /// Writes a parameter.
    Write(String, String),
    /// Ends the program; only a key asks for it.
    End,
}

impl IoInstruction {
    /// Parses a line.
    pub(super) fn parse(line: &str) -> Result<Self, String> {
        let (word, rest) = line.trim().split_once(' ').unwrap_or((line.trim(), ""));
        let assigned = || {
            let (name, value) = rest.split_once('=').ok_or_else(|| format!("`{word}` needs NAME=VALUE"))?;
            Ok::<_, String>((name.trim().to_owned(), value.trim().to_owned()))
        };
        match (word, rest.trim()) {
            ("run" | "stop", name) => {
                Ok(Self::Run(word == "run", (!name.is_empty()).then(|| name.to_owned())))
            }
            ("set", _) => assigned().map(|(name, value)| Self::Set(name, value)),
            ("write", _) => assigned().map(|(name, value)| Self::Write(name, value)),
            ("read", name) if !name.is_empty() => Ok(Self::Read(name.to_owned())),
            _ => {
                Err("must be run [NAME], stop [NAME], set NAME=VALUE, read NAME or write NAME=VALUE"
                    .to_owned())
            }
        }
    }
}

pub(super) struct IoOwner {
    reports: SyncSender<Report>,
    instructions: Receiver<IoInstruction>,
    end: Option<Instant>,
    /// Time at which the program ends without a confirmation.
    gone_at: Option<Instant>,
    /// When the outputs are reported next; never without a live view.
    outputs_at: Option<Instant>,
}

impl IoOwner {
    pub(super) const fn new(
        reports: SyncSender<Report>,
        instructions: Receiver<IoInstruction>,
        end: Option<Instant>,
        outputs_at: Option<Instant>,
    ) -> Self {
        Self { reports, instructions, end, gone_at: None, outputs_at }
    }

    /// Reports the outputs of all devices from time to time.
    fn report_outputs(&mut self, now: Instant, bus: &DrivenBus) {
        if self.outputs_at.is_none_or(|at| now < at) {
            return;
        }
        self.outputs_at = Some(now + OUTPUTS_EVERY);
        for (number, device) in bus.devices().iter().enumerate() {
            let bytes = device.outputs().bytes().iter().copied().take(MOST_INPUTS).collect();
            self.report(Report::Outputs(number, bytes));
        }
    }

    /// Passes a report on. One that finds no room is lost, so that the data go on.
    fn report(&self, report: Report) {
        let _ = self.reports.try_send(report);
    }

    /// Reports the figures of the whole connections.
    pub(super) fn finish(&self, bus: &DrivenBus, statistics: &Statistics) {
        let figures = bus.devices().iter().map(|device| ConnectionFigures {
            counters: device.counters(),
            arrivals: *device.arrivals(),
            lateness: statistics.lateness.quantile(0.99),
            most_late: statistics.lateness.max(),
        });
        let _ = self.reports.send(Report::Ended(figures.collect()));
    }
}

impl Owner<DrivenBus> for IoOwner {
    fn wake(&mut self, now: Instant, bus: &mut DrivenBus, _: &Statistics) -> ControlFlow<()> {
        while let Ok(instruction) = self.instructions.try_recv() {
            let done = match instruction {
                IoInstruction::Run(is_running, name) => bus.run(name.as_deref(), is_running),
                IoInstruction::Set(name, value) => bus.set(&name, &value),
                IoInstruction::Read(name) => bus.read_parameter(&name),
                IoInstruction::Write(name, value) => bus.write_parameter(&name, &value),
                IoInstruction::End => {
                    self.end = self.end.map_or(Some(now), |end| Some(end.min(now)));
                    Ok(())
                }
            };
            if let Err(error) = done {
                self.report(Report::Refused(error.to_string()));
            }
        }
        self.report_outputs(now, bus);
        if self.end.is_some_and(|end| end <= now) && self.gone_at.is_none() {
            self.gone_at = Some(now + END_WITHIN);
            self.end = None;
            bus.disconnect(now);
        }
        match self.gone_at {
            Some(gone_at) if gone_at <= now => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }

    fn event(
        &mut self,
        _: Instant,
        bus: &mut DrivenBus,
        (number, event): (usize, DriveEvent),
    ) -> ControlFlow<()> {
        let is_down = matches!(event, DriveEvent::Down(..));
        match event {
            DriveEvent::Inputs => {
                let inputs = bus.devices().get(number).and_then(DrivenDevice::inputs);
                let bytes = inputs.map_or(&[][..], |inputs| inputs.bytes());
                let shown: ArrayVec<u8, MOST_INPUTS> = bytes.iter().copied().take(MOST_INPUTS).collect();
                self.report(Report::Inputs(number, shown));
            }
            event => self.report(Report::Event(number, event)),
        }
        let is_end = self.gone_at.is_some() && is_down && !bus.devices().iter().any(DrivenDevice::is_up);
        if is_end { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn deadline(&self) -> Option<Instant> {
        // The device's own tick wakes the thread for instructions.
        self.gone_at.or(self.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_are_words_and_others_are_refused_with_what_there_is() {
        let pair = |name: &str, value: &str| (name.to_owned(), value.to_owned());
        let (name, value) = pair("2.1/Valve 3", "0x10");
        assert_eq!(IoInstruction::parse(" set 2.1/Valve 3 = 0x10 "), Ok(IoInstruction::Set(name, value)));
        assert_eq!(IoInstruction::parse("run"), Ok(IoInstruction::Run(true, None)));
        let left = Some("left".to_owned());
        assert_eq!(IoInstruction::parse("stop left"), Ok(IoInstruction::Run(false, left)));
        assert_eq!(IoInstruction::parse("read Filter"), Ok(IoInstruction::Read("Filter".to_owned())));
        for wrong in ["", "go", "read", "set Valve"] {
            assert!(IoInstruction::parse(wrong).is_err(), "{wrong}");
        }
    }
}
