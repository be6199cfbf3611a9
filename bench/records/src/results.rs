//! The results of a measurement as JSON. `schema_version` counts changes that break a reader.
//!
//! They contain no time and no path, and no host but those of attached nodes: a virtual run with one seed gives the same
//! bytes on every computer. The bench's host is described in `host.json`.

use plc_node::ExecutionType;
use robot_node::Positions;
use robot_node::quality::RatingExceeded;
use serde::{Deserialize, Serialize};
use setup::Setup;

use crate::arms::Arms;
use crate::attached::Attached;
use crate::calibrated::Calibrated;
use crate::conditions::{Health, Measured};
use crate::digest::Digests;
use crate::disturbances::{Images, MissedCycles};
use crate::faults::FaultReport;
pub use crate::frames::Frames;
use crate::lateness::CycleLateness;
use crate::mode::Mode;
use crate::origin::SampleOrigin;
use crate::quality::MotionQuality;
use crate::schedule::Schedule;
use crate::statistics::{AetMad, aet_improvement};

/// Version of the format.
pub const SCHEMA_VERSION: u32 = 1;

/// All results of a measurement.
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
    /// `real` or `virtual`; `captured` or `imported` where no bench ran the measurement.
    pub mode: String,
    /// Seed of pauses, and in virtual mode of clocks and phases.
    pub seed: u64,
    /// Requested repetitions of each type.
    pub reps: u32,
    /// What became of the override in each repetition, as `--override` says it; absent where it stayed at 100 %.
    #[serde(default, rename = "override", skip_serializing_if = "Option::is_none")]
    pub overrides: Option<String>,
    /// Source of the robot's positions, from which path, speed, quality and end are judged: `drives` or `set-points`. Absent in
    /// a run of an older version, and where the robot is not a node of ours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub positions: Option<Positions>,
    /// The nodes that ran already; absent where the bench started its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attached: Option<Attached>,
    /// Source of the samples; absent where the bench ran the measurement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<SampleOrigin>,
    /// Progress of the run, or how it ended.
    pub status: Status,
    /// Results of each type; types that were not requested are absent.
    pub results: PerType<TypeResult>,
    /// AETi, (SM − CM) / SM, 0…1; null if either is missing.
    pub aet_improvement: Option<f64>,
    /// The same in virtual time without the calibrated skill overhead; null if it was not run.
    pub without_skill_overhead: Option<WithoutOverhead>,
    /// The paper's figures; null unless the run is of the paper's cell.
    pub paper: Option<PerType<AetMad>>,
    /// Why the paper's figures do not stand beside a run whose setup has them; absent where they do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_paper: Option<String>,
    /// The paper's two arms, each also with the other's programmed motions; absent unless the run is of the paper's cell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arms: Option<Arms>,
    /// Numbers of the setup that were chosen to reproduce the paper's figures; none unless those stand beside the run.
    pub calibrated: Vec<Calibrated>,
    /// Lateness of the cycles.
    pub cycle: Cycles,
    /// Cyclic frames counted by the PLC.
    pub bus: Frames,
    /// Images that the nodes received with a wrong check, or without one.
    #[serde(default)]
    pub images: Images,
    /// What was remarkable about the connection, such as longer intervals than asked for; absent if nothing was.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub connection_remarks: Vec<String>,
    /// What was not verified of the repetitions, each with the reason; absent if everything was.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_verified: Vec<String>,
    /// What traces and captures of the run lack, as sentences; absent if they are complete.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub incomplete: Vec<String>,
    /// Time from the start of the nodes until the robot was ready; null in virtual mode and if the nodes already ran.
    #[serde(default)]
    pub connected_after_ms: Option<f64>,
    /// Allocations of the cyclic threads once the connection was up; null if they are not counted.
    #[serde(default)]
    pub cyclic_allocations: Option<Allocations>,
    /// Repetitions that were run again because the host stalled a node until the connection was lost. The samples do
    /// not contain the lost attempts.
    #[serde(default)]
    pub repeated: u32,
    /// Injected faults and their result; absent without faults.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub faults: Option<FaultReport>,
    /// First 64 bits of the SHA-256 of each value above, of `setup.toml` and of `application.toml`: they show accidental changes.
    /// Absent in a run of an older version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digests: Option<Digests>,
}

/// Progress of a run, or how it ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// Repetitions are still to come, or the program was killed before it could update the status.
    Running,
    /// All repetitions are done.
    Complete,
    /// A repetition failed and ended the run.
    Failed,
    /// Ctrl-C or SIGTERM ended the run.
    Interrupted,
}

/// One value per execution type.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
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
    /// Returns how many repetitions `saved` counts over all types, and how many were wanted with `reps` of each.
    pub fn saved_of_all(&self, reps: u32, saved: impl Fn(&T) -> usize) -> (usize, usize) {
        let of_types: Vec<&T> = ExecutionType::ALL.iter().filter_map(|one| self.get(*one)).collect();
        (of_types.iter().map(|result| saved(result)).sum(), of_types.len() * reps as usize)
    }

    /// Returns the value of a type.
    pub const fn get(&self, execution_type: ExecutionType) -> Option<&T> {
        match execution_type {
            ExecutionType::Rc => self.rc.as_ref(),
            ExecutionType::Sm => self.sm.as_ref(),
            ExecutionType::Cm => self.cm.as_ref(),
        }
    }

    /// Returns the entry of a type, to set it.
    pub const fn entry(&mut self, execution_type: ExecutionType) -> &mut Option<T> {
        match execution_type {
            ExecutionType::Rc => &mut self.rc,
            ExecutionType::Sm => &mut self.sm,
            ExecutionType::Cm => &mut self.cm,
        }
    }
}

/// Results of one type. The lists have one entry per successful repetition.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct TypeResult {
    /// Mean of the samples in ms; null without samples.
    pub aet_ms: Option<f64>,
    /// Mean absolute deviation from the mean in ms; null without samples.
    pub mad_ms: Option<f64>,
    /// Execution times in ms, measured by the PLC.
    pub samples_ms: Vec<f64>,
    /// Execution times in ms, measured by the robot.
    pub robot_samples_ms: Vec<f64>,
    /// Motions that ended in a stop because the next motion did not arrive in time.
    pub blends_suppressed: Vec<u32>,
    /// Cycles that the host let pass without a run of a node; empty in a run of an older version.
    #[serde(default)]
    pub missed_cycles: Vec<MissedCycles>,
    /// Repetitions that failed.
    pub failed: Vec<FailedRepetition>,
    /// Quality of the arm's motion; null if no repetition reported it.
    #[serde(default)]
    pub quality: Option<MotionQuality>,
}

/// A repetition that failed.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FailedRepetition {
    /// Its number among the repetitions of its type, counted from 1.
    pub repetition: u32,
    /// The error.
    pub error: String,
}

/// Results of a virtual run in which a skill call costs no time besides its motion: the model's prediction.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct WithoutOverhead {
    /// AET and MAD.
    pub results: PerType<AetMad>,
    /// AETi, 0…1; null if SM or CM is missing.
    pub aet_improvement: Option<f64>,
}

/// Lateness of the cycles. In virtual mode nothing is late.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Cycles {
    /// The PLC's scans.
    pub plc: CycleLateness,
    /// The robot's interpolation cycles.
    pub robot: CycleLateness,
}

/// Allocations of the cyclic threads once the connection was up.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Allocations {
    /// Those of the PLC.
    pub plc: u64,
    /// Those of the robot.
    pub robot: u64,
}

impl Results {
    /// Creates the results of a run that is about to start, without the paper's figures.
    #[must_use]
    pub fn new(setup: &Setup, application: &str, mode: Mode, schedule: &Schedule) -> Self {
        let mut results = PerType::default();
        for execution_type in &schedule.types {
            *results.entry(*execution_type) = Some(TypeResult::default());
        }
        Self {
            title: setup.title.clone(),
            seed: schedule.seed,
            reps: schedule.reps,
            overrides: schedule.overrides.filter(|given| !given.is_full()).map(|given| given.to_string()),
            positions: Some(Positions::of(setup.robot.drives)),
            results,
            ..Self::empty([&setup.name, application, mode.name()])
        }
    }

    /// Returns the results of no run, with these names of setup, application and mode.
    pub(crate) fn empty([setup, application, mode]: [&str; 3]) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            setup: setup.to_owned(),
            title: String::new(),
            application: application.to_owned(),
            mode: mode.to_owned(),
            seed: 0,
            reps: 0,
            overrides: None,
            positions: None,
            attached: None,
            origin: None,
            status: Status::Running,
            results: PerType::default(),
            aet_improvement: None,
            without_skill_overhead: None,
            paper: None,
            no_paper: None,
            arms: None,
            calibrated: Vec::new(),
            cycle: Cycles::default(),
            bus: Frames::default(),
            images: Images::default(),
            connection_remarks: Vec::new(),
            not_verified: Vec::new(),
            incomplete: Vec::new(),
            connected_after_ms: None,
            cyclic_allocations: None,
            repeated: 0,
            faults: None,
            digests: None,
        }
    }

    /// Adds a finished run.
    ///
    /// # Errors
    ///
    /// A joint exceeded its rating. Then the quality of the motion is added, but not the time: no real arm reaches it.
    pub fn record(
        &mut self,
        execution_type: ExecutionType,
        measured: &Measured,
    ) -> Result<(), RatingExceeded> {
        let result = self.results.entry(execution_type).get_or_insert_default();
        if let Some(quality) = &measured.quality {
            result.quality.get_or_insert_default().record(quality);
            quality.check_ratings()?;
        }
        let millis = |nanos: u64| nanos as f64 / 1e6;
        result.samples_ms.push(millis(measured.execution.execution_time_ns));
        result.robot_samples_ms.push(millis(measured.execution.robot_execution_ns));
        result.blends_suppressed.push(measured.execution.blends_suppressed);
        result.missed_cycles.push(MissedCycles::of(&measured.interference));
        self.derive_figures();
        Ok(())
    }

    /// Computes AET, MAD and AETi from the samples.
    pub fn derive_figures(&mut self) {
        for execution_type in ExecutionType::ALL {
            let Some(result) = self.results.entry(execution_type) else { continue };
            let figure = aet_mad(&result.samples_ms);
            (result.aet_ms, result.mad_ms) = figure.map(|it| (it.aet_ms, it.mad_ms)).unzip();
        }
        let aet = |execution_type| self.results.get(execution_type).and_then(|result| result.aet_ms);
        self.aet_improvement =
            aet(ExecutionType::Sm).zip(aet(ExecutionType::Cm)).map(|(sm, cm)| aet_improvement(sm, cm));
    }

    /// Adds what was not verified of a repetition.
    pub fn add_unverified(&mut self, unverified: Vec<String>) {
        for what in unverified {
            if !self.not_verified.contains(&what) {
                self.not_verified.push(what);
            }
        }
    }

    /// Adds a failed repetition.
    pub fn record_failure(&mut self, execution_type: ExecutionType, repetition: u32, error: String) {
        self.results
            .entry(execution_type)
            .get_or_insert_default()
            .failed
            .push(FailedRepetition { repetition, error });
    }

    /// Sets the conditions of the run so far.
    pub fn set_health(&mut self, health: &Health) {
        self.cycle = Cycles { plc: health.plc.clone(), robot: health.robot.clone() };
        self.bus = Frames::of(health);
        self.images = Images::of(health);
        self.connected_after_ms = health.connected_after.map(|after| after.as_secs_f64() * 1e3);
        self.cyclic_allocations = health.allocations.map(|[plc, robot]| Allocations { plc, robot });
        self.repeated = u32::try_from(health.repeated.len()).unwrap_or(u32::MAX);
        self.connection_remarks.clone_from(&health.remarks);
        self.faults.clone_from(&health.faults);
    }

    /// Returns the part of these results that another run contains as its run without the calibrated overhead.
    #[must_use]
    pub fn as_without_overhead(&self) -> WithoutOverhead {
        let mut results = PerType::default();
        for execution_type in ExecutionType::ALL {
            *results.entry(execution_type) = self.figure(execution_type);
        }
        WithoutOverhead { results, aet_improvement: self.aet_improvement }
    }

    /// Returns how many repetitions have a result, and how many were asked for.
    #[must_use]
    pub fn saved_of_all(&self) -> (usize, usize) {
        self.results.saved_of_all(self.reps, |result| result.samples_ms.len())
    }

    /// Returns seed, override and source of the positions, as far as there are any: the end of the line that describes the run.
    #[must_use]
    pub fn conditions(&self, separator: &str) -> String {
        // What was measured elsewhere has no seed.
        let seed = match &self.origin {
            Some(origin) => format!("file {}", origin.file),
            None => format!("seed {}", self.seed),
        };
        let overrides = self.overrides.iter().map(|overrides| format!("override {overrides}"));
        let positions = self.positions.map(|positions| format!("positions = {positions}"));
        overrides.chain(positions).fold(seed, |text, more| format!("{text}{separator}{more}"))
    }

    /// Returns whether an older version wrote them, without digests.
    #[must_use]
    pub const fn is_of_older_version(&self) -> bool {
        self.digests.is_none()
    }

    /// Returns the results as JSON, with a newline at the end, and with the digests of their values if they have those of
    /// the files beside them.
    pub fn to_json(&self) -> serde_json::Result<String> {
        let sealed = match &self.digests {
            None => None,
            Some(digests) => {
                // What a reader will find.
                let written = serde_json::from_str(&serde_json::to_string(self)?)?;
                Some(Self { digests: Some(digests.with_values(&written)), ..self.clone() })
            }
        };
        serde_json::to_string_pretty(sealed.as_ref().unwrap_or(self)).map(|json| json + "\n")
    }
}

/// Computes AET and MAD of samples. Samples are whole nanoseconds, and a number in milliseconds represents them exactly up to hours.
pub(super) fn aet_mad(samples_ms: &[f64]) -> Option<AetMad> {
    let nanos = |millis: &f64| std::time::Duration::from_nanos((millis * 1e6).round() as u64);
    AetMad::of(samples_ms.iter().map(nanos))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    fn the_committed_schema_matches_the_results() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/results.schema.json");
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
