//! A device as its owner has it: signals and parameters by name.

use std::collections::VecDeque;

use device_files::{ChosenDevice, DeviceFile};
use machine::{Counters, Down, Duration, Instant, StationConflict};

use crate::arrivals::Arrivals;
use crate::config::DriveError;
use crate::file_device::{FileDevice, OpenedDevice};
use crate::parameter::{self, DeviceParameter, ParameterAccess, ParameterAnswer};
use crate::script::ScriptedOutput;
use crate::signal::{Signal, number_duplicates};
use crate::stack::parameter_at;
use crate::table::SignalTable;
use crate::value::SignalValue;

/// Event of a driven device.
#[derive(Clone, PartialEq, Debug)]
pub enum DriveEvent {
    /// The device that answered: its identity in words.
    Identity(String),
    /// The device differs from the file: what was expected, what was found and what to do.
    Difference(String),
    /// Data are exchanged.
    Up,
    /// A null connection of EtherNet/IP: the device took its configuration, and no data are exchanged.
    Configured,
    /// No data are exchanged, and details.
    Down(Down, String),
    /// Another station has the name or address.
    Conflict(StationConflict),
    /// The inputs changed.
    Inputs,
    /// Outputs count from now on (true), or no more.
    Running(bool),
    /// Answer about a parameter.
    Answer(ParameterAnswer),
    /// Alarm, diagnosis or emergency in the file's words.
    Alarm(String),
    /// Fault of the device from before its connection, in the file's words.
    Earlier(String),
}

/// Output of the script whose signal is known.
#[derive(Clone, Debug)]
pub(crate) struct PlacedOutput {
    pub(crate) signal: Signal,
    pub(crate) output: ScriptedOutput,
}

/// Accesses to parameters that wait.
const MOST_ACCESSES: usize = 64;

/// The device of a file, driven by a [`DrivenBus`](crate::DrivenBus).
#[derive(Debug)]
pub struct DrivenDevice {
    pub(crate) name: String,
    pub(crate) file: DeviceFile,
    pub(crate) chosen: ChosenDevice,
    pub(crate) inputs: SignalTable,
    pub(crate) has_inputs: bool,
    pub(crate) outputs: SignalTable,
    pub(crate) is_running: bool,
    /// True once the stack has the outputs.
    pub(crate) is_written: bool,
    /// Seconds after the start from which outputs count.
    pub(crate) run_at: Option<Instant>,
    pub(crate) scripted: Vec<PlacedOutput>,
    pub(crate) parameters: Vec<DeviceParameter>,
    pub(crate) accesses: VecDeque<ParameterAccess>,
    pub(crate) asked: Option<ParameterAccess>,
    pub(crate) arrivals: Arrivals,
    pub(crate) start: Instant,
    pub(crate) report_every: Duration,
    pub(crate) reported_at: Option<Instant>,
    pub(crate) is_changed: bool,
    pub(crate) is_leaving: bool,
    pub(crate) is_up: bool,
    pub(crate) counters: Counters,
    pub(crate) differs: bool,
    pub(crate) has_been_up: bool,
    /// True while the connection is down and its owner did not end it.
    pub(crate) was_lost: bool,
    pub(crate) events: VecDeque<DriveEvent>,
}

impl DrivenDevice {
    /// Makes the state of a device before its connection.
    pub(crate) fn new(of: FileDevice, opened: OpenedDevice, now: Instant) -> Result<Self, DriveError> {
        let FileDevice { name, file, chosen, script, config } = of;
        let OpenedDevice { inputs, outputs, mut parameters } = opened;
        number_duplicates(parameters.iter_mut().map(|parameter| &mut parameter.signal));
        let mut device = Self {
            name,
            file,
            chosen,
            inputs,
            has_inputs: false,
            outputs,
            is_running: config.is_running,
            is_written: false,
            run_at: script.run.map(|seconds| now + Duration::from_secs_f64(seconds)),
            scripted: Vec::new(),
            parameters,
            accesses: VecDeque::new(),
            asked: None,
            arrivals: Arrivals::default(),
            start: now,
            report_every: config.report_every,
            reported_at: None,
            is_changed: false,
            is_leaving: false,
            is_up: false,
            counters: Counters::default(),
            differs: false,
            has_been_up: false,
            was_lost: false,
            events: VecDeque::new(),
        };
        for output in script.outputs {
            let signal = device.output_signal(&output.name)?.clone();
            // A script whose first value does not fit is refused before it runs.
            SignalValue::from_number(&signal, output.source().value_at(0.0))?;
            device.scripted.push(PlacedOutput { signal, output });
        }
        Ok(device)
    }

    fn output_signal(&self, name: &str) -> Result<&Signal, DriveError> {
        let signals = self.outputs.signals();
        let signal = self
            .outputs
            .find(name)
            .ok_or_else(|| DriveError::unknown("output", name, signals.iter().map(|it| it.name.as_str())))?;
        if signal.is_safety {
            return Err(DriveError::NotWritable {
                kind: "output",
                name: signal.name.clone(),
                reason: "data of a safety protocol are never set; use the maker's tool",
            });
        }
        Ok(signal)
    }

    /// Sets an output from its text, from now on over what the script writes there.
    ///
    /// # Errors
    ///
    /// The device does not have the output, or the value does not fit it.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), DriveError> {
        let signal = self.output_signal(name)?.clone();
        let value = SignalValue::parse(&signal, value)?;
        self.outputs.set(&signal, &value)?;
        let (first, last) = (signal.bit, signal.bit + signal.bits);
        self.scripted.retain(|it| it.signal.bit + it.signal.bits <= first || last <= it.signal.bit);
        self.is_written = false;
        Ok(())
    }

    /// Starts the outputs, or stops them: then the device gets zeros that it is to ignore.
    pub fn run(&mut self, is_running: bool) {
        self.run_at = None;
        if self.is_running != is_running {
            self.is_running = is_running;
            self.events.push_back(DriveEvent::Running(is_running));
        }
        self.is_written = false;
    }

    /// Reads a parameter. [`DriveEvent::Answer`] has its value.
    ///
    /// # Errors
    ///
    /// The file does not have it, or too many accesses wait.
    pub fn read_parameter(&mut self, name: &str) -> Result<(), DriveError> {
        let parameter = parameter::find(&self.parameters, name, |name| parameter_at(&self.file, name))?;
        self.queue(ParameterAccess { parameter, written: None, is_diagnosis: false })
    }

    /// Writes a parameter. [`DriveEvent::Answer`] has the device's answer.
    ///
    /// # Errors
    ///
    /// The file does not have it or says that it is read-only, the value does not fit, or too many accesses wait.
    pub fn write_parameter(&mut self, name: &str, value: &str) -> Result<(), DriveError> {
        let parameter = parameter::find(&self.parameters, name, |name| parameter_at(&self.file, name))?;
        if parameter.is_read_only {
            return Err(DriveError::NotWritable {
                kind: "parameter",
                name: parameter.signal.name,
                reason: "the file says that it is read-only; read it",
            });
        }
        let written = Some(parameter.encode(value)?);
        self.queue(ParameterAccess { parameter, written, is_diagnosis: false })
    }

    fn queue(&mut self, access: ParameterAccess) -> Result<(), DriveError> {
        if self.accesses.len() >= MOST_ACCESSES {
            return Err(DriveError::Bus(format!(
                "{MOST_ACCESSES} accesses wait for the device; ask again after its next answer"
            )));
        }
        self.accesses.push_back(access);
        Ok(())
    }

    /// Returns its name among the devices of the bus.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns whether an output has this name.
    pub(crate) fn has_output(&self, name: &str) -> bool {
        self.outputs.find(name).is_some()
    }

    /// Returns whether a parameter has this name or place.
    pub(crate) fn has_parameter(&self, name: &str) -> bool {
        parameter::find(&self.parameters, name, |name| parameter_at(&self.file, name)).is_ok()
    }

    /// Returns the inputs; `None` while none come that count.
    #[must_use]
    pub fn inputs(&self) -> Option<&SignalTable> {
        self.has_inputs.then_some(&self.inputs)
    }

    /// Returns the signals of the inputs and of the outputs.
    #[must_use]
    pub fn signals(&self) -> (&[Signal], &[Signal]) {
        (self.inputs.signals(), self.outputs.signals())
    }

    /// Returns a table of the inputs for those who print them.
    #[must_use]
    pub fn input_table(&self) -> SignalTable {
        self.inputs.clone()
    }

    /// Returns the outputs.
    #[must_use]
    pub const fn outputs(&self) -> &SignalTable {
        &self.outputs
    }

    /// Returns the value of an input by its name; `None` while none come that count.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<SignalValue> {
        let inputs = self.inputs()?;
        inputs.find(name).map(|signal| inputs.value(signal))
    }

    /// Returns the parameters of the file.
    #[must_use]
    pub fn parameters(&self) -> &[DeviceParameter] {
        &self.parameters
    }

    /// Returns whether data are exchanged, as of the last millisecond.
    #[must_use]
    pub const fn is_up(&self) -> bool {
        self.is_up
    }

    /// Returns whether data were ever exchanged.
    #[must_use]
    pub const fn has_been_up(&self) -> bool {
        self.has_been_up
    }

    /// Returns whether the connection was lost and did not come back.
    #[must_use]
    pub const fn was_lost(&self) -> bool {
        self.was_lost
    }

    /// Returns whether the device was found to differ from the file.
    #[must_use]
    pub const fn differs(&self) -> bool {
        self.differs
    }

    /// Returns the counters of the cyclic data, at most a millisecond old.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Returns the intervals between cyclic data of the device.
    #[must_use]
    pub const fn arrivals(&self) -> &Arrivals {
        &self.arrivals
    }
}
