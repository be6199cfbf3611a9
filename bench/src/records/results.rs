//! The results of a run as JSON. `schema_version` counts changes that break a reader.
//!
//! There is no time, host or path in here: a virtual run of one seed gives the same bytes on every machine. What
//! the run ran on stands in `host.json`.

use plc_node::ExecutionType;
use robot_node::quality::RatingExceeded;
use serde::{Deserialize, Serialize};
use setup::{Provenance, Setup, Sourced};

use crate::records::conditions::{Health, Measured};
use crate::records::faults::FaultReport;
use crate::records::lateness::CycleLateness;
use crate::records::mode::Mode;
use crate::records::quality::MotionQuality;
use crate::records::schedule::Plan;
use crate::records::statistics::{Figure, aet_improvement};

/// Version of the format.
pub const SCHEMA_VERSION: u32 = 1;

/// Everything that a run found out.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Results {
    /// Version of this format.
    pub schema_version: u32,
    /// The setup's name.
    pub setup: String,
    /// The setup's title.
    pub title: String,
    /// The application's name.
    pub application: String,
    /// `real` or `virtual`.
    pub mode: String,
    /// Seed of pauses, and in virtual mode of clocks and phases.
    pub seed: u64,
    /// Repetitions of each type that were asked for.
    pub reps: u32,
    /// What became of the override in each repetition, as `--override` says it; absent where it stayed at 100 %.
    #[serde(default, rename = "override", skip_serializing_if = "Option::is_none")]
    pub overrides: Option<String>,
    /// How far the run is, or how it ended.
    pub status: Status,
    /// What each type took; types that were not asked for are absent.
    pub results: PerType<TypeResult>,
    /// AETi, (SM − CM) / SM, 0…1; null without both.
    pub aet_improvement: Option<f64>,
    /// The same in virtual time without the calibrated skill overhead; null where it was not run.
    pub without_skill_overhead: Option<WithoutOverhead>,
    /// What the paper found; null for a setup that it does not have, and with an override, which it did not use.
    pub paper: Option<PerType<PaperFigure>>,
    /// Numbers of the setup that were chosen so that the paper's figures come out; none with an override, since the figures
    /// are others then.
    pub calibrated: Vec<Calibrated>,
    /// How late the cycles ran.
    pub cycle: Cycles,
    /// Cyclic frames as the PLC counts them.
    pub bus: Frames,
    /// From the start of the nodes until the robot was ready; null in virtual mode and where the nodes ran already.
    #[serde(default)]
    pub connected_after_ms: Option<f64>,
    /// Allocations of the cyclic threads once the connection was up; null where they are not counted.
    #[serde(default)]
    pub cyclic_allocations: Option<Allocations>,
    /// Repetitions that were run again, because the host held a node up until the connection was lost. What was lost with it
    /// is among no samples.
    #[serde(default)]
    pub repeated: u32,
    /// Faults that were put into the cable, and what came of them; absent without any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub faults: Option<FaultReport>,
}

/// How far a run is, or how it ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// Repetitions are still to come, or the program was killed before it could say otherwise.
    Running,
    /// All repetitions are there.
    Complete,
    /// A repetition failed, which ended the run.
    Failed,
    /// Ctrl-C or SIGTERM ended the run.
    Interrupted,
}

/// One value for each execution type that there is.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PerType<T> {
    /// Programmed in the robot controller.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rc: Option<T>,
    /// Single motions from the PLC.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sm: Option<T>,
    /// One MoveContinuousSkill from the PLC.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cm: Option<T>,
}

impl<T> Default for PerType<T> {
    fn default() -> Self {
        Self { rc: None, sm: None, cm: None }
    }
}

impl<T> PerType<T> {
    /// The value of a type.
    pub const fn get(&self, of: ExecutionType) -> Option<&T> {
        match of {
            ExecutionType::Rc => self.rc.as_ref(),
            ExecutionType::Sm => self.sm.as_ref(),
            ExecutionType::Cm => self.cm.as_ref(),
        }
    }

    /// The place of a type's value.
    pub const fn entry(&mut self, of: ExecutionType) -> &mut Option<T> {
        match of {
            ExecutionType::Rc => &mut self.rc,
            ExecutionType::Sm => &mut self.sm,
            ExecutionType::Cm => &mut self.cm,
        }
    }
}

/// What one type took. The vectors have one entry a successful repetition.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct TypeResult {
    /// Mean of the samples in ms; null without any.
    pub aet_ms: Option<f64>,
    /// Mean absolute deviation from that mean in ms; null without any sample.
    pub mad_ms: Option<f64>,
    /// Execution times in ms, taken on the PLC.
    pub samples_ms: Vec<f64>,
    /// The robot's own measure in ms.
    pub robot_samples_ms: Vec<f64>,
    /// Motions run to a stop because the next one was not there in time.
    pub blends_suppressed: Vec<u32>,
    /// Repetitions that failed.
    pub failed: Vec<FailedRepetition>,
    /// How well the arm moved; null where no repetition says so.
    #[serde(default)]
    pub quality: Option<MotionQuality>,
}

/// A repetition that failed.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FailedRepetition {
    /// Which one of its type, counted from 1.
    pub repetition: u32,
    /// Why.
    pub error: String,
}

/// A virtual run in which a skill call costs nothing besides its motion: what the model alone predicts.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct WithoutOverhead {
    /// AET and MAD.
    pub results: PerType<PaperFigure>,
    /// AETi, 0…1; null without both SM and CM.
    pub aet_improvement: Option<f64>,
}

/// AET and MAD in ms.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PaperFigure {
    /// Average execution time.
    pub aet_ms: f64,
    /// Mean absolute deviation from it.
    pub mad_ms: f64,
}

impl From<Figure> for PaperFigure {
    fn from(Figure { aet_ms, mad_ms }: Figure) -> Self {
        Self { aet_ms, mad_ms }
    }
}

impl From<setup::Figure> for PaperFigure {
    fn from(setup::Figure { aet_ms, mad_ms }: setup::Figure) -> Self {
        Self { aet_ms, mad_ms }
    }
}

/// A number that was chosen so that a published figure comes out.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Calibrated {
    /// Its key in the setup.
    pub key: String,
    /// Its value, in the unit that the key names.
    pub value: f64,
    /// From what.
    pub note: String,
}

/// How late the cycles ran. In virtual mode nothing is late.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Cycles {
    /// The PLC's scans.
    pub plc: CycleLateness,
    /// The robot's interpolation cycles.
    pub robot: CycleLateness,
}

/// Cyclic frames as the PLC counts them.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Frames {
    /// Sent to the robot.
    pub frames_sent: u64,
    /// Received from the robot and taken over.
    pub frames_received: u64,
    /// Cycles in which either node sent nothing, because its host held it up.
    pub skipped: u64,
    /// Sent by either node and never received.
    pub lost: u64,
}

/// Allocations of the cyclic threads once the connection was up.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Allocations {
    /// Of the PLC.
    pub plc: u64,
    /// Of the robot.
    pub robot: u64,
}

impl Results {
    /// The results of a run that is about to start.
    #[must_use]
    pub fn new(setup: &Setup, application: &str, mode: Mode, plan: &Plan) -> Self {
        let mut results = PerType::default();
        for of in &plan.types {
            *results.entry(*of) = Some(TypeResult::default());
        }
        Self {
            schema_version: SCHEMA_VERSION,
            setup: setup.name.clone(),
            title: setup.title.clone(),
            application: application.to_owned(),
            mode: mode.name().to_owned(),
            seed: plan.seed,
            reps: plan.reps,
            overrides: plan.overrides.map(|overrides| overrides.to_string()),
            status: Status::Running,
            results,
            aet_improvement: None,
            without_skill_overhead: None,
            paper: setup.paper.as_ref().filter(|_| plan.overrides.is_none()).map(|paper| PerType {
                rc: Some(paper.rc.into()),
                sm: Some(paper.sm.into()),
                cm: Some(paper.cm.into()),
            }),
            calibrated: if plan.overrides.is_none() { calibrated(setup) } else { Vec::new() },
            cycle: Cycles::default(),
            bus: Frames::default(),
            connected_after_ms: None,
            cyclic_allocations: None,
            repeated: 0,
            faults: None,
        }
    }

    /// Takes up a finished run.
    ///
    /// # Errors
    ///
    /// A joint exceeded what it is rated for. How the arm moved is taken up then, but not the time: no real arm takes it.
    pub fn record(&mut self, of: ExecutionType, measured: &Measured) -> Result<(), RatingExceeded> {
        let result = self.results.entry(of).get_or_insert_default();
        if let Some(quality) = &measured.quality {
            result.quality.get_or_insert_default().record(quality);
            quality.check_ratings()?;
        }
        let millis = |nanos: u64| nanos as f64 / 1e6;
        result.samples_ms.push(millis(measured.execution.execution_time_ns));
        result.robot_samples_ms.push(millis(measured.execution.robot_execution_ns));
        result.blends_suppressed.push(measured.execution.blends_suppressed);
        if let Some(figure) = figure(&result.samples_ms) {
            (result.aet_ms, result.mad_ms) = (Some(figure.aet_ms), Some(figure.mad_ms));
        }
        let aet = |of| self.results.get(of).and_then(|result| result.aet_ms);
        self.aet_improvement =
            aet(ExecutionType::Sm).zip(aet(ExecutionType::Cm)).map(|(sm, cm)| aet_improvement(sm, cm));
        Ok(())
    }

    /// Takes up a repetition that failed.
    pub fn record_failure(&mut self, of: ExecutionType, repetition: u32, error: String) {
        self.results.entry(of).get_or_insert_default().failed.push(FailedRepetition { repetition, error });
    }

    /// Takes up the conditions of the run so far.
    pub fn set_health(&mut self, health: &Health) {
        self.cycle = Cycles { plc: health.plc.clone(), robot: health.robot.clone() };
        self.bus = Frames {
            frames_sent: health.bus.sent,
            frames_received: health.bus.received,
            skipped: health.bus.skipped + health.robot_bus.skipped,
            lost: health.frames_lost(),
        };
        self.connected_after_ms = health.connected_after.map(|after| after.as_secs_f64() * 1e3);
        self.cyclic_allocations = health.allocations.map(|[plc, robot]| Allocations { plc, robot });
        self.repeated = u32::try_from(health.repeated.len()).unwrap_or(u32::MAX);
        self.faults.clone_from(&health.faults);
    }

    /// What stands beside this run as the one without the calibrated overhead.
    #[must_use]
    pub fn as_without_overhead(&self) -> WithoutOverhead {
        let mut results = PerType::default();
        for of in ExecutionType::ALL {
            let figure = self.results.get(of).and_then(|result| result.aet_ms.zip(result.mad_ms));
            *results.entry(of) = figure.map(|(aet_ms, mad_ms)| PaperFigure { aet_ms, mad_ms });
        }
        WithoutOverhead { results, aet_improvement: self.aet_improvement }
    }

    /// AET and MAD of a type so far.
    #[must_use]
    pub fn figure(&self, of: ExecutionType) -> Option<PaperFigure> {
        let result = self.results.get(of)?;
        result.aet_ms.zip(result.mad_ms).map(|(aet_ms, mad_ms)| PaperFigure { aet_ms, mad_ms })
    }

    /// Whether a number of the setup was chosen so that a published figure comes out.
    #[must_use]
    pub fn is_calibrated(&self, key: &str) -> bool {
        self.calibrated.iter().any(|calibrated| calibrated.key == key)
    }

    /// The seed, and the override where there is one: the end of the line that says what the run is.
    #[must_use]
    pub fn seed_and_override(&self, separator: &str) -> String {
        let seed = format!("seed {}", self.seed);
        self.overrides.iter().fold(seed, |text, overrides| format!("{text}{separator}override {overrides}"))
    }

    /// The results as JSON, with a newline at the end.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(|json| json + "\n")
    }
}

/// Samples are whole nanoseconds, which a millisecond count carries exactly up to hours.
fn figure(samples_ms: &[f64]) -> Option<Figure> {
    let nanos = |millis: &f64| std::time::Duration::from_nanos((millis * 1e6).round() as u64);
    Figure::of(samples_ms.iter().map(nanos))
}

/// Key of the programmed speed, which RC's AET fixes.
pub const VELOCITY: &str = "motions.velocity_percent";
/// Key of the cost of a skill call, which SM's AET fixes.
pub const SKILL_OVERHEAD: &str = "robot.skill_overhead_us";
/// Key of the controller's time quantum, which the MADs fix.
pub const QUANTUM: &str = "robot.interpreter_quantum_us";

/// Key of the spread of a program's start, which RC's MAD fixes.
pub const START_QUANTUM: &str = "robot.start_quantum_us";

fn calibrated(setup: &Setup) -> Vec<Calibrated> {
    fn entry<T: Copy + Into<f64>>(key: &str, number: &Sourced<T>) -> Option<Calibrated> {
        (number.from == Provenance::Calibrated).then(|| Calibrated {
            key: key.to_owned(),
            value: number.value.into(),
            note: number.note.clone(),
        })
    }
    let numbers = [
        entry(VELOCITY, &setup.motions.velocity_percent),
        entry(SKILL_OVERHEAD, &setup.robot.skill_overhead_us),
        entry(QUANTUM, &setup.robot.interpreter_quantum_us),
        setup.robot.start_quantum_us.as_ref().and_then(|quantum| entry(START_QUANTUM, quantum)),
    ];
    numbers.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it anew, as it does with snapshots.
    #[test]
    fn the_committed_schema_is_that_of_the_results() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/schemas/results.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(Results)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            std::fs::read_to_string(path).unwrap() == schema,
            "results.json changed: count SCHEMA_VERSION up where a reader breaks, then INSTA_UPDATE=always cargo test -p bench --lib results"
        );
    }
}
