//! Time and disk that a study needs, before it runs.

use super::plan::JobAddress;
use super::rows::Columns;

/// Processor time of a repetition in seconds: the median of CM on Setup A in a release build on the machine that runs the
/// project's tests. A longer application takes longer.
const REPETITION_S: f64 = 0.0055;

/// Bytes of a usual row besides its address: a time of ten digits by each clock, and seeds of up to five.
const ROW_BYTES: u128 = 46;

/// Bytes of a further figure, and of a varied key of a job.
const FIELD_BYTES: u128 = 10;

/// Most jobs that one process executes: it notes the address of each that is done, 8 bytes, when it goes on.
const MOST_JOBS: u128 = 1_000_000_000;

/// Time and disk of a study or of a shard.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct StudyEstimate {
    /// Jobs; `None` beyond all counting.
    pub jobs: Option<u128>,
    repetitions: f64,
    seconds: f64,
    bytes: f64,
}

impl StudyEstimate {
    /// Estimates jobs on this many threads.
    #[must_use]
    pub(super) fn of(jobs: Option<u128>, columns: &Columns, threads: usize) -> Self {
        let count = jobs.map_or(f64::INFINITY, |jobs| jobs as f64);
        let more = columns.figures.len().saturating_sub(3) as u128;
        let row = JobAddress::DIGITS as u128 + ROW_BYTES + FIELD_BYTES * more;
        let job = JobAddress::DIGITS as u128 + 2 + FIELD_BYTES * columns.keys.len() as u128;
        let rows = columns.rows_per_job as f64;
        Self {
            jobs,
            repetitions: count * rows,
            seconds: count * rows * REPETITION_S / threads.max(1) as f64,
            bytes: count * (rows * row as f64 + job as f64),
        }
    }

    /// Returns why the study cannot run where this much disk is free; `None` if it can.
    #[must_use]
    pub(super) fn refusal(&self, free: Option<u64>) -> Option<String> {
        let remedy = "vary fewer values or seeds, or run more shards on more machines";
        if self.jobs.is_none_or(|jobs| jobs > MOST_JOBS) {
            return Some(format!("more than {} jobs for one process; {remedy}", grouped(MOST_JOBS as f64)));
        }
        let free = free? as f64;
        (self.bytes > free)
            .then(|| format!("needs {} of disk, and {} are free; {remedy}", size(self.bytes), size(free)))
    }
}

impl std::fmt::Display for StudyEstimate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Some(jobs) = self.jobs else { return f.write_str("more than 10^38 jobs") };
        let jobs = grouped(jobs as f64);
        write!(
            f,
            "{jobs} jobs, {} repetitions: about {} and {} of disk",
            grouped(self.repetitions),
            time(self.seconds),
            size(self.bytes)
        )
    }
}

fn grouped(number: f64) -> String {
    if !number.is_finite() || number >= 1e18 {
        return format!("{number:.1e}");
    }
    let digits = format!("{number:.0}");
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index) % 3 == 0 {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

fn time(seconds: f64) -> String {
    let units = [(365.25 * 86_400.0, "years"), (86_400.0, "days"), (3_600.0, "hours"), (60.0, "minutes")];
    let unit = units.into_iter().find(|(unit, _)| seconds >= 2.0 * unit);
    let (unit, name) = unit.unwrap_or((1.0, "s"));
    format!("{} {name}", grouped(libm::ceil(seconds / unit)))
}

fn size(bytes: f64) -> String {
    let units = [(1e15, "PB"), (1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB")];
    let unit = units.into_iter().find(|(unit, _)| bytes >= *unit);
    let (unit, name) = unit.unwrap_or((1.0, "bytes"));
    format!("{} {name}", grouped(libm::ceil(bytes / unit)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::file::RowFigure;

    #[test]
    fn a_grid_that_no_disk_holds_is_refused_with_its_numbers() {
        let columns = Columns {
            figures: RowFigure::USUAL.to_vec(),
            keys: vec!["plc.scan_cost_us".into()],
            rows_per_job: 3,
        };
        let of = |jobs| StudyEstimate::of(jobs, &columns, 2);
        let small = of(Some(1_000));
        insta::assert_snapshot!(small.to_string(), @"1,000 jobs, 3,000 repetitions: about 9 s and 214 kB of disk");
        assert_eq!(small.refusal(Some(1 << 30)), None);
        insta::assert_snapshot!(small.refusal(Some(1_000)).unwrap(), @"needs 214 kB of disk, and 1 kB are free; vary fewer values or seeds, or run more shards on more machines");
        let huge = of(Some(1_000_000_000_000));
        insta::assert_snapshot!(format!("{huge}: {}", huge.refusal(None).unwrap()), @"1,000,000,000,000 jobs, 3,000,000,000,000 repetitions: about 262 years and 214 TB of disk: more than 1,000,000,000 jobs for one process; vary fewer values or seeds, or run more shards on more machines");
        insta::assert_snapshot!(of(None).to_string(), @"more than 10^38 jobs");
    }
}
