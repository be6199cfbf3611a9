//! The live view as text: lines that fit a terminal.

use driven_device::{Signal, SignalTable};

use super::live_view::{LiveView, TypedLine, ViewedDevice, keys_of};
use super::report::{in_units, with_unit};
use crate::printable::printable;

/// Lines of messages at the end of the screen.
const MESSAGES: usize = 5;

/// Fewest lines of signals on a low screen.
const LEAST_SIGNALS: usize = 3;

/// Characters of the column of values, if they are not longer.
const VALUE_WIDTH: usize = 12;

/// Longest name that widens its column.
const WIDEST_NAME: usize = 48;

const KEYS: &str =
    "keys: r run/stop, up and down select, Enter sets, : instruction (read NAME, write NAME=VALUE), q end";

/// A line of a device, and whether it is the selected one.
struct SignalLine {
    text: String,
    is_selected: bool,
}

/// Writes the screen: at most `height` lines of at most `width` characters.
pub(super) fn screen(view: &LiveView, width: usize, height: usize) -> Vec<String> {
    let signals = signal_lines(view);
    let messages = view.messages.len().min(MESSAGES);
    let room = height.saturating_sub(messages + 2).max(LEAST_SIGNALS);
    let selected = signals.iter().position(|line| line.is_selected).unwrap_or(0);
    // The selected line is in the middle of what does not fit.
    let first = selected.saturating_sub(room / 2).min(signals.len().saturating_sub(room));
    let shown = signals.iter().skip(first).take(room).map(|line| line.text.clone());
    let newest = view.messages.iter().skip(view.messages.len() - messages).cloned();
    let lines = shown.chain(newest).chain([last_line(view), KEYS.to_owned()]);
    lines.map(|line| cut(&line, width)).take(height.max(1)).collect()
}

/// Cuts a line that would go on in the next one.
fn cut(line: &str, width: usize) -> String {
    if line.chars().count() <= width {
        return line.to_owned();
    }
    let kept: String = line.chars().take(width.saturating_sub(1)).collect();
    format!("{kept}…")
}

fn signal_lines(view: &LiveView) -> Vec<SignalLine> {
    let mut lines = Vec::new();
    let plain = |text: String| SignalLine { text, is_selected: false };
    let names = view.devices.iter().flat_map(|it| it.inputs.signals().iter().chain(it.outputs.signals()));
    let widest = names.map(|signal| printable(signal.name.as_bytes()).chars().count()).max().unwrap_or(0);
    let name_width = widest.min(WIDEST_NAME);
    for (number, device) in view.devices.iter().enumerate() {
        lines.push(plain(head(view.bus, device)));
        for signal in device.inputs.signals() {
            let value = if device.has_inputs { value_of(&device.inputs, signal) } else { "-".to_owned() };
            lines.push(plain(format!("  input  {}", row(signal, name_width, &value))));
        }
        for (index, signal) in device.outputs.signals().iter().enumerate() {
            let is_selected = view.selected == Some((number, index));
            let mark = if is_selected { '>' } else { ' ' };
            let value = value_of(&device.outputs, signal);
            let text = format!("{mark} output {}", row(signal, name_width, &value));
            lines.push(SignalLine { text, is_selected });
        }
    }
    lines
}

fn head(bus: &str, device: &ViewedDevice) -> String {
    let name = if device.name.is_empty() { bus.to_owned() } else { printable(device.name.as_bytes()) };
    let connection = if device.is_up { "up" } else { "not connected" };
    let outputs = if device.is_running { "outputs run" } else { "outputs are stopped: r runs them" };
    format!("{name}: {connection}, {outputs}")
}

fn row(signal: &Signal, name_width: usize, value: &str) -> String {
    let name = printable(signal.name.as_bytes());
    let kind = with_unit(&signal.type_name(), &signal.unit);
    let safety = if signal.is_safety { " (safety: shown only)" } else { "" };
    format!("{name:name_width$}  {value:VALUE_WIDTH$}  {kind}{safety}")
}

fn value_of(table: &SignalTable, signal: &Signal) -> String {
    let value = table.value(signal);
    in_units(&value, value.scaled(signal), value.text(signal), &signal.unit)
}

/// Returns what is being typed, or how the selected output is set.
fn last_line(view: &LiveView) -> String {
    let signal =
        view.selected.and_then(|(number, index)| view.devices.get(number)?.outputs.signals().get(index));
    let name = signal.map(|signal| printable(signal.name.as_bytes())).unwrap_or_default();
    match (&view.typed, signal) {
        (Some(TypedLine::Value(text)), _) => format!("{name} = {text}_  (Enter sets it, Escape leaves it)"),
        (Some(TypedLine::Instruction(text)), _) => format!(": {text}_  (Enter, or Escape)"),
        (None, Some(signal)) => format!("{name}: {}", keys_of(signal)),
        (None, None) => "no output that can be set".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use console::Key;
    use device_files::{DeviceChoice, choose, read};
    use driven_device::{BusConfig, DriveConfig, DriveEvent, DrivenBus, FileDevice, OutputScript};
    use machine::ethernet::Mac;
    use machine::{Down, DownCause, Duration, Instant};

    use super::super::live_view::KeyAction;
    use super::super::owner::IoInstruction;
    use super::*;

    const GSDML: &str = include_str!("../../../scripts/interop/files/GSDML-V2.35-made-up-io-20260101.xml");
    const ESI: &str = include_str!("../../../scripts/interop/files/made-up-terminal.xml");

    /// Makes a view of devices of a file, each with a name and a choice.
    fn view(file: (&str, &str), devices: &[(&str, &str)]) -> LiveView {
        let devices = devices.iter().zip(1..).map(|((name, choice), number)| {
            let file = read(file.0, file.1.to_owned().into()).unwrap();
            let chosen = choose(&file, &DeviceChoice::from_toml(choice).unwrap()).unwrap();
            let config = DriveConfig {
                device_address: Some(Ipv4Addr::new(192, 168, 64, 1 + number)),
                station_name: Some((*name).to_owned()),
                position: Some(number.into()),
                interval: None,
                output_interval: None,
                input_interval: None,
                is_running: false,
                report_every: Duration::from_millis(100),
            };
            FileDevice { name: (*name).to_owned(), file, chosen, script: OutputScript::default(), config }
        });
        let bus = BusConfig {
            mac: Mac([2, 0, 0, 0, 0, 1]),
            address: Some(Ipv4Addr::new(192, 168, 64, 1)),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            seed: 1,
        };
        LiveView::new(&DrivenBus::new(devices.collect(), &bus, Instant::ZERO).unwrap(), false)
    }

    fn terminals() -> LiveView {
        let choices = [("analog", "device_name = \"MU1002\""), ("digital", "device_name = \"MU2004\"")];
        view(("made-up-terminal.xml", ESI), &choices)
    }

    fn press(view: &mut LiveView, keys: &str) -> Vec<KeyAction> {
        let key = |letter| match letter {
            '\n' => Key::Enter,
            '\u{8}' => Key::Backspace,
            '\u{1b}' => Key::Escape,
            letter => Key::Char(letter),
        };
        let actions = keys.chars().map(|letter| view.press(&key(letter)));
        actions.filter(|action| *action != KeyAction::None).collect()
    }

    fn set(name: &str, value: &str) -> KeyAction {
        KeyAction::Instruct(IoInstruction::Set(name.to_owned(), value.to_owned()))
    }

    fn text(view: &LiveView, width: usize, height: usize) -> String {
        screen(view, width, height).iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn a_device_is_shown_with_its_inputs_outputs_and_messages() {
        let choice = "[modules]\n1 = \"M_8DI\"\n2 = \"M_2AO\"\n";
        let mut view = view(("GSDML-V2.35-a.xml", GSDML), &[("made-up-io", choice)]);
        view.take_event(0, &DriveEvent::Up);
        view.take_inputs(0, &[0xA5, 1, 2]);
        view.take_outputs(0, &[0, 7, 0, 9]);
        view.say("up: data are exchanged".to_owned());
        insta::assert_snapshot!(text(&view, 100, 40), @"
        PROFINET: up, outputs are stopped: r runs them
          input  1.1                     a5            1 bytes
          input  1.1/8 digital inputs    165           uint8
          input  2.1                     0102          2 bytes
          input  2.1/2 analog outputs    258           uint16
        > output 2.1                     00070009      4 bytes
          output 2.1/2 analog outputs    7             uint16
          output 2.1/2 analog outputs#2  9             uint16
        up: data are exchanged
        2.1: Enter, then hexadecimal digits
        keys: r run/stop, up and down select, Enter sets, : instruction (read NAME, write NAME=VALUE), q end
        ");
    }

    #[test]
    fn keys_select_an_output_of_any_device_and_set_it() {
        let mut view = terminals();
        assert_eq!(press(&mut view, "258\n"), [set("analog/Outputs/Output", "258")]);
        assert_eq!(press(&mut view, "-1\u{8}2\n"), [set("analog/Outputs/Output", "-2")]);
        assert_eq!(press(&mut view, "jj "), [set("digital/Channels/Channel 2", "true")]);
        // The next press switches what the device has by then.
        view.take_outputs(1, &[0b10]);
        assert_eq!(press(&mut view, " "), [set("digital/Channels/Channel 2", "false")]);
        assert_eq!(press(&mut view, "jjjjjk "), [set("digital/Channels/Channel 3", "true")]);
        assert_eq!(press(&mut view, "kkkkkkk"), []);
        view.take_outputs(0, &[0xFF, 0xFF]);
        assert_eq!(press(&mut view, "+"), [set("analog/Outputs/Output", "0")]);
        assert_eq!(press(&mut view, "_"), [set("analog/Outputs/Output", "-2")]);
        assert_eq!(press(&mut view, " "), [], "a number is not toggled");
    }

    #[test]
    fn r_runs_the_outputs_and_stops_them() {
        let mut view = terminals();
        let run = |is_running| KeyAction::Instruct(IoInstruction::Run(is_running, None));
        assert_eq!(press(&mut view, "r"), [run(true)]);
        view.take_event(0, &DriveEvent::Running(true));
        view.take_event(1, &DriveEvent::Running(true));
        assert_eq!(press(&mut view, "r"), [run(false)]);
        assert_eq!(press(&mut view, "q"), [KeyAction::End]);
    }

    #[test]
    fn an_instruction_is_typed_after_a_colon_and_escape_leaves_it() {
        let mut view = terminals();
        let read = KeyAction::Instruct(IoInstruction::Read("analog/Filter".to_owned()));
        assert_eq!(press(&mut view, ":read analog/Filter\n"), [read]);
        assert_eq!(press(&mut view, ":q\u{1b}"), []);
        assert_eq!(press(&mut view, "12\u{1b}"), []);
        assert_eq!(press(&mut view, ":go\n"), []);
        assert!(view.messages.back().unwrap().starts_with("refused: must be run [NAME]"));
        assert_eq!(press(&mut view, "\n\n"), [], "no value is no value");
    }

    #[test]
    fn a_low_and_narrow_screen_keeps_the_selected_output_in_sight() {
        let mut view = terminals();
        press(&mut view, "jjjj5");
        let down = DriveEvent::Down(Down { cause: DownCause::NoAnswer, code: 0, text: "" }, String::new());
        view.take_event(0, &down);
        for number in 0..60 {
            view.say(format!("message {number}"));
        }
        assert_eq!(view.messages.len(), 50);
        let lines = screen(&view, 40, 12);
        assert_eq!(lines.len(), 12);
        assert!(lines.iter().all(|line| line.chars().count() <= 40), "{lines:?}");
        insta::assert_snapshot!(text(&view, 40, 12), @"
        digital: not connected, outputs are sto…
          output Channels/Channel 1  0         …
          output Channels/Channel 2  0         …
          output Channels/Channel 3  0         …
        > output Channels/Channel 4  0         …
        message 55
        message 56
        message 57
        message 58
        message 59
        Channels/Channel 4 = 5_  (Enter sets it…
        keys: r run/stop, up and down select, E…
        ");
        // One without room for anything else still has a line.
        assert_eq!(screen(&view, 10, 1).len(), 1);
    }

    #[test]
    fn names_of_a_file_reach_no_terminal_control() {
        let file = ESI.replace("<Name>Output</Name>", "<Name>Out&#27;[2Jput</Name>");
        let view = view(("made-up-terminal.xml", &file), &[("a\u{1b}[2J", "device_name = \"MU1002\"")]);
        assert!(!text(&view, 100, 40).contains('\u{1b}'));
    }
}
