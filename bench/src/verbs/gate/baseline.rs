//! The committed figures of a setup, and which files are refused as a baseline.

use std::collections::BTreeMap;
use std::path::Path;

use plc_node::ExecutionType;
use serde::{Deserialize, Serialize};

use records::cell_results::CellResults;
use records::exit::{Exit, Failure};
use records::results::Results;
use report::progress::label;

/// Version of the format.
const SCHEMA_VERSION: u32 = 1;

/// Repetitions of each type, and the seed, of a new baseline.
pub(super) const REPETITIONS: u32 = 25;
pub(super) const SEED: u64 = 1;

/// The baselines of the built-in setups.
pub const BASELINES: &[(&str, &str)] = &[
    ("A", include_str!("../../../baselines/A.json")),
    ("B", include_str!("../../../baselines/B.json")),
    ("C", include_str!("../../../baselines/C.json")),
    ("D", include_str!("../../../baselines/D.json")),
    ("E", include_str!("../../../baselines/E.json")),
    ("F", include_str!("../../../baselines/F.json")),
    ("G", include_str!("../../../baselines/G.json")),
];

/// Half of the millisecond that the gate must detect.
const MILLIS_TOLERANCE: f64 = 0.5;

/// Half a millisecond of the AET of SM, and a little more.
const PERCENT_TOLERANCE: f64 = 0.02;

/// A fifth of what two arms that move together may be off.
const POSE_TOLERANCE_MM: f64 = 0.02;

/// Half a millisecond's frames at a cycle of 1 ms, both ways, over the three types.
const FRAMES_TOLERANCE: f64 = 1.0;

/// What a virtual run of a setup gives.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    /// Version of this format.
    pub schema_version: u32,
    /// The setup's name.
    pub setup: String,
    /// The application's name.
    pub application: String,
    /// Repetitions of each execution type.
    pub reps: u32,
    /// Seed of the run.
    pub seed: u64,
    /// The figures of the run.
    pub figures: Vec<Expected>,
}

/// One figure of a baseline.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// Its name: `RC AET`.
    pub figure: String,
    /// Its unit: `ms`.
    pub unit: String,
    /// Its value.
    pub value: f64,
    /// How far a run may be off it, either way.
    pub tolerance: f64,
}

/// Why a file cannot serve as the baseline of a run.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// It is no baseline.
    #[error("it is not a baseline: {0}; make a new one by --update after moving this file away")]
    Unreadable(serde_json::Error),
    /// Another version of the program wrote it.
    #[error(
        "it has schema version {found}, and this program reads {SCHEMA_VERSION}; move it away and make a new one by --update"
    )]
    Schema {
        /// The version that it has.
        found: u64,
    },
    /// It is of another setup or application.
    #[error(
        "it is the baseline of setup {found}, and setup {wanted} was to be run; name the one of {wanted} by --baseline, or leave the option out"
    )]
    OtherSetup {
        /// Setup and application that it is of.
        found: String,
        /// Setup and application that were to be run.
        wanted: String,
    },
    /// A value or a tolerance is no number to compare with.
    #[error(
        "the value and the tolerance of its figure `{figure}` must be numbers from zero up; correct it by hand"
    )]
    Senseless {
        /// The figure's name.
        figure: String,
    },
}

impl Refusal {
    /// Converts the error to the failure that the program ends with.
    #[must_use]
    pub fn at(self, path: &Path) -> Failure {
        Failure::new(Exit::Usage, anyhow::Error::from(self).context(format!("cannot use {}", path.display())))
    }
}

impl Baseline {
    /// Reads a baseline.
    ///
    /// # Errors
    ///
    /// The text is none, or one of another version.
    pub fn parse(text: &str) -> Result<Self, Refusal> {
        let value: serde_json::Value = serde_json::from_str(text).map_err(Refusal::Unreadable)?;
        if let Some(found) = value.get("schema_version").and_then(serde_json::Value::as_u64)
            && found != u64::from(SCHEMA_VERSION)
        {
            return Err(Refusal::Schema { found });
        }
        // From the text again, so that an error names its line.
        let baseline: Self = serde_json::from_str(text).map_err(Refusal::Unreadable)?;
        let senseless = |expected: &&Expected| !(expected.value.is_finite() && expected.tolerance >= 0.0);
        match baseline.figures.iter().find(senseless) {
            Some(Expected { figure, .. }) => Err(Refusal::Senseless { figure: figure.clone() }),
            None => Ok(baseline),
        }
    }

    /// Refuses a run of something else, by the names of setup and application.
    ///
    /// # Errors
    ///
    /// The baseline is of another setup or application.
    pub fn is_for(&self, setup: &str, application: &str) -> Result<(), Refusal> {
        if self.setup == setup && self.application == application {
            return Ok(());
        }
        let found = format!("{} with {}", self.setup, self.application);
        Err(Refusal::OtherSetup { found, wanted: format!("{setup} with {application}") })
    }

    /// Makes a baseline from a run. Figures that the old baseline has keep their tolerances.
    #[must_use]
    pub fn of(results: &Results, before: Option<&Self>) -> Self {
        let Results { setup, application, reps, seed, .. } = results;
        Self::new([setup, application], *reps, *seed, figures(results), before)
    }

    /// Makes a baseline of a setup and its application from the figures of a run.
    pub(super) fn new(
        [setup, application]: [&str; 2],
        reps: u32,
        seed: u64,
        mut figures: Vec<Expected>,
        before: Option<&Self>,
    ) -> Self {
        for new in &mut figures {
            if let Some(old) = before.and_then(|before| before.get(&new.figure)) {
                new.tolerance = old.tolerance;
            }
        }
        let (setup, application) = (setup.to_owned(), application.to_owned());
        Self { schema_version: SCHEMA_VERSION, setup, application, reps, seed, figures }
    }

    /// Returns the figure with this name.
    #[must_use]
    pub fn get(&self, figure: &str) -> Option<&Expected> {
        self.figures.iter().find(|expected| expected.figure == figure)
    }

    /// Returns the changes from `old` to this one, each as a removed or an added line; empty without a change.
    #[must_use]
    pub fn diff(&self, old: Option<&Self>) -> String {
        let lines = |baseline: &Self| -> BTreeMap<String, String> {
            let line = |expected: &Expected| {
                let Expected { figure, unit, value, tolerance } = expected;
                (figure.clone(), format!("{figure:<34} {value:>12.3} ± {tolerance} {unit}"))
            };
            baseline.figures.iter().map(line).collect()
        };
        let (new, old) = (lines(self), old.map(lines).unwrap_or_default());
        let mut text = String::new();
        for figure in new.keys().chain(old.keys().filter(|figure| !new.contains_key(*figure))) {
            let (before, after) = (old.get(figure), new.get(figure));
            if before == after {
                continue;
            }
            before.iter().for_each(|line| text.push_str(&format!("- {line}\n")));
            after.iter().for_each(|line| text.push_str(&format!("+ {line}\n")));
        }
        text
    }

    /// Returns the baseline as JSON, with a newline at the end.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(|json| json + "\n")
    }
}

fn expected(figure: String, unit: &str, value: f64, tolerance: f64) -> Expected {
    Expected { figure, unit: unit.to_owned(), value: (value * 1e3).round() / 1e3, tolerance }
}

/// Returns the figures of a run of a cell with the tolerances of a new baseline.
pub(super) fn figures_of_cell(results: &CellResults) -> Vec<Expected> {
    let mut figures = Vec::new();
    for execution_type in ExecutionType::ALL {
        let Some(result) = results.results.get(execution_type) else { continue };
        let mut add = |what: &str, value: Option<f64>| {
            let name = format!("{} {what}", label(execution_type));
            figures.extend(value.map(|value| expected(name, "ms", value, MILLIS_TOLERANCE)));
        };
        add("AET", result.aet_ms);
        add("MAD", result.mad_ms);
        for (station, of_station) in results.stations.iter().zip(&result.stations) {
            add(&format!("{} waits", station.name), of_station.mean_waiting_ms());
            add(&format!("{} zone waits", station.name), of_station.mean_zone_waiting_ms());
        }
        add("start skew", result.mean_start_skew_us().map(|micros| micros / 1e3));
        add("mark skew", result.worst_mark_skew_us().map(|micros| micros / 1e3));
        let name = format!("{} relative pose", label(execution_type));
        let pose = result.worst_relative_pose_mm();
        figures.extend(pose.map(|mm| expected(name, "mm", mm, POSE_TOLERANCE_MM)));
    }
    let gain = results.aet_improvement.map(|share| share * 100.0);
    figures.extend(gain.map(|percent| expected("AETi".to_owned(), "%", percent, PERCENT_TOLERANCE)));
    figures
}

/// Returns the figures of a run with the tolerances of a new baseline. Values are whole microseconds and thousandths.
pub(super) fn figures(results: &Results) -> Vec<Expected> {
    let mut figures = Vec::new();
    for execution_type in ExecutionType::ALL {
        if let Some(figure) = results.figure(execution_type) {
            figures.push(expected(
                format!("{} AET", label(execution_type)),
                "ms",
                figure.aet_ms,
                MILLIS_TOLERANCE,
            ));
            figures.push(expected(
                format!("{} MAD", label(execution_type)),
                "ms",
                figure.mad_ms,
                MILLIS_TOLERANCE,
            ));
        }
    }
    if let (Some(cm), Some(rc)) = (results.figure(ExecutionType::Cm), results.figure(ExecutionType::Rc)) {
        figures.push(expected("CM − RC".to_owned(), "ms", cm.aet_ms - rc.aet_ms, MILLIS_TOLERANCE));
    }
    let repetitions: usize = ExecutionType::ALL
        .iter()
        .filter_map(|execution_type| results.results.get(*execution_type))
        .map(|result| result.samples_ms.len())
        .sum();
    if repetitions > 0 {
        let frames = (results.bus.frames_sent + results.bus.frames_received) as f64 / repetitions as f64;
        figures.push(expected("cyclic frames a repetition".to_owned(), "", frames, FRAMES_TOLERANCE));
    }
    figures
}
