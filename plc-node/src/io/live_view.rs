//! The live view of driven devices: what is shown, and what a key does. It knows no terminal.

use std::collections::VecDeque;

use console::Key;
use driven_device::{DriveEvent, DrivenBus, Signal, SignalTable, SignalType, SignalValue};

use super::owner::IoInstruction;

/// Messages that are kept.
const MOST_MESSAGES: usize = 50;

/// A device as it is shown.
#[derive(Debug)]
pub(super) struct ViewedDevice {
    /// Its name; empty for the only one.
    pub(super) name: String,
    pub(super) inputs: SignalTable,
    pub(super) has_inputs: bool,
    pub(super) outputs: SignalTable,
    pub(super) is_up: bool,
    pub(super) is_running: bool,
}

/// Line that is being typed.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum TypedLine {
    /// A value for the selected output.
    Value(String),
    /// An instruction, such as `read NAME`.
    Instruction(String),
}

/// Request of a key.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum KeyAction {
    /// Nothing but another screen.
    None,
    Instruct(IoInstruction),
    End,
}

/// State of the view.
#[derive(Debug)]
pub(super) struct LiveView {
    pub(super) bus: &'static str,
    pub(super) devices: Vec<ViewedDevice>,
    /// Device and output that keys change; none if there is no output that may be set.
    pub(super) selected: Option<(usize, usize)>,
    pub(super) typed: Option<TypedLine>,
    /// Messages, the newest last.
    pub(super) messages: VecDeque<String>,
}

impl LiveView {
    pub(super) fn new(bus: &DrivenBus, is_running: bool) -> Self {
        let is_alone = bus.devices().len() == 1;
        let devices = bus.devices().iter().map(|device| ViewedDevice {
            name: if is_alone { String::new() } else { device.name().to_owned() },
            inputs: device.input_table(),
            has_inputs: false,
            outputs: device.outputs().clone(),
            is_up: false,
            is_running,
        });
        let mut view = Self {
            bus: bus.bus(),
            devices: devices.collect(),
            selected: None,
            typed: None,
            messages: VecDeque::new(),
        };
        let first = view.outputs().next();
        view.selected = first;
        view
    }

    /// Returns the outputs that may be set, in their order.
    fn outputs(&self) -> impl DoubleEndedIterator<Item = (usize, usize)> + '_ {
        self.devices.iter().enumerate().flat_map(|(number, device)| {
            let signals = device.outputs.signals().iter().enumerate();
            signals.filter(|(_, signal)| !signal.is_safety).map(move |(index, _)| (number, index))
        })
    }

    fn selected(&self) -> Option<(&ViewedDevice, &Signal)> {
        let (number, index) = self.selected?;
        let device = self.devices.get(number)?;
        Some((device, device.outputs.signals().get(index)?))
    }

    /// Takes the inputs of a device.
    pub(super) fn take_inputs(&mut self, number: usize, bytes: &[u8]) {
        if let Some(device) = self.devices.get_mut(number) {
            device.inputs.replace(bytes);
            device.has_inputs = !bytes.is_empty();
        }
    }

    /// Takes the outputs of a device.
    pub(super) fn take_outputs(&mut self, number: usize, bytes: &[u8]) {
        if let Some(device) = self.devices.get_mut(number) {
            device.outputs.replace(bytes);
        }
    }

    /// Takes what an event changes in the state of a device.
    pub(super) fn take_event(&mut self, number: usize, event: &DriveEvent) {
        let Some(device) = self.devices.get_mut(number) else { return };
        match event {
            DriveEvent::Up | DriveEvent::Configured => device.is_up = true,
            DriveEvent::Down(..) => (device.is_up, device.has_inputs) = (false, false),
            DriveEvent::Running(is_running) => device.is_running = *is_running,
            _ => {}
        }
    }

    /// Keeps a message.
    pub(super) fn say(&mut self, message: String) {
        if self.messages.len() == MOST_MESSAGES {
            self.messages.pop_front();
        }
        self.messages.push_back(message);
    }

    /// Handles a key.
    pub(super) fn press(&mut self, key: &Key) -> KeyAction {
        if let Some(typed) = self.typed.take() {
            return self.go_on(typed, key);
        }
        match key {
            Key::Char('q') => KeyAction::End,
            Key::Char('r') => {
                let is_running = self.selected.and_then(|(number, _)| self.devices.get(number));
                let is_running = is_running.or(self.devices.first()).is_some_and(|it| it.is_running);
                KeyAction::Instruct(IoInstruction::Run(!is_running, None))
            }
            Key::ArrowUp | Key::Char('k') => {
                self.select(|view, place| view.outputs().rfind(|it| *it < place))
            }
            Key::ArrowDown | Key::Char('j') => {
                self.select(|view, place| view.outputs().find(|it| *it > place))
            }
            Key::Char(':') => self.begin(TypedLine::Instruction(String::new())),
            Key::Enter if self.selected.is_some() => self.begin(TypedLine::Value(String::new())),
            Key::Char(digit @ ('0'..='9' | '-')) if self.selected.is_some() => {
                self.begin(TypedLine::Value(digit.to_string()))
            }
            Key::Char(' ') => self.change(|_, value| match value {
                SignalValue::Bool(is_on) => Some((!is_on).to_string()),
                _ => None,
            }),
            Key::Char('+') => self.change(|signal, value| step(signal, value, 1)),
            Key::Char('_') => self.change(|signal, value| step(signal, value, -1)),
            _ => KeyAction::None,
        }
    }

    fn begin(&mut self, typed: TypedLine) -> KeyAction {
        self.typed = Some(typed);
        KeyAction::None
    }

    /// Handles a key while a line is typed.
    fn go_on(&mut self, mut typed: TypedLine, key: &Key) -> KeyAction {
        let text = match &mut typed {
            TypedLine::Value(text) | TypedLine::Instruction(text) => text,
        };
        match key {
            Key::Enter => return self.finish(&typed),
            Key::Escape => return KeyAction::None,
            // Before the first letter it leaves the line.
            Key::Backspace if text.is_empty() => return KeyAction::None,
            Key::Backspace => drop(text.pop()),
            Key::Char(letter) if !letter.is_control() => text.push(*letter),
            _ => {}
        }
        self.begin(typed)
    }

    fn finish(&mut self, typed: &TypedLine) -> KeyAction {
        match typed {
            TypedLine::Value(text) if text.trim().is_empty() => KeyAction::None,
            TypedLine::Value(text) => self.set(text.trim()),
            TypedLine::Instruction(text) => match IoInstruction::parse(text) {
                Ok(instruction) => KeyAction::Instruct(instruction),
                Err(error) => {
                    self.say(format!("refused: {error}"));
                    KeyAction::None
                }
            },
        }
    }

    /// Selects another output, if there is one.
    fn select(&mut self, next: impl Fn(&Self, (usize, usize)) -> Option<(usize, usize)>) -> KeyAction {
        if let Some(found) = self.selected.and_then(|place| next(self, place)) {
            self.selected = Some(found);
        }
        KeyAction::None
    }

    /// Changes the selected output from its value.
    fn change(&self, change: impl Fn(&Signal, &SignalValue) -> Option<String>) -> KeyAction {
        let text = self.selected().and_then(|(device, signal)| change(signal, &device.outputs.value(signal)));
        text.map_or(KeyAction::None, |text| self.set(&text))
    }

    fn set(&self, text: &str) -> KeyAction {
        let Some((device, signal)) = self.selected() else { return KeyAction::None };
        let name = match device.name.as_str() {
            "" => signal.name.clone(),
            name => format!("{name}/{}", signal.name),
        };
        KeyAction::Instruct(IoInstruction::Set(name, text.to_owned()))
    }
}

/// Returns the next number after a value, as it is typed; `None` for what is not a whole number.
fn step(signal: &Signal, value: &SignalValue, by: i64) -> Option<String> {
    let next = match value {
        SignalValue::Unsigned(number) => i128::from(number.checked_add_signed(by)?),
        SignalValue::Signed(number) => i128::from(number.checked_add(by)?),
        _ => return None,
    };
    match signal.scale {
        None => Some(next.to_string()),
        // A number alone would be one of the signal's unit.
        Some(_) => (next >= 0).then(|| format!("0x{next:X}")),
    }
}

/// Returns how the values of a signal are typed.
pub(super) const fn keys_of(signal: &Signal) -> &'static str {
    match signal.kind {
        SignalType::Bool => "space toggles",
        SignalType::Unsigned | SignalType::Signed => "type a number, + and _ step",
        SignalType::Real => "type a number",
        SignalType::Bytes => "Enter, then hexadecimal digits",
    }
}
