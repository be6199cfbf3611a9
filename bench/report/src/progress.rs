//! Progress of a run: on a terminal a live line per type, elsewhere plain lines. All on standard error, so that
//! standard output contains only the table.

use std::env;
use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use plc_node::ExecutionType;

use crate::errln;
use node::output;
use records::results::Results;
use records::schedule::Schedule;
use records::voice::Voice;

/// Shortest interval between two plain lines, except for a type's last one.
const PLAIN_LINE_EVERY: Duration = Duration::from_secs(2);

/// Progress display of a run.
#[derive(Debug)]
pub struct Progress {
    view: View,
    reps: u32,
    started: Instant,
    done: u32,
    all: u32,
}

#[derive(Debug)]
enum View {
    Live { bars: Vec<(ExecutionType, ProgressBar)>, screen: MultiProgress },
    Plain { last_line: Option<Instant> },
    Quiet,
}

impl Progress {
    /// Chooses the display that fits standard error.
    #[must_use]
    pub fn start(schedule: &Schedule, quiet: bool) -> Self {
        let view = if quiet {
            View::Quiet
        } else if io::stderr().is_terminal() && env::var_os("TERM").is_none_or(|term| term != "dumb") {
            live(schedule)
        } else {
            View::Plain { last_line: None }
        };
        let all = schedule.reps.saturating_mul(u32::try_from(schedule.types.len()).unwrap_or(u32::MAX));
        Self { view, reps: schedule.reps, started: Instant::now(), done: 0, all }
    }

    /// Shows that a run of this type has started.
    pub fn running(&self, execution_type: ExecutionType, repetition: u32) {
        if let Some(bar) = self.bar(execution_type)
            && repetition == 1
        {
            bar.set_message("running");
        }
    }

    /// Shows a finished repetition.
    pub fn finished(&mut self, execution_type: ExecutionType, repetition: u32, results: &Results) {
        let figures = results.type_figures(execution_type);
        let (aet_ms, mad_ms) = figures.map_or((None, None), |figures| (figures.aet_ms, figures.mad_ms));
        self.finished_with(execution_type, repetition, aet_ms, mad_ms);
    }

    /// Shows a finished repetition with the mean and the deviation of its type so far.
    pub fn finished_with(
        &mut self,
        execution_type: ExecutionType,
        repetition: u32,
        aet_ms: Option<f64>,
        mad_ms: Option<f64>,
    ) {
        self.done += 1;
        let mut figure = aet_ms.map_or_else(String::new, |aet_ms| format!("AET {aet_ms:8.1} ms"));
        if let Some(mad_ms) = mad_ms {
            figure += &format!(" ± {mad_ms:5.1} ms");
        }
        let left = self.time_left();
        let text = format!("{figure}{left}");
        let is_last = repetition == self.reps;
        if let Some(bar) = self.bar(execution_type) {
            bar.set_position(u64::from(repetition));
            bar.set_message(text);
            if is_last {
                bar.abandon();
            }
        } else if let View::Plain { last_line } = &mut self.view
            && (is_last || last_line.is_none_or(|last| last.elapsed() >= PLAIN_LINE_EVERY))
        {
            *last_line = Some(Instant::now());
            errln!("{:<3} {repetition:>3}/{}  {text}", label(execution_type), self.reps);
        }
    }

    /// Prints a warning: what happened, and which option helps.
    pub fn warn(&self, text: &str) {
        self.say(&format!("warning: {text}"));
    }

    /// Prints a line besides the display.
    pub fn say(&self, line: &str) {
        self.voice().say(line);
    }

    /// Returns what prints lines besides the display, for use while the display is elsewhere.
    #[must_use]
    pub fn voice(&self) -> Voice {
        match &self.view {
            View::Live { screen, .. } => {
                let screen = screen.clone();
                Voice::new(move |line| drop(screen.println(output::shown(line))))
            }
            View::Plain { .. } => Voice::new(|line| errln!("{line}")),
            View::Quiet => Voice::new(|_| {}),
        }
    }

    /// Leaves the lines as they are; they no longer change.
    pub fn end(&self) {
        if let View::Live { bars, .. } = &self.view {
            bars.iter().for_each(|(_, bar)| bar.abandon());
        }
    }

    fn bar(&self, execution_type: ExecutionType) -> Option<&ProgressBar> {
        let View::Live { bars, .. } = &self.view else { return None };
        bars.iter().find(|(bar, _)| *bar == execution_type).map(|(_, bar)| bar)
    }

    /// Formats the expected remaining time; empty below one second.
    fn time_left(&self) -> String {
        let per_run = self.started.elapsed().as_secs_f64() / f64::from(self.done.max(1));
        let seconds = (per_run * f64::from(self.all.saturating_sub(self.done))).round() as u64;
        match seconds {
            0 => String::new(),
            1..60 => format!("  {seconds} s left"),
            _ => format!("  {} min {:02} s left", seconds / 60, seconds % 60),
        }
    }
}

fn live(schedule: &Schedule) -> View {
    let screen = MultiProgress::with_draw_target(ProgressDrawTarget::stderr());
    // What does not fit the terminal is cut: a line that breaks would be drawn again below itself.
    let style = ProgressStyle::with_template("{prefix:<3} {bar:10} {pos:>3}/{len}  {wide_msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = |execution_type: &ExecutionType| {
        let bar = screen.add(ProgressBar::new(u64::from(schedule.reps)).with_style(style.clone()));
        bar.set_prefix(label(*execution_type));
        bar.tick();
        (*execution_type, bar)
    };
    View::Live { bars: schedule.types.iter().map(bar).collect(), screen }
}

/// Returns the type's name as in the paper.
#[must_use]
pub fn label(execution_type: ExecutionType) -> String {
    execution_type.to_string().to_uppercase()
}
