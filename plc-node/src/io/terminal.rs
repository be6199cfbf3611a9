//! The terminal of the live view: keys from it, and the screen on it.

use std::io::{self, IsTerminal as _, Write as _};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::{Duration, Instant};

use console::Term;
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

use super::live_screen::screen;
use super::live_view::{KeyAction, LiveView};
use super::owner::IoInstruction;
use super::report::{Printer, Report};

/// Shortest time from one screen to the next.
const REDRAW: Duration = Duration::from_millis(50);

/// Settings of the terminal, which come back when this is dropped: a thread may be reading a key then.
pub(super) struct TerminalSettings(Termios);

impl TerminalSettings {
    /// Returns those of standard input, if it and standard output are a terminal.
    pub(super) fn of_terminal() -> Option<Self> {
        let is_terminal = io::stdin().is_terminal() && io::stdout().is_terminal();
        is_terminal.then(|| tcgetattr(io::stdin()).ok().map(Self)).flatten()
    }
}

impl Drop for TerminalSettings {
    fn drop(&mut self) {
        let _ = tcsetattr(io::stdin(), OptionalActions::Now, &self.0);
    }
}

/// Reads keys until the terminal ends.
pub(super) fn read_keys(reports: &SyncSender<Report>) {
    let terminal = Term::stdout();
    while let Ok(key) = terminal.read_key() {
        if reports.send(Report::Key(key)).is_err() {
            return;
        }
    }
}

/// Shows reports as a screen until the last one, and lets keys instruct the devices.
pub(super) fn show(
    reports: &Receiver<Report>,
    mut printer: Printer,
    mut view: LiveView,
    instructions: &SyncSender<IoInstruction>,
) {
    let mut terminal = Term::buffered_stdout();
    let mut drawn = 0;
    let mut due = None;
    loop {
        let now = Instant::now();
        if due.is_some_and(|due| due <= now) {
            let Ok(lines) = draw(&mut terminal, &view, drawn) else { return };
            (drawn, due) = (lines, None);
        }
        let wait = due.map_or(Duration::from_secs(1), |due: Instant| due.saturating_duration_since(now));
        let report = match reports.recv_timeout(wait) {
            Ok(report) => report,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        due = due.or(Some(now + REDRAW));
        if let Report::Ended(..) = report {
            // What is on the screen stays, with the figures after it.
            let _ = draw(&mut terminal, &view, drawn);
            let _ = printer.print(&report);
            return;
        }
        let action = take(&mut view, &mut printer, &report);
        let sent = match action {
            KeyAction::None => true,
            KeyAction::Instruct(instruction) => instructions.send(instruction).is_ok(),
            KeyAction::End => instructions.send(IoInstruction::End).is_ok(),
        };
        if !sent {
            return;
        }
    }
}

/// Takes a report into the view.
fn take(view: &mut LiveView, printer: &mut Printer, report: &Report) -> KeyAction {
    let texts = printer.note(report);
    match report {
        Report::Key(key) => return view.press(key),
        Report::Inputs(number, bytes) => view.take_inputs(*number, bytes),
        Report::Outputs(number, bytes) => view.take_outputs(*number, bytes),
        Report::Event(number, event) => {
            view.take_event(*number, event);
            texts.into_iter().for_each(|text| view.say(text));
        }
        Report::Refused(_) => texts.into_iter().for_each(|text| view.say(text)),
        Report::Ended(_) => {}
    }
    KeyAction::None
}

/// Draws the screen over the one before. Returns its number of lines.
fn draw(terminal: &mut Term, view: &LiveView, before: usize) -> io::Result<usize> {
    let (height, width) = terminal.size();
    let lines = screen(view, usize::from(width), usize::from(height.saturating_sub(1)));
    terminal.move_cursor_up(before)?;
    terminal.clear_to_end_of_screen()?;
    for line in &lines {
        terminal.write_all(line.as_bytes())?;
        terminal.write_all(b"\n")?;
    }
    terminal.flush()?;
    Ok(lines.len())
}
