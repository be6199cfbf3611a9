//! The results of a cell with several stations as JSON: version 2 of `results.json`, which only such runs have.

use std::time::Duration;

use planning::PlannedCell;
use plc_node::ExecutionType;
use serde::{Deserialize, Serialize};
use setup::Cell;

pub use crate::attached::CellAttached;
use crate::cell_marks::waits;
pub use crate::cell_marks::{CellMark, CellWait};
use crate::cell_sample::{CellSample, mark_skews};
use crate::cell_stop::CellStop;
use crate::conditions::Health;
use crate::digest::Digests;
use crate::faults::FaultReport;
use crate::lateness::CycleLateness;
use crate::mode::Mode;
use crate::results::{FailedRepetition, Frames, PerType, Results, Status, TypeResult, aet_mad};
use crate::schedule::Schedule;
use crate::statistics::{AetMad, aet_improvement};

/// Version of the format.
pub const CELL_SCHEMA_VERSION: u32 = 2;

/// All results of a cell.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CellResults {
    /// Version of this format.
    pub schema_version: u32,
    /// The setup's name.
    pub setup: String,
    /// The setup's title.
    pub title: String,
    /// The application of all stations, or those of each; empty in a run of an older version.
    #[serde(default)]
    pub application: String,
    /// `real` or `virtual`.
    pub mode: String,
    /// Seed of pauses, and in virtual mode of clocks and phases.
    pub seed: u64,
    /// Requested repetitions of each type.
    pub reps: u32,
    /// What became of the override in each repetition, as `--override` says it; absent where it stayed at 100 %.
    #[serde(default, rename = "override", skip_serializing_if = "Option::is_none")]
    pub overrides: Option<String>,
    /// Progress of the run, or how it ended.
    pub status: Status,
    /// The stations, in the order of the setup.
    pub stations: Vec<CellStation>,
    /// The marks at which arms wait for each other; none in a run of an older version.
    #[serde(default)]
    pub marks: Vec<CellMark>,
    /// Results of each type; types that were not requested are absent.
    pub results: PerType<CellTypeResult>,
    /// Lateness of the PLC's scans. In virtual mode nothing is late.
    pub plc_cycle: CycleLateness,
    /// The nodes that ran already; absent where the bench started them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attached: Option<CellAttached>,
    /// Time from the start of the nodes until all robots were ready, in ms; absent in virtual mode and for nodes that ran already.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub connected_after_ms: Option<f64>,
    /// Allocations of the cyclic threads since the connections were up; absent if they are not counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cyclic_allocations: Option<CellAllocations>,
    /// Effect of the injected faults; absent without faults.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub faults: Option<FaultReport>,
    /// Repetitions that were run again because the host stalled a node until a connection was lost: which, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub repeated: Vec<String>,
    /// Remarks on the connections.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
    /// AETi of the cell, (SM − CM) / SM, 0…1; null if either is missing.
    #[serde(default)]
    pub aet_improvement: Option<f64>,
    /// First 64 bits of the SHA-256 of each value above, of `setup.toml` and of `application.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digests: Option<Digests>,
}

/// Allocations of the cyclic threads of a cell.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CellAllocations {
    /// Allocations of the PLC.
    pub plc: u64,
    /// Allocations of the robots, in the order of the stations.
    pub robots: Vec<u64>,
}

/// A station of the cell.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CellStation {
    /// Its name.
    pub name: String,
    /// Its arm in the application, or its own application.
    pub application: String,
    /// Its bus.
    pub bus: String,
    /// The model of its robot.
    pub robot: String,
    /// Lateness of its robot's cycles.
    pub cycle: CycleLateness,
    /// Cyclic frames by the PLC's count.
    pub frames: Frames,
    /// Number of the tool that the poses are of; 0 is the flange.
    #[serde(default)]
    pub tool: u8,
    /// Where the arm waits for others, in order; empty in a run of an older version.
    #[serde(default)]
    pub waits: Vec<CellWait>,
    /// The arm alone, without waits, in virtual time with the same seed; null if it was not run.
    #[serde(default)]
    pub alone: Option<Alone>,
}

/// Times of an arm alone.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Alone {
    /// AET and MAD of each type.
    pub results: PerType<AetMad>,
    /// AETi, 0…1; null if SM or CM is missing.
    pub aet_improvement: Option<f64>,
}

/// Results of one type. The lists have one entry for each repetition that succeeded.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CellTypeResult {
    /// Mean of the samples in ms; null without samples.
    pub aet_ms: Option<f64>,
    /// Mean absolute deviation from the mean in ms; null without samples.
    pub mad_ms: Option<f64>,
    /// Execution times of the whole cell in ms, measured by the PLC.
    pub samples_ms: Vec<f64>,
    /// True time between the first motions of the arms, in µs; null where an arm did not move.
    pub start_skew_us: Vec<Option<f64>>,
    /// Largest distance of an arm's tool, seen from another arm's, from where the plan has it at the same progress, in mm: at the marks,
    /// and where arms move together. Null where it could not be measured; empty in a run of an older version.
    #[serde(default)]
    pub relative_pose_mm: Vec<Option<f64>>,
    /// Each station, in the order of the setup.
    pub stations: Vec<StationResult>,
    /// The marks, in the order in which they were passed.
    pub marks: Vec<MarkResult>,
    /// Repetitions that failed.
    pub failed: Vec<FailedRepetition>,
    /// The arms in these repetitions; absent where none was recorded.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stops: Vec<CellStop>,
}

/// Results of a station in one type.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StationResult {
    /// Execution times in ms, measured by the robot.
    pub robot_samples_ms: Vec<f64>,
    /// Motions that ended in a stop because the next motion did not arrive in time.
    pub blends_suppressed: Vec<u32>,
    /// Time for which the arm stood at marks until the others came, in ms.
    pub waiting_ms: Vec<f64>,
    /// Time for which the arm stood before shared zones until they were granted, in ms; absent in a cell without such zones, and in
    /// real mode.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub zone_waiting_ms: Vec<f64>,
}

/// How far apart the arms came to a mark.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MarkResult {
    /// Number of the mark.
    pub mark: u32,
    /// True time between the scans in which the PLC saw the first and the last arm there, in µs.
    pub skew_us: Vec<f64>,
}

impl CellTypeResult {
    /// Returns the mean of the true times between the first motions of the arms, in µs.
    #[must_use]
    pub fn mean_start_skew_us(&self) -> Option<f64> {
        mean(&self.start_skew_us.iter().flatten().copied().collect::<Vec<_>>())
    }

    /// Returns the longest time between the arrivals at a mark, in µs.
    #[must_use]
    pub fn worst_mark_skew_us(&self) -> Option<f64> {
        self.mark_skews_us().into_iter().reduce(f64::max)
    }

    /// Returns the longest time between the arrivals at a mark in each repetition, in µs.
    #[must_use]
    pub fn mark_skews_us(&self) -> Vec<f64> {
        let repetitions = self.marks.iter().map(|mark| mark.skew_us.len()).max().unwrap_or_default();
        let of = |repetition| self.marks.iter().filter_map(move |mark| mark.skew_us.get(repetition).copied());
        (0..repetitions).filter_map(|repetition| of(repetition).reduce(f64::max)).collect()
    }

    /// Returns the largest difference of the arms' relative pose from the plan, in mm.
    #[must_use]
    pub fn worst_relative_pose_mm(&self) -> Option<f64> {
        self.relative_pose_mm.iter().flatten().copied().reduce(f64::max)
    }
}

impl StationResult {
    /// Returns the mean time for which the arm stood at marks, in ms.
    #[must_use]
    pub fn mean_waiting_ms(&self) -> Option<f64> {
        mean(&self.waiting_ms)
    }

    /// Returns the mean time for which the arm stood before shared zones, in ms; `None` in a cell without such zones.
    #[must_use]
    pub fn mean_zone_waiting_ms(&self) -> Option<f64> {
        mean(&self.zone_waiting_ms)
    }
}

/// Returns the mean of values; `None` without any.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

impl CellResults {
    /// Creates the results of a run that is about to start.
    #[must_use]
    pub fn new(cell: &Cell, planned: &PlannedCell, mode: Mode, schedule: &Schedule) -> Self {
        let mut results = PerType::default();
        let of_type = CellTypeResult {
            stations: vec![StationResult::default(); cell.stations.len()],
            ..CellTypeResult::default()
        };
        for execution_type in &schedule.types {
            *results.entry(*execution_type) = Some(of_type.clone());
        }
        let station = |station: &setup::Station| CellStation {
            name: station.name.clone(),
            application: station.application.clone(),
            bus: station.bus.kind.name().to_owned(),
            robot: station.robot.model.clone(),
            cycle: CycleLateness::default(),
            frames: Frames::default(),
            tool: planned
                .station(&station.name)
                .and_then(|it| it.plan.motions.first())
                .map_or(0, |first| first.tool),
            waits: planned.station(&station.name).map_or_else(Vec::new, waits),
            alone: None,
        };
        let mark = |mark: &planning::Mark| CellMark {
            number: mark.number,
            name: mark.name.clone(),
            together: mark.together,
        };
        Self {
            schema_version: CELL_SCHEMA_VERSION,
            setup: cell.name.clone(),
            title: cell.title.clone(),
            application: planned.application_name(cell),
            mode: mode.name().to_owned(),
            seed: schedule.seed,
            reps: schedule.reps,
            overrides: schedule.overrides.filter(|given| !given.is_full()).map(|given| given.to_string()),
            status: Status::Running,
            stations: cell.stations.iter().map(station).collect(),
            marks: planned.marks.iter().map(mark).collect(),
            results,
            plc_cycle: CycleLateness::default(),
            attached: None,
            connected_after_ms: None,
            cyclic_allocations: None,
            faults: None,
            repeated: Vec::new(),
            remarks: Vec::new(),
            aet_improvement: None,
            digests: None,
        }
    }

    /// Adds a finished repetition.
    pub fn record(&mut self, execution_type: ExecutionType, sample: &CellSample) {
        let millis = |time: Duration| time.as_nanos() as f64 / 1e6;
        let micros = |time: Duration| time.as_nanos() as f64 / 1e3;
        let result = self.results.entry(execution_type).get_or_insert_default();
        result.samples_ms.push(millis(sample.execution));
        result.start_skew_us.push(sample.start_skew.map(micros));
        result.relative_pose_mm.push(sample.relative_pose_mm);
        for (of_station, one) in result.stations.iter_mut().zip(&sample.stations) {
            of_station.robot_samples_ms.push(millis(one.robot_execution));
            of_station.blends_suppressed.push(one.blends_suppressed);
            of_station.waiting_ms.push(millis(one.waited));
            of_station.zone_waiting_ms.extend(one.waited_for_zones.map(millis));
        }
        for (mark, skew) in mark_skews(&sample.stations) {
            match result.marks.iter_mut().find(|known| known.mark == mark) {
                Some(known) => known.skew_us.push(micros(skew)),
                None => result.marks.push(MarkResult { mark, skew_us: vec![micros(skew)] }),
            }
        }
        (result.aet_ms, result.mad_ms) = aet_mad(&result.samples_ms).map(|it| (it.aet_ms, it.mad_ms)).unzip();
        let aet_ms = |of: &Option<CellTypeResult>| of.as_ref().and_then(|result| result.aet_ms);
        let (sm, cm) = (aet_ms(&self.results.sm), aet_ms(&self.results.cm));
        self.aet_improvement = sm.zip(cm).map(|(sm, cm)| aet_improvement(sm, cm));
    }

    /// Returns how many repetitions are saved, and how many were wanted.
    #[must_use]
    pub fn saved_of_all(&self) -> (usize, usize) {
        self.results.saved_of_all(self.reps, |result| result.samples_ms.len() + result.failed.len())
    }

    /// Returns the share that the cell keeps of the mean AETi of its arms alone; `None` if these were not run, or gain nothing.
    #[must_use]
    pub fn remaining_gain(&self) -> Option<f64> {
        let alone = self.stations.iter().map(|station| station.alone.as_ref()?.aet_improvement);
        let alone = mean(&alone.collect::<Option<Vec<_>>>()?)?;
        self.aet_improvement.filter(|_| alone > 0.0).map(|gain| gain / alone)
    }

    /// Sets what a station's arm takes alone.
    pub fn set_alone(&mut self, station: usize, results: &Results) {
        let mut alone = Alone { aet_improvement: results.aet_improvement, ..Alone::default() };
        for execution_type in ExecutionType::ALL {
            *alone.results.entry(execution_type) = results.figure(execution_type);
        }
        if let Some(station) = self.stations.get_mut(station) {
            station.alone = Some(alone);
        }
    }

    /// Returns seed and override, if there is one: the end of the line that describes the run.
    #[must_use]
    pub fn conditions(&self, separator: &str) -> String {
        let overrides = self.overrides.iter().map(|overrides| format!("{separator}override {overrides}"));
        format!("seed {}{}", self.seed, overrides.collect::<String>())
    }

    /// Returns what such a run has in common with one of a single station, with the robot's times of a station.
    #[must_use]
    pub fn of_station(&self, station: usize) -> Results {
        let of_type = |result: &CellTypeResult| {
            let own = result.stations.get(station).cloned().unwrap_or_default();
            TypeResult {
                aet_ms: result.aet_ms,
                mad_ms: result.mad_ms,
                samples_ms: result.samples_ms.clone(),
                robot_samples_ms: own.robot_samples_ms,
                blends_suppressed: own.blends_suppressed,
                failed: result.failed.clone(),
                ..TypeResult::default()
            }
        };
        let mut results = Results {
            title: self.title.clone(),
            seed: self.seed,
            reps: self.reps,
            overrides: self.overrides.clone(),
            faults: self.faults.clone(),
            status: self.status,
            aet_improvement: self.aet_improvement,
            digests: self.digests.clone(),
            ..Results::empty([&self.setup, &self.application, &self.mode])
        };
        for execution_type in ExecutionType::ALL {
            *results.results.entry(execution_type) = self.results.get(execution_type).map(of_type);
        }
        results
    }

    /// Sets the conditions of the run so far, at each station.
    pub fn set_health(&mut self, health: &[Health]) {
        for (station, of_station) in self.stations.iter_mut().zip(health) {
            station.cycle = of_station.robot.clone();
            station.frames = Frames::of(of_station);
            // All stations have one PLC.
            self.plc_cycle = of_station.plc.clone();
        }
        let all = health.iter().map(|of_station| of_station.allocations).collect::<Option<Vec<_>>>();
        self.cyclic_allocations = all.filter(|all| !all.is_empty()).map(|all| CellAllocations {
            plc: all.first().map_or(0, |[plc, _]| *plc),
            robots: all.iter().map(|[_, robot]| *robot).collect(),
        });
    }

    /// Adds a failed repetition.
    pub fn record_failure(&mut self, execution_type: ExecutionType, repetition: u32, error: String) {
        let result = self.results.entry(execution_type).get_or_insert_default();
        result.failed.push(FailedRepetition { repetition, error });
    }

    /// Adds the arms in a repetition that failed.
    pub fn record_stop(&mut self, execution_type: ExecutionType, stop: CellStop) {
        self.results.entry(execution_type).get_or_insert_default().stops.push(stop);
    }

    /// Returns the results as JSON, with a newline at the end, and with the digests of their values if they have those of the
    /// files beside them.
    pub fn to_json(&self) -> serde_json::Result<String> {
        let mut sealed = self.clone();
        if let Some(digests) = &self.digests {
            let written = serde_json::from_str(&serde_json::to_string(self)?)?;
            sealed.digests = Some(digests.with_values(&written));
        }
        serde_json::to_string_pretty(&sealed).map(|json| json + "\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    fn the_committed_schema_matches_the_results_of_a_cell() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/cell-results.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(CellResults)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            std::fs::read_to_string(path).unwrap() == schema,
            "the results of cells changed: INSTA_UPDATE=always cargo test -p records --lib cell_results"
        );
    }
}
