//! A run of the list.

use std::cmp::Ordering;
use std::path::Path;

use plc_node::ExecutionType;
use serde::Serialize;

use records::counted::counted;
use records::interval::Mean;
use records::results::{PerType, Results, Status};
use records::run_directory;
use records::statistics::AetMad;

/// A run of the list.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Entry {
    /// Its directory's name.
    pub run: String,
    /// Its start, UTC, ISO 8601; null if `host.json` is missing.
    pub date: Option<String>,
    /// The commit that the program was built from; null if `host.json` is missing.
    pub commit: Option<String>,
    /// The bench's computer: processor, cores and kernel; null if `host.json` is missing.
    pub host: Option<String>,
    /// The setup's name.
    pub setup: String,
    /// The application's name.
    pub application: String,
    /// `real`, `virtual`, `captured` or `imported`.
    pub mode: String,
    /// Whether the nodes ran already.
    pub is_attached: bool,
    /// The nodes that ran already, with their hosts and versions; null if the bench started its own.
    pub attached: Option<String>,
    /// Source of the samples, with PLC and robot; absent where the bench ran the measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub origin: Option<String>,
    /// How it ended.
    pub status: Status,
    /// Its traces or captures lack something.
    pub is_incomplete: bool,
    /// It was written by an older version, without digests: only its figures were checked against its samples.
    pub is_of_older_version: bool,
    /// AET and MAD so far.
    pub figures: PerType<AetMad>,
    /// 95 % interval of the AET, in ms; absent with too few repetitions.
    pub interval_ms: PerType<(f64, f64)>,
    /// Successful repetitions so far. The MAD of one is 0 and says nothing.
    pub repetitions: PerType<usize>,
    /// AETi, 0…1; null if SM or CM is missing.
    pub aet_improvement: Option<f64>,
    /// The run that each AET is compared with: the last one before it with the same setup, application, mode, nodes,
    /// override and faults that has this AET, and its interval if this one has; absent if there is none.
    pub compared_with: PerType<String>,
    /// Why it is not compared with the last run of the same setup, application and mode, each difference, separated by `; `;
    /// null if it is.
    pub differs: Option<String>,
    /// AET minus that of the run that it is compared with, in ms.
    pub trend_ms: PerType<f64>,
    /// 95 % interval of that difference, in ms; absent with too few repetitions.
    pub trend_interval_ms: PerType<(f64, f64)>,
    #[serde(skip)]
    means: PerType<Mean>,
}

impl Entry {
    /// Creates the entry of a run, which is not yet compared with others.
    pub(super) fn new(path: &Path, results: Results) -> Self {
        let host = run_directory::host(path);
        let text = |key: &str| Some(host.as_ref()?.get(key)?.as_str()?.to_owned());
        let cores = host.as_ref().and_then(|host| host.get("cores")?.as_u64());
        let cores = cores.map(|count| counted(count, "core"));
        let kernel = text("kernel").map(|kernel| format!("Linux {kernel}"));
        let computer: Vec<_> = text("cpu").into_iter().chain(cores).chain(kernel).collect();
        let mut entry = Self {
            run: path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            date: text("date"),
            commit: text("commit"),
            host: (!computer.is_empty()).then(|| computer.join(", ")),
            is_attached: results.attached.is_some(),
            attached: results.attached.as_ref().map(ToString::to_string),
            origin: results.origin.as_ref().map(ToString::to_string),
            status: results.status,
            is_incomplete: !results.incomplete.is_empty(),
            is_of_older_version: results.is_of_older_version(),
            aet_improvement: results.aet_improvement,
            figures: PerType::default(),
            interval_ms: PerType::default(),
            repetitions: PerType::default(),
            compared_with: PerType::default(),
            differs: None,
            trend_ms: PerType::default(),
            trend_interval_ms: PerType::default(),
            means: PerType::default(),
            setup: String::new(),
            application: String::new(),
            mode: String::new(),
        };
        for execution_type in ExecutionType::ALL {
            *entry.figures.entry(execution_type) = results.figure(execution_type);
            let samples = results.results.get(execution_type).map(|result| &result.samples_ms[..]);
            *entry.repetitions.entry(execution_type) = samples.map(<[f64]>::len);
            let mean = samples.and_then(Mean::of);
            *entry.interval_ms.entry(execution_type) = mean.map(|mean| mean.interval_ms());
            *entry.means.entry(execution_type) = mean;
        }
        let Results { setup, application, mode, .. } = results;
        Self { setup, application, mode, ..entry }
    }

    /// Compares it with earlier runs under the same conditions, newest first.
    pub(super) fn compare<'a>(&mut self, earlier: impl Iterator<Item = &'a Self> + Clone) {
        for execution_type in ExecutionType::ALL {
            let Some(now) = self.figures.get(execution_type) else { continue };
            let mean = self.means.get(execution_type);
            let has_mean = |run: &&Self| mean.is_some() && run.means.get(execution_type).is_some();
            let has_figure = |run: &&Self| run.figures.get(execution_type).is_some();
            // A short run between two long ones must not hide a change.
            let Some(before) = earlier.clone().find(has_mean).or_else(|| earlier.clone().find(has_figure))
            else {
                continue;
            };
            let trend_ms = before.figures.get(execution_type).map(|then| now.aet_ms - then.aet_ms);
            let means = mean.zip(before.means.get(execution_type));
            *self.trend_interval_ms.entry(execution_type) =
                means.map(|(now, then)| now.less(*then).interval_ms());
            *self.trend_ms.entry(execution_type) = trend_ms;
            *self.compared_with.entry(execution_type) = Some(before.run.clone());
        }
    }

    /// Returns by how much an AET changed, in ms, and the 95 % interval of that; `None` if the interval leaves open whether
    /// it did, or if no change would be seen in the figures.
    pub(super) fn change(&self, execution_type: ExecutionType) -> Option<(f64, (f64, f64))> {
        let (ms, (low, high)) =
            (*self.trend_ms.get(execution_type)?, *self.trend_interval_ms.get(execution_type)?);
        let is_open = low <= 0.0 && high >= 0.0;
        (!is_open && ms.abs() >= 0.05).then_some((ms, (low, high)))
    }

    /// Returns whether a figure is compared with that of an earlier run.
    pub(super) fn is_compared(&self) -> bool {
        ExecutionType::ALL.into_iter().any(|one| self.trend_ms.get(one).is_some())
    }

    /// Formats how the run ended, whether its traces and captures lack something, and whether an older version wrote it.
    pub(super) fn ended(&self) -> String {
        let ended = match self.status {
            Status::Complete => "complete",
            Status::Running => "not finished",
            Status::Failed => "failed",
            Status::Interrupted => "interrupted",
        };
        let marks = [(self.is_incomplete, "records incomplete"), (self.is_of_older_version, "older version")];
        let marks = marks.into_iter().filter_map(|(is_so, mark)| is_so.then_some(mark));
        std::iter::once(ended).chain(marks).collect::<Vec<_>>().join(", ")
    }

    /// Returns whether all repetitions were done, and all records are there.
    pub(super) const fn is_complete(&self) -> bool {
        matches!(self.status, Status::Complete) && !self.is_incomplete
    }

    /// Returns whether it is complete, on nodes that the bench started.
    pub(super) const fn is_whole(&self) -> bool {
        self.is_complete() && !self.is_attached && self.origin.is_none()
    }

    pub(super) fn by_age(&self, other: &Self) -> Ordering {
        (&self.date, &self.run).cmp(&(&other.date, &other.run))
    }

    /// Returns whether setup, application and mode have the same names.
    pub(super) fn has_kind_of(&self, other: &Self) -> bool {
        (&self.setup, &self.application, &self.mode) == (&other.setup, &other.application, &other.mode)
    }
}
