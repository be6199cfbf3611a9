//! Lines that are printed of driven devices, in words or as JSON.

use std::fs::File;
use std::io::Write as _;

use arrayvec::ArrayVec;
use console::Key;
use driven_device::{
    Arrivals, DeviceParameter, DriveEvent, DrivenBus, ParameterAnswer, ParameterValue, ScaledValue, Signal,
    SignalTable, SignalValue,
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
pub(super) enum Report {
    /// An event of the device of a number.
    Event(usize, DriveEvent),
    /// The bytes of all inputs of a device.
    Inputs(usize, ArrayVec<u8, MOST_INPUTS>),
    /// The bytes of all outputs of a device, for the live view.
    Outputs(usize, ArrayVec<u8, MOST_INPUTS>),
    /// A key of the live view.
    Key(Key),
    /// An instruction that was refused.
    Refused(String),
    /// The end, with the figures of each connection.
    Ended(Vec<ConnectionFigures>),
}

/// Prints reports, inputs only where they changed.
pub(super) struct Printer {
    devices: Vec<ShownDevice>,
    is_json: bool,
    record: Option<File>,
}

/// Inputs of a device as they were printed last.
#[derive(Default)]
struct ShownDevice {
    /// Its name; empty for the only device, of which no line needs a name.
    name: String,
    inputs: SignalTable,
    /// Values printed last, by the place of the signal.
    shown: Vec<Option<SignalValue>>,
}

impl Printer {
    pub(super) fn new(bus: &DrivenBus, is_json: bool, record: Option<File>) -> Self {
        let is_alone = bus.devices().len() == 1;
        let devices = bus.devices().iter().map(|device| {
            let inputs = device.input_table();
            let name = if is_alone { String::new() } else { device.name().to_owned() };
            ShownDevice { name, shown: vec![None; inputs.signals().len()], inputs }
        });
        Self { devices: devices.collect(), is_json, record }
    }

    /// Lists signals and parameters by name; with a live view in the record alone.
    pub(super) fn list(&mut self, bus: &DrivenBus, is_live: bool) -> anyhow::Result<()> {
        let mut text = String::new();
        for (number, device) in bus.devices().iter().enumerate() {
            let (inputs, outputs) = device.signals();
            let parameters: Vec<&Signal> =
                device.parameters().iter().map(|parameter| &parameter.signal).collect();
            let started = json!({ "started": {
                "bus": bus.bus(), "inputs": inputs, "outputs": outputs, "parameters": parameters,
            } });
            let started = self.named(number, started);
            self.keep(&started);
            if self.is_json {
                to_stdout(format_args!("{started}\n"))?;
                continue;
            }
            let prefix = self.prefix(number);
            for (direction, signals) in [("input", inputs), ("output", outputs)] {
                signals.iter().for_each(|signal| text.push_str(&line(direction, &prefix, signal)));
            }
            device
                .parameters()
                .iter()
                .for_each(|it: &DeviceParameter| text.push_str(&line("parameter", &prefix, &it.signal)));
        }
        if self.is_json || is_live {
            return Ok(());
        }
        Ok(to_stdout(format_args!("{text}{}: connects\n", bus.bus()))?)
    }

    /// Returns what is in front of the names of a device's signals: its own name, where there are several devices.
    fn prefix(&self, number: usize) -> String {
        let name = self.devices.get(number).map_or("", |device| &device.name);
        if name.is_empty() { String::new() } else { format!("{}/", printable(name.as_bytes())) }
    }

    /// Adds the name of the device, where there are several.
    fn named(&self, number: usize, mut value: Value) -> Value {
        let name = self.devices.get(number).map_or("", |device| &device.name);
        if let (false, Some(object)) = (name.is_empty(), value.as_object_mut()) {
            object.insert("device".to_owned(), json!(name));
        }
        value
    }

    /// Puts the name of the device in front of words that name no signal, where there are several.
    fn said(&self, number: usize, words: String) -> String {
        let name = self.devices.get(number).map_or("", |device| &device.name);
        if name.is_empty() || words.is_empty() {
            return words;
        }
        format!("{}: {words}", printable(name.as_bytes()))
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
        self.made_of(report).iter().try_for_each(|(value, text)| self.write(value, text))
    }

    /// Keeps a report in the record without printing it. Returns its lines.
    pub(super) fn note(&mut self, report: &Report) -> Vec<String> {
        let made = self.made_of(report).into_iter().filter(|(_, text)| !text.is_empty());
        made.inspect(|(value, _)| self.keep(value)).map(|(_, text)| text).collect()
    }

    /// Makes the objects of a report with their text; one without text is not printed.
    fn made_of(&mut self, report: &Report) -> Vec<(Value, String)> {
        match report {
            Report::Inputs(number, bytes) => {
                let prefix = self.prefix(*number);
                let Some(device) = self.devices.get_mut(*number) else { return Vec::new() };
                let (value, text) = device.changed(&prefix, bytes);
                vec![(self.named(*number, value), text)]
            }
            Report::Event(number, event) => {
                vec![(self.named(*number, of_event(event)), self.said(*number, in_words(event)))]
            }
            Report::Refused(reason) => vec![(json!({ "refused": reason }), format!("refused: {reason}"))],
            Report::Ended(figures) => {
                let figures = figures.iter().enumerate();
                let of = |(number, figures): (usize, &ConnectionFigures)| {
                    (self.named(number, figures.to_json()), self.said(number, figures.to_string()))
                };
                figures.map(of).collect()
            }
            Report::Outputs(..) | Report::Key(_) => Vec::new(),
        }
    }

    fn write(&mut self, value: &Value, text: &str) -> std::io::Result<()> {
        // Inputs that did not change, and events without words, are no lines.
        if text.is_empty() {
            return Ok(());
        }
        self.keep(value);
        if self.is_json { to_stdout(format_args!("{value}\n")) } else { to_stdout(format_args!("{text}\n")) }
    }
}

impl ShownDevice {
    /// Returns the inputs that changed since the last report.
    fn changed(&mut self, prefix: &str, bytes: &[u8]) -> (Value, String) {
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
            lines.push(format!("input {prefix}{} = {shown_value}", printable(signal.name.as_bytes())));
            values.insert(signal.name.clone(), value_json(&value, scaled));
            *shown = Some(value);
        }
        (json!({ "inputs": values }), lines.join("\n"))
    }
}

pub(super) fn with_unit(value: &impl std::fmt::Display, unit: &str) -> String {
    if unit.is_empty() { value.to_string() } else { format!("{value} {}", printable(unit.as_bytes())) }
}

/// Returns a value with its unit, and after it the raw value of a scaled one and the text of the file.
pub(super) fn in_units(
    raw: &SignalValue,
    scaled: Option<ScaledValue>,
    text: Option<&str>,
    unit: &str,
) -> String {
    let number = scaled.map_or_else(|| with_unit(raw, unit), |scaled| with_unit(&scaled, unit));
    let beside = scaled.map(|_| format!(" (raw {raw})")).unwrap_or_default();
    let text = text.map(|text| format!(" ({})", printable(text.as_bytes()))).unwrap_or_default();
    format!("{number}{beside}{text}")
}

/// Returns a value as JSON; a scaled one as an object with the raw value.
fn value_json(raw: &SignalValue, scaled: Option<ScaledValue>) -> Value {
    scaled.map_or_else(|| json!(raw), |scaled| json!({ "value": scaled.value, "raw": raw }))
}

fn line(kind: &str, prefix: &str, signal: &Signal) -> String {
    let type_name = with_unit(&signal.type_name(), &signal.unit);
    let safety = if signal.is_safety { ", safety: shown only" } else { "" };
    let name = printable(signal.name.as_bytes());
    format!("{kind} {prefix}{name}: {type_name}{safety}\n")
}

fn in_words(event: &DriveEvent) -> String {
    let text = match event {
        DriveEvent::Identity(identity) if identity.is_empty() => return String::new(),
        DriveEvent::Identity(identity) => format!("device: {identity}"),
        DriveEvent::Difference(difference) => format!("difference: {difference}"),
        DriveEvent::Up => "up: data are exchanged".to_owned(),
        DriveEvent::Configured => {
            "null connection: the device took its configuration; no data are exchanged".to_owned()
        }
        DriveEvent::Down(down, details) if details.is_empty() => format!("down: {down}"),
        DriveEvent::Down(down, details) => format!("down: {down}; {details}"),
        DriveEvent::Conflict(conflict) => format!("conflict: {conflict}"),
        DriveEvent::Inputs => String::new(),
        DriveEvent::Running(true) => "outputs run".to_owned(),
        DriveEvent::Running(false) => "outputs are stopped".to_owned(),
        DriveEvent::Answer(answer) => answered(answer),
        DriveEvent::Alarm(alarm) => alarm.clone(),
        DriveEvent::Earlier(earlier) => format!("from before the connection: {earlier}"),
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
        DriveEvent::Configured => json!({ "configured": true }),
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
        DriveEvent::Earlier(earlier) => json!({ "earlier": earlier }),
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
        let mut printer = Printer { devices: vec![ShownDevice::default()], is_json: true, record };
        printer.print(&Report::Event(0, DriveEvent::Inputs)).unwrap();
        printer.print(&Report::Inputs(0, ArrayVec::new())).unwrap();
        printer.print(&Report::Event(0, DriveEvent::Up)).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "{\"up\":true}\n");
    }

    const EDS: &str = include_str!("../../../scripts/interop/files/made-up-adapter.eds");

    /// Returns an adapter whose first 16 bits of inputs are a speed: (raw - 100) / 10 rpm.
    fn scaled_device() -> DrivenBus {
        let parameters = "[Params]\n Param5 = 0,,\"20 01 24 01 30 01\",0x0004,0xC3,2,\"Speed\",\"rpm\",\"\",-32768,32767,0,1,1,1,-100,,,,,1;\n\
             Enum5 = 1125,\"nominal\";\n Param6 = 0,,,0x0000,0xC7,2,\"Delay\",\"ms\",\"\",0,65535,0,,,,,,,,,;\n";
        let text = EDS
            .replace("[Params]", parameters)
            .replace("\"Inputs\",,8,0x0000,,,64,", "\"Inputs\",,8,0x0000,,,16,Param5,16,Param6,32,");
        let file = device_files::read("a.eds", text.into()).unwrap();
        let chosen = device_files::choose(&file, &device_files::DeviceChoice::default()).unwrap();
        let address = std::net::Ipv4Addr::new(192, 168, 64, 1);
        let config = driven_device::DriveConfig {
            device_address: Some(std::net::Ipv4Addr::new(192, 168, 64, 2)),
            station_name: None,
            position: None,
            interval: None,
            output_interval: None,
            input_interval: None,
            is_running: false,
            report_every: Duration::from_millis(100),
        };
        let bus = driven_device::BusConfig {
            mac: machine::ethernet::Mac([2, 0, 0, 0, 0, 1]),
            address: Some(address),
            mask: std::net::Ipv4Addr::new(255, 255, 255, 0),
            seed: 1,
        };
        let script = driven_device::OutputScript::default();
        let device = driven_device::FileDevice { name: "adapter".to_owned(), file, chosen, script, config };
        DrivenBus::new(vec![device], &bus, machine::Instant::ZERO).unwrap()
    }

    #[test]
    fn scaled_inputs_have_their_unit_and_the_raw_value_in_words_and_in_json() {
        let device = scaled_device();
        let mut printer = Printer::new(&device, false, None);
        let (json, text) = printer.devices[0].changed("", &[0x65, 0x04, 7, 0, 0, 0, 0, 0]);
        assert_eq!(
            text,
            "input Inputs = 6504070000000000\ninput Speed = 102.5 rpm (raw 1125) (nominal)\ninput Delay = 7 ms"
        );
        assert_eq!(json["inputs"]["Speed"], json!({ "value": 102.5, "raw": 1125 }));
        assert_eq!(json["inputs"]["Delay"], json!(7));

        // Only what changed; the raw value has its sign.
        let (json, text) = printer.devices[0].changed("", &[0xFF, 0xFF, 7, 0, 0, 0, 0, 0]);
        assert_eq!(text, "input Inputs = ffff070000000000\ninput Speed = -10.1 rpm (raw -1)");
        assert_eq!(json["inputs"]["Speed"], json!({ "value": -10.1, "raw": -1 }));
        assert_eq!(json["inputs"].get("Delay"), None);
        assert_eq!(printer.devices[0].changed("", &[0xFF, 0xFF, 7, 0, 0, 0, 0, 0]).1, "");
        let speed = device.devices()[0].signals().0.iter().find(|signal| signal.name == "Speed").unwrap();
        assert_eq!(line("input", "left/", speed), "input left/Speed: int16 rpm\n");
    }

    #[test]
    fn scaled_parameters_are_answered_with_their_unit_and_the_raw_value() {
        let device = scaled_device();
        let speed = &device.devices()[0].parameters()[0].signal;
        let raw = SignalValue::Signed(1125);
        let (scaled, text) = (raw.scaled(speed), raw.text(speed).map(str::to_owned));
        let answer = |is_write, result| {
            let (name, unit) = (speed.name.clone(), speed.unit.clone());
            DriveEvent::Answer(ParameterAnswer { name, unit, is_write, result })
        };
        let read = answer(false, Ok(ParameterValue { raw, scaled, text }));
        assert_eq!(in_words(&read), "read Speed = 102.5 rpm (raw 1125) (nominal)");
        let expected = json!({ "parameter": {
            "name": "Speed", "is_write": false, "value": { "value": 102.5, "raw": 1125 }, "error": null,
        } });
        assert_eq!(of_event(&read), expected);
        let refused = answer(true, Err("too fast".to_owned()));
        assert_eq!(in_words(&refused), "not written Speed: too fast");
        assert_eq!(of_event(&refused)["parameter"]["value"], Value::Null);
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
