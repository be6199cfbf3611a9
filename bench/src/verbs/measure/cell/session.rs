//! Executes the schedule of a cell. It saves each repetition before the next one starts, so that an early end loses nothing.

use planning::PlannedCell;
use plc_node::ExecutionType;
use records::cell_directory::CellDirectory;
use records::cell_results::CellResults;
use records::cell_sample::CellSample;
use records::cell_stop::CellStop;
use records::exit::Exit;
use records::host::Host;
use records::results::Status;
use records::schedule::{Schedule, Step};
use records::trace::{CellTrace, Recording};
use report::export::Exports;
use report::live::Live;
use report::progress::Progress;
use setup::Cell;
use stands::cell_measured::CellMeasured;
use stands::cell_stand::CellStand;
use stands::cell_verification::CellVerification;
use stands::planned_station::PlannedStation;

/// The files of a run of a cell, and its progress on screen.
pub(super) struct CellSession {
    pub(super) directory: CellDirectory,
    pub(super) exports: Exports,
    pub(super) progress: Progress,
    /// The page that shows the run in progress.
    pub(super) live: Option<Live>,
}

/// Result of a run, and how it ended.
pub(super) struct CellEnded {
    pub(super) results: CellResults,
    pub(super) exit: Exit,
    /// Why a repetition failed, if one did, and what could not be saved.
    pub(super) failures: Vec<anyhow::Error>,
}

impl CellEnded {
    /// Returns a run that ended before its first repetition.
    pub(super) const fn without_runs(results: CellResults, exit: Exit) -> Self {
        Self { results, exit, failures: Vec::new() }
    }

    /// Adds an error that came beside the repetitions. A run that passed becomes a failure with this exit code.
    pub(super) fn and_failure(&mut self, error: anyhow::Error, exit: Exit) {
        self.failures.push(error);
        if self.exit == Exit::Pass {
            self.exit = exit;
        }
    }
}

impl CellSession {
    /// Writes the description of the computer.
    ///
    /// # Errors
    ///
    /// It cannot be written.
    pub(super) fn write_host(&self, host: &Host) -> anyhow::Result<()> {
        self.directory.write_host(&host.to_json()?)
    }

    /// Executes the schedule on the stand until it is done, a repetition fails or is not as planned, or `interrupt` resolves.
    ///
    /// # Errors
    ///
    /// The initial results cannot be written.
    pub(super) async fn run(
        &mut self,
        stand: &mut impl CellStand,
        schedule: &Schedule,
        mut results: CellResults,
        judge: &mut Judge,
        interrupt: impl Future<Output = ()>,
    ) -> anyhow::Result<CellEnded> {
        let mut interrupt = std::pin::pin!(interrupt);
        // A run that is killed can be read, and a file that cannot be written is noticed before the first repetition.
        self.save(&results)?;
        let mut known = 0;
        let feed = self.live.as_ref().map(Live::feed);
        let alarm = |text: String| feed.iter().for_each(|feed| feed.alarm(text.as_str()));
        let show = |results: &CellResults| feed.iter().for_each(|feed| feed.cell_results(results));
        show(&results);
        for step in schedule.steps() {
            self.progress.running(step.execution_type, step.repetition);
            feed.iter().for_each(|feed| feed.next(step.execution_type, step.repetition));
            // A virtual run never waits, so signals are handled here.
            tokio::task::yield_now().await;
            let outcome = tokio::select! {
                biased;
                () = &mut interrupt => {
                    results.status = Status::Interrupted;
                    break;
                }
                outcome = stand.execute(step) => outcome,
            };
            let outcome = judge.record(&mut results, &step, outcome, stand.recordings());
            stand.health().write_to(&mut results);
            for lost in results.repeated.iter().skip(known) {
                self.progress.warn(&format!("run again, {lost}"));
                alarm(format!("run again, {lost}"));
            }
            known = results.repeated.len();
            if outcome.is_err() {
                results.status = Status::Failed;
            }
            let saved = self.directory.save(&step, &outcome, &results).and_then(|()| self.export(&results));
            let of_type = results.results.get(step.execution_type);
            let (aet_ms, mad_ms) = of_type.map_or((None, None), |result| (result.aet_ms, result.mad_ms));
            self.progress.finished_with(step.execution_type, step.repetition, aet_ms, mad_ms);
            show(&results);
            let failed = outcome.err().map(|error| failure(error, &step, schedule.reps));
            failed.iter().for_each(|error| alarm(format!("{error:#}")));
            if let Err(error) = saved {
                self.progress.end();
                let cut_short = error.context("the run ends here, since the disk does not take its results");
                let failures = failed.into_iter().chain([cut_short]).collect();
                return Ok(CellEnded { results, exit: Exit::Internal, failures });
            }
            if let Some(error) = failed {
                self.progress.end();
                return Ok(CellEnded { results, exit: Exit::of_run(&error), failures: vec![error] });
            }
        }
        self.progress.end();
        let exit = match results.status {
            Status::Interrupted => Exit::Interrupted,
            _ => Exit::Pass,
        };
        if exit == Exit::Pass {
            results.status = Status::Complete;
        }
        Ok(CellEnded::without_runs(results, exit))
    }

    /// Writes the results so far.
    ///
    /// # Errors
    ///
    /// They cannot be written.
    pub(super) fn save(&self, results: &CellResults) -> anyhow::Result<()> {
        self.directory.save_results(results)?;
        self.export(results)
    }

    fn export(&self, results: &CellResults) -> anyhow::Result<()> {
        self.exports.write_cell(results)
    }
}

/// Returns the error of a failed repetition with its name.
fn failure(error: anyhow::Error, step: &Step, reps: u32) -> anyhow::Error {
    let Step { execution_type, repetition, .. } = step;
    error.context(format!("repetition {execution_type} {repetition} of {reps} failed"))
}

/// Comparison of every repetition with the plan, and the traces of the first ones.
pub(super) struct Judge {
    verification: CellVerification,
    /// The first repetition of each type.
    pub(super) traces: CellTrace,
}

impl Judge {
    /// Takes the traces that the nodes wrote, and measures the first repetition of each type by them.
    pub(super) fn take_traces(&mut self, traces: CellTrace, results: &mut CellResults) -> anyhow::Result<()> {
        for execution_type in ExecutionType::ALL {
            let recordings = traces.stations.iter().map(|trace| trace.types.get(execution_type).cloned());
            let recordings: Option<Vec<Recording>> = recordings.collect();
            let Some(result) = results.results.entry(execution_type) else { continue };
            if let (Some(recordings), Some(first)) = (recordings, result.relative_pose_mm.first_mut()) {
                *first = self.verification.relative_pose(execution_type, &recordings)?;
            }
        }
        self.traces = traces;
        Ok(())
    }

    pub(super) fn new(cell: &Cell, planned: &PlannedCell, stations: &[PlannedStation]) -> Self {
        Self { verification: CellVerification::new(cell, planned, stations), traces: CellTrace::default() }
    }

    /// Adds a repetition to the results, as failed if it is not as planned at a station.
    pub(super) fn record(
        &mut self,
        results: &mut CellResults,
        step: &Step,
        outcome: anyhow::Result<CellMeasured>,
        recordings: &[Recording],
    ) -> anyhow::Result<CellSample> {
        if step.repetition == 1 && !recordings.is_empty() {
            self.traces.set(step.execution_type, recordings);
        }
        let outcome = outcome.and_then(|mut measured| {
            self.verification.check(step.execution_type, &mut measured, recordings)?;
            Ok(measured.sample)
        });
        match &outcome {
            Ok(sample) => results.record(step.execution_type, sample),
            Err(error) => {
                results.record_failure(step.execution_type, step.repetition, format!("{error:#}"));
                if !recordings.is_empty() {
                    let stop = CellStop::of(step.repetition, recordings);
                    results.record_stop(step.execution_type, stop);
                }
            }
        }
        outcome
    }
}
