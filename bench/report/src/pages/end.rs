//! How the recorded repetition of a type ends, and how the report says so.

use plc_node::ExecutionType;
use serde::Serialize;

use records::results::{Results, Status};
use records::trace::Recording;

/// How the repetition of a recording ends: the first one of its type.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum End {
    /// Its last motion is done.
    Done,
    /// The recording ends before it.
    CutOff,
    /// It failed.
    Failed,
    /// A signal ended the run within it.
    Interrupted,
    /// The program was ended from outside within it, or it still runs.
    Unfinished,
}

impl End {
    /// Returns how the recording of a type ends, by the results of its run.
    pub(super) fn of(results: &Results, execution_type: ExecutionType, recording: &Recording) -> Self {
        let result = results.results.get(execution_type);
        let has_failed =
            result.is_some_and(|result| result.failed.iter().any(|failed| failed.repetition == 1));
        let is_done = result.is_some_and(|result| !result.samples_ms.is_empty());
        if recording.is_cut_off() {
            Self::CutOff
        } else if has_failed {
            Self::Failed
        } else if is_done {
            Self::Done
        } else if results.status == Status::Interrupted {
            Self::Interrupted
        } else {
            Self::Unfinished
        }
    }

    /// Returns a sentence's predicate for an end at this time, such as `takes 3.73 s`.
    pub(super) fn predicate(self, end_s: f64) -> String {
        match self {
            Self::Done => format!("takes {end_s:.2}\u{a0}s"),
            Self::CutOff => format!("is not done after {end_s:.0}\u{a0}s"),
            Self::Failed => format!("failed at {end_s:.2}\u{a0}s"),
            Self::Interrupted => format!("was interrupted at {end_s:.2}\u{a0}s"),
            Self::Unfinished => format!("is recorded up to {end_s:.2}\u{a0}s"),
        }
    }

    /// Returns the label of a curve that ends at this time, such as `3.73 s`.
    pub(super) fn label(self, end_s: f64) -> String {
        match self {
            Self::Done => format!("{end_s:.2} s"),
            Self::CutOff => format!("the first {end_s:.0} s"),
            Self::Failed => format!("failed at {end_s:.2} s"),
            Self::Interrupted => format!("interrupted at {end_s:.2} s"),
            Self::Unfinished => format!("the first {end_s:.2} s"),
        }
    }

    /// Returns a cell of a column of times in s.
    pub(super) fn cell(self, end_s: f64) -> String {
        match self {
            Self::Done => format!("{end_s:.2}"),
            Self::CutOff => format!("over {end_s:.0}"),
            Self::Failed => format!("failed at {end_s:.2}"),
            Self::Interrupted => format!("interrupted at {end_s:.2}"),
            Self::Unfinished => format!("over {end_s:.2}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::conditions::Measured;
    use records::mode::Mode;
    use records::schedule::Schedule;
    use records::trace::PlcScan;
    use std::time::Duration;

    const CM: ExecutionType = ExecutionType::Cm;

    fn run(status: Status) -> Results {
        let (setup, _) = planning::setup_with_application("A").unwrap();
        Results { status, ..Results::new(&setup, "", Mode::Real, &Schedule::new(&[CM], 3, 1)) }
    }

    fn recording(end_us: i64) -> Recording {
        let mut recording = Recording::default();
        recording.plc(PlcScan { at_us: end_us, true_ns: 0, sample: plc_node::Sample::default() });
        recording
    }

    #[test]
    fn only_a_repetition_that_was_done_takes_its_time() {
        let mut failed = run(Status::Failed);
        failed.record_failure(CM, 1, "the connection to the robot was lost".to_owned());
        let said = |results: &Results, end_us| {
            End::of(results, CM, &recording(end_us)).predicate(end_us as f64 / 1e6)
        };
        assert_eq!(said(&failed, 1_410_000), "failed at 1.41\u{a0}s");
        assert_eq!(said(&failed, 120_000_000), "is not done after 120\u{a0}s");
        assert_eq!(said(&run(Status::Interrupted), 3_490_000), "was interrupted at 3.49\u{a0}s");
        assert_eq!(said(&run(Status::Running), 3_490_000), "is recorded up to 3.49\u{a0}s");
    }

    #[test]
    fn a_later_repetition_that_failed_or_was_interrupted_leaves_the_recorded_one_done() {
        for status in [Status::Failed, Status::Interrupted, Status::Running, Status::Complete] {
            let mut results = run(status);
            results.record(CM, &Measured::lasting(Duration::from_millis(3_730))).unwrap();
            if status == Status::Failed {
                results.record_failure(CM, 2, "the connection to the robot was lost".to_owned());
            }
            assert_eq!(End::of(&results, CM, &recording(3_730_000)), End::Done, "{status:?}");
        }
    }
}
