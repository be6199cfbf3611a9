//! Lines that are printed of a driven device, in words or as JSON.

use std::fs::File;
use std::io::Write as _;

use arrayvec::ArrayVec;
use driven_device::{
    Arrivals, DeviceParameter, DriveEvent, DrivenDevice, ParameterAnswer, ParameterValue, ScaledValue,
    Signal, SignalTable, SignalValue,
};
use machine::{Counters, Duration};
use node::output::to_stdout;
use serde_json::{Map, Value, json};

use crate::printable::printable;

/// Most bytes of inputs that a report carries: those of a frame.
pub(super) const MOST_INPUTS: usize = 1500;

/// Figures of a connection from its start to its end.
#[derive(Clone, Copy, Debug)]
pub(super) struct ConnectionFigures {
    pub(super) counters: Counters,
    pub(super) arrivals: Arrivals,
    /// Lateness of our own frames that 99 % do not exceed.
    pub(super) lateness: Duration,
    pub(super) most_late: Duration,
}

/// Line that is printed.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a report of inputs is made without an allocation")]
pub(super) enum Report {
    /// An event of the device.
    Event(DriveEvent),
    /// The bytes of all inputs.
    Inputs(ArrayVec<u8, MOST_INPUTS>),
    /// An instruction that was refused.
    Refused(String),
    /// The end, with the figures of the connection.
    Ended(ConnectionFigures),
}

/// Prints reports, inputs only where they changed.
pub(super) struct Printer {
    inputs: SignalTable,
    /// Values printed last, by the place of the signal.
    shown: Vec<Option<SignalValue>>,
    is_json: bool,
    record: Option<File>,
}

impl Printer {
    pub(super) fn new(device: &DrivenDevice, is_json: bool, record: Option<File>) -> Self {
        let inputs = device.input_table();
        let shown = vec![None; inputs.signals().len()];
        Self { inputs, shown, is_json, record }
    }

    /// Lists signals and parameters by name.
    pub(super) fn list(&mut self, device: &DrivenDevice) -> anyhow::Result<()> {
        let (inputs, outputs) = device.signals();
        let parameters: Vec<&Signal> =
            device.parameters().iter().map(|parameter| &parameter.signal).collect();
        let started = json!({ "started": {
            "bus": device.bus(), "inputs": inputs, "outputs": outputs, "parameters": parameters,
        } });
        self.keep(&started);
        if self.is_json {
            return Ok(to_stdout(format_args!("{started}\n"))?);
        }
        let mut text = String::new();
        for (direction, signals) in [("input", inputs), ("output", outputs)] {
            signals.iter().for_each(|signal| text.push_str(&line(direction, signal)));
        }
        device
            .parameters()
            .iter()
            .for_each(|it: &DeviceParameter| text.push_str(&line("parameter", &it.signal)));
        Ok(to_stdout(format_args!("{text}{}: connects\n", device.bus()))?)
    }

    fn keep(&mut self, value: &Value) {
        if let Some(file) = &mut self.record
            && let Err(error) = writeln!(file, "{value}")
        {
            node::errln!("warning: the record ends here: {error}");
            self.record = None;
        }
    }

    /// Prints a report.
    pub(super) fn print(&mut self, report: &Report) -> std::io::Result<()> {
        let (value, text) = match report {
            Report::Inputs(bytes) => self.changed(bytes),
            Report::Event(event) => (of_event(event), in_words(event)),
            Report::Refused(reason) => (json!({ "refused": reason }), format!("refused: {reason}")),
            Report::Ended(figures) => (figures.to_json(), figures.to_string()),
        };
        // Inputs that did not change, and events without words, are no lines.
        if text.is_empty() {
            return Ok(());
        }
        self.keep(&value);
        if self.is_json { to_stdout(format_args!("{value}\n")) } else { to_stdout(format_args!("{text}\n")) }
    }

    /// Returns the inputs that changed since the last report.
    fn changed(&mut self, bytes: &[u8]) -> (Value, String) {
        self.inputs.replace(bytes);
        let mut values = Map::new();
        let mut lines = Vec::new();
        for (signal, shown) in self.inputs.signals().iter().zip(&mut self.shown) {
            let value = self.inputs.value(signal);
            if shown.as_ref() == Some(&value) {
                continue;
            }
            let scaled = value.scaled(signal);
            let shown_value = in_units(&value, scaled, value.text(signal), &signal.unit);
            lines.push(format!("input {} = {shown_value}", printable(signal.name.as_bytes())));
            values.insert(signal.name.clone(), value_json(&value, scaled));
            *shown = Some(value);
        }
        (json!({ "inputs": values }), lines.join("\n"))
    }
}

fn with_unit(value: &impl std::fmt::Display, unit: &str) -> String {
    if unit.is_empty() { value.to_string() } else { format!("{value} {}", printable(unit.as_bytes())) }
}

/// Returns a value with its unit, and after it the raw value of a scaled one and the text of the file.
fn in_units(raw: &SignalValue, scaled: Option<ScaledValue>, text: Option<&str>, unit: &str) -> String {
    let number = scaled.map_or_else(|| with_unit(raw, unit), |scaled| with_unit(&scaled, unit));
    let beside = scaled.map(|_| format!(" (raw {raw})")).unwrap_or_default();
    let text = text.map(|text| format!(" ({})", printable(text.as_bytes()))).unwrap_or_default();
    format!("{number}{beside}{text}")
}

/// Returns a value as JSON; a scaled one as an object with the raw value.
fn value_json(raw: &SignalValue, scaled: Option<ScaledValue>) -> Value {
    scaled.map_or_else(|| json!(raw), |scaled| json!({ "value": scaled.value, "raw": raw }))
}

fn line(kind: &str, signal: &Signal) -> String {
    let type_name = with_unit(&signal.type_name(), &signal.unit);
    let safety = if signal.is_safety { ", safety: shown only" } else { "" };
    let name = printable(signal.name.as_bytes());
    format!("{kind} {name}: {type_name}{safety}\n")
}

fn in_words(event: &DriveEvent) -> String {
    let text = match event {
        DriveEvent::Identity(identity) if identity.is_empty() => return String::new(),
        DriveEvent::Identity(identity) => format!("device: {identity}"),
        DriveEvent::Difference(difference) => format!("difference: {difference}"),
        DriveEvent::Up => "up: data are exchanged".to_owned(),
        DriveEvent::Down(down, details) if details.is_empty() => format!("down: {down}"),
        DriveEvent::Down(down, details) => format!("down: {down}; {details}"),
        DriveEvent::Conflict(conflict) => format!("conflict: {conflict}"),
        DriveEvent::Inputs => String::new(),
        DriveEvent::Running(true) => "outputs run".to_owned(),
        DriveEvent::Running(false) => "outputs are stopped".to_owned(),
        DriveEvent::Answer(answer) => answered(answer),
        DriveEvent::Alarm(alarm) => alarm.clone(),
    };
    printable(text.as_bytes())
}

fn answered(answer: &ParameterAnswer) -> String {
    let ParameterAnswer { name, unit, is_write, result } = answer;
    let verb = if *is_write { "written" } else { "read" };
    match result {
        Ok(ParameterValue { raw, scaled, text }) => {
            format!("{verb} {name} = {}", in_units(raw, *scaled, text.as_deref(), unit))
        }
        Err(reason) => format!("not {verb} {name}: {reason}"),
    }
}

fn of_event(event: &DriveEvent) -> Value {
    match event {
        DriveEvent::Identity(identity) => json!({ "identity": identity }),
        DriveEvent::Difference(difference) => json!({ "difference": difference }),
        DriveEvent::Up => json!({ "up": true }),
        DriveEvent::Down(down, details) => {
            json!({ "up": false, "reason": down.to_string(), "details": details })
        }
        DriveEvent::Conflict(conflict) => json!({ "conflict": conflict.to_string() }),
        DriveEvent::Inputs => Value::Null,
        DriveEvent::Running(is_running) => json!({ "running": is_running }),
        DriveEvent::Answer(answer) => {
            let (value, error) = match &answer.result {
                Ok(ParameterValue { raw, scaled, .. }) => (value_json(raw, *scaled), Value::Null),
                Err(reason) => (Value::Null, json!(reason)),
            };
            let (name, is_write) = (&answer.name, answer.is_write);
            json!({ "parameter": { "name": name, "is_write": is_write, "value": value, "error": error } })
        }
        DriveEvent::Alarm(alarm) => json!({ "alarm": alarm }),
    }
}

impl ConnectionFigures {
    fn to_json(self) -> Value {
        let micros = |duration: Duration| duration.as_secs_f64() * 1e6;
        let Self { counters, arrivals, lateness, most_late } = self;
        json!({ "ended": {
            "received": counters.received, "lost": counters.lost, "late": counters.late, "sent": counters.sent,
            "interval_us": { "mean": micros(arrivals.mean()), "shortest": micros(arrivals.shortest), "longest": micros(arrivals.longest) },
            "lateness_us": { "p99": micros(lateness), "most": micros(most_late) },
        } })
    }
}

impl std::fmt::Display for ConnectionFigures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let millis = |duration: Duration| duration.as_secs_f64() * 1e3;
        let Self { counters, arrivals, lateness, most_late } = self;
        write!(
            f,
            "ended: {} received, {} lost; interval {:.3} ms on average, {:.3} to {:.3} ms; lateness of sent frames {:.3} ms at p99, at most {:.3} ms",
            counters.received,
            counters.lost,
            millis(arrivals.mean()),
            millis(arrivals.shortest),
            millis(arrivals.longest),
            millis(*lateness),
            millis(*most_late),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_has_the_lines_that_are_printed_and_no_others() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("record.jsonl");
        let record = Some(File::create(&path).unwrap());
        let mut printer =
            Printer { inputs: SignalTable::default(), shown: Vec::new(), is_json: true, record };
        printer.print(&Report::Event(DriveEvent::Inputs)).unwrap();
        printer.print(&Report::Inputs(ArrayVec::new())).unwrap();
        printer.print(&Report::Event(DriveEvent::Up)).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "{\"up\":true}\n");
    }

    #[test]
    fn the_figures_of_the_end_have_their_units() {
        let millis = Duration::from_millis;
        let mut arrivals = Arrivals::default();
        (arrivals.shortest, arrivals.longest) = (millis(1), millis(3));
        let counters = Counters { received: 12, lost: 1, ..Counters::default() };
        let figures = ConnectionFigures {
            counters,
            arrivals,
            lateness: Duration::from_micros(40),
            most_late: millis(2),
        };
        let text = figures.to_string();
        assert!(text.starts_with("ended: 12 received, 1 lost; interval "), "{text}");
        assert!(
            text.ends_with("1.000 to 3.000 ms; lateness of sent frames 0.040 ms at p99, at most 2.000 ms"),
            "{text}"
        );
    }
}
