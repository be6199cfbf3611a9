//! A measurement of a cell on the stand of its mode, from the run directory to the last file in it.

use std::path::PathBuf;
use std::time::SystemTime;

use ::node::token::ControlToken;
use planning::PlannedCell;
use setup::Cell;

use super::super::alone::add_alone;
use super::super::{Capture, RunOptions, RunPart, live_view};
use super::session::{CellEnded, CellSession, Judge};
use crate::COMMIT;
use records::cell_directory::CellDirectory;
use records::cell_results::CellResults;
use records::exit::{Exit, Failure};
use records::faults::Fault;
use records::host::{self, Host};
use records::mode::Mode;
use records::results::Status;
use records::run_directory::{self, Durability};
use records::schedule::Schedule;
use records::trace::CellTrace;
use report::cell_files;
use report::live::{AboutArms, Live, Reserved, SavedRun};
use report::progress::Progress;
use stands::cell_stand::{CellConfig, CellFinished, CellStand};
use stands::planned_station::PlannedStation;
#[cfg(all(feature = "real", target_os = "linux"))]
use stands::rig::Rig;
use stands::virtual_run::CellRun;
use studies::event_loop::interrupt;

/// A measurement of a cell: checked options, the cell, and what is to be run.
pub(super) struct CellMeasurement<'a> {
    pub(super) options: &'a RunOptions,
    pub(super) faults: Vec<Fault>,
    pub(super) cell: Cell,
    pub(super) planned: PlannedCell,
    pub(super) stations: Vec<PlannedStation>,
    /// The text of each station's application.
    pub(super) texts: Vec<String>,
    /// The texts as the PLC has them.
    pub(super) applications: String,
    pub(super) schedule: Schedule,
    pub(super) token: Option<ControlToken>,
    /// Address of the live view.
    pub(super) live: Option<Reserved>,
}

impl CellMeasurement<'_> {
    /// Runs the measurement; returns its results and the directory with its files.
    pub(super) async fn run(mut self) -> Result<(CellEnded, PathBuf, Option<Live>), Failure> {
        let address = self.live.take();
        let Self { options, cell, schedule, .. } = &self;
        let started = SystemTime::now();
        let path = options
            .out
            .clone()
            .unwrap_or_else(|| run_directory::default_path(&cell.name, options.mode.name(), started));
        let durability = match options.mode {
            Mode::Real => Durability::Synced,
            Mode::Virtual => Durability::Written,
        };
        let mut results = CellResults::new(cell, &self.planned, options.mode, schedule);
        let mut session = CellSession {
            directory: CellDirectory::create(&path, cell, &self.texts, durability)?,
            exports: options.exports.clone().of_run(host::date(started)),
            progress: Progress::start(schedule, options.quiet),
            live: address
                .map(|address| {
                    let arms = AboutArms::Several(cell, &self.planned, &results.application);
                    live_view::start(address, arms, schedule, options, &path)
                })
                .transpose()?,
        };
        let host = Host::read(started, COMMIT);
        session.write_host(&host)?;
        results.digests = Some(session.directory.digests().clone());
        let ran = match options.mode {
            Mode::Virtual => self.run_on::<CellRun>(&mut session, host, results).await,
            #[cfg(all(feature = "real", target_os = "linux"))]
            Mode::Real => self.run_on::<Rig>(&mut session, host, results).await,
            #[cfg(not(all(feature = "real", target_os = "linux")))]
            Mode::Real => Err(super::super::no_real_mode()),
        };
        let live = session.live.take();
        if let Some(live) = &live {
            let saved = SavedRun { directory: &path, has_report: !self.options.leaves_out(RunPart::Report) };
            live.end_cell(ran.as_ref().map_err(|failure| &failure.error).map(|ended| &ended.results), saved);
        }
        let mut ended = match ran {
            Ok(ended) => ended,
            Err(failure) => {
                live.into_iter().for_each(|live| live.close(None));
                session.directory.discard();
                return Err(failure);
            }
        };
        // If the disk was full before, the files there are complete, and stay so if this does not fit either.
        let is_full = ended.exit == Exit::Internal;
        if let Err(error) = session.save(&ended.results)
            && !is_full
        {
            ended.and_failure(error, Exit::Internal);
        }
        Ok((ended, path, live))
    }

    /// Executes the schedule on a stand, from its start to its end.
    async fn run_on<S: CellStand>(
        &self,
        session: &mut CellSession,
        host: Host,
        mut results: CellResults,
    ) -> Result<CellEnded, Failure> {
        let directory = session.directory.path().to_owned();
        let voice = session.progress.voice();
        let feed = session.live.as_ref().map(Live::feed);
        let config = CellConfig {
            cell: &self.cell,
            stations: &self.stations,
            texts: &self.texts,
            applications: &self.applications,
            seed: self.options.seed,
            directory: &directory,
            capture: self.options.capture.retention(),
            faults: &self.faults,
            feed: feed.as_ref(),
            voice: Some(&voice),
            attach: self.options.attach.as_ref(),
            token: self.token.as_ref(),
        };
        let mut interrupt = std::pin::pin!(interrupt()?);
        let started = tokio::select! {
            () = &mut interrupt => None,
            stand = S::start(&config) => Some(stand),
        };
        let mut stand = match started {
            Some(Ok(stand)) => stand,
            Some(Err(failure)) => {
                results.status = Status::Failed;
                session.save(&results)?;
                return Err(failure);
            }
            None => {
                results.status = Status::Interrupted;
                return Ok(CellEnded::without_runs(results, Exit::Interrupted));
            }
        };
        if let Some(refused) = stand.refused() {
            session.write_host(&host.with_scheduling(&refused))?;
            refused.iter().for_each(|warning| session.progress.warn(warning));
        }
        results.attached = stand.attached();
        let mut judge = Judge::new(&self.cell, &self.planned, &self.stations);
        let ended = session.run(&mut stand, &self.schedule, results, &mut judge, interrupt).await;
        let mut ended = ended?;
        let CellFinished { trace, health } = stand.finish(self.wants_capture(ended.exit)).await;
        let taken = match trace {
            Ok(Some(traces)) => judge.take_traces(traces, &mut ended.results),
            Ok(None) => Ok(()),
            Err(error) => Err(error),
        };
        if let Err(error) = taken {
            session.progress.warn(&format!("the report lacks the curves over time: {error:#}."));
        }
        if let Err(error) = self.save_traces(session, &judge.traces) {
            ended.and_failure(error, Exit::Internal);
        }
        if ended.exit == Exit::Pass {
            add_alone(&mut ended.results, &self.planned, &self.schedule)?;
        }
        match health {
            // The final counts of all nodes belong together; their earlier reports are not simultaneous.
            Ok(Some(health)) if ended.failures.is_empty() => health.write_to(&mut ended.results),
            Ok(_) => {}
            // A failed run already has its error; the nodes' end adds little.
            Err(Failure { exit, error }) if !ended.exit.is_failed_run() => {
                // No repetition failed, so the exit code must not say so.
                let exit = if exit == Exit::RunFailed { Exit::Internal } else { exit };
                ended.and_failure(error, exit);
            }
            Err(_) => {}
        }
        Ok(ended)
    }

    /// Saves the tables for the report, and the timeline and the arms' motion if requested.
    fn save_traces(&self, session: &CellSession, traces: &CellTrace) -> anyhow::Result<()> {
        if !self.options.leaves_out(RunPart::Traces) {
            session.directory.save_trace(traces)?;
        }
        if self.options.trace {
            cell_files::save_timeline(session.directory.path(), &self.planned, traces)?;
        }
        #[cfg(feature = "mcap")]
        if self.options.mcap {
            cell_files::save_playback(session.directory.path(), &self.cell, &self.planned, traces)?;
        }
        Ok(())
    }

    /// Returns whether the captures of a run with this exit code are written.
    fn wants_capture(&self, exit: Exit) -> bool {
        self.options.capture == Capture::Always || exit.is_failed_run()
    }
}
