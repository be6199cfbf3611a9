//! A measurement on the stand of its mode, from the run directory to the last file in it.

use std::future::Future;
use std::path::PathBuf;
use std::time::SystemTime;

use ::node::token::ControlToken;
use planning::Found;
use plc_node::ExportedCode;
use setup::Setup;

use super::live_view;
use super::reference_runs::ReferenceRuns;
use super::session::{Ended, Session};
use super::{Capture, RunOptions, RunPart};
use crate::COMMIT;
use records::conditions::Measured;
use records::exit::{Exit, Failure};
use records::faults::Fault;
use records::host::{self, Host};
use records::mode::Mode;
use records::paper::PaperComparison;
use records::results::{Results, Status};
use records::run_directory::{self, Durability, RunDirectory, replace};
use records::schedule::Schedule;
use records::trace::Trace;
use report::in_shell;
use report::live::{AboutArms, Live, Reserved, SavedRun};
#[cfg(feature = "mcap")]
use report::playback;
use report::progress::Progress;
use report::timeline;
#[cfg(all(feature = "real", target_os = "linux"))]
use stands::rig::{Rig, RigError};
use stands::verification::Verification;
use stands::virtual_run::VirtualRun;
use stands::{Finished, Stand, StandConfig};
use studies::event_loop::interrupt;

/// Warnings of a plan that are shown before a run.
const WARNINGS: usize = 5;

/// Returns whether the rig says by this error that a capture lacks something.
#[cfg(all(feature = "real", target_os = "linux"))]
fn is_of_capture(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref::<RigError>(), Some(RigError::Capture(_)))
}

#[cfg(not(all(feature = "real", target_os = "linux")))]
const fn is_of_capture(_: &anyhow::Error) -> bool {
    false
}

/// A measurement: checked options, the cell, and what is to be run.
pub(super) struct Measurement<'a> {
    pub(super) options: &'a RunOptions,
    pub(super) faults: Vec<Fault>,
    pub(super) setup: Setup,
    pub(super) found: Found,
    pub(super) schedule: Schedule,
    /// Warnings about the planned motions that a person should read: blends that had to shrink.
    pub(super) warnings: Vec<String>,
    pub(super) token: Option<ControlToken>,
    /// Address of the live view.
    pub(super) live: Option<Reserved>,
    /// Exported code in the place of the PLC's function blocks.
    pub(super) code: Option<ExportedCode>,
}

impl Measurement<'_> {
    /// Runs the measurement; returns its results, the directory with its files, and the live view, which waits for the report.
    pub(super) async fn run(mut self) -> Result<(Ended, PathBuf, Option<Live>), Failure> {
        let started = SystemTime::now();
        let path = self.options.out.clone().unwrap_or_else(|| {
            run_directory::default_path(&self.setup.name, self.options.mode.name(), started)
        });
        let durability = match self.options.mode {
            Mode::Real => Durability::Synced,
            Mode::Virtual => Durability::Written,
        };
        let mut session = Session {
            directory: RunDirectory::create(
                &path,
                &self.setup,
                &self.found.text,
                self.code.as_ref().map(ExportedCode::text),
                durability,
            )?,
            exports: self.options.exports.clone().of_run(host::date(started)),
            progress: Progress::start(&self.schedule, self.options.quiet),
            live: self
                .live
                .take()
                .map(|address| {
                    let arms = AboutArms::One(&self.setup, &self.found.application);
                    live_view::start(address, arms, &self.schedule, self.options, &path)
                })
                .transpose()?,
        };
        self.warn(&session.progress);
        let host = Host::read(started, COMMIT);
        session.write_host(&host)?;
        let interrupt = interrupt()?;
        let results = Results { digests: Some(session.directory.digests().clone()), ..self.empty_results() };
        let of_the_paper = results.paper.is_some();
        let reference_runs = || match self.has_modelled_robot() {
            true => ReferenceRuns::start(&self.setup, &self.found.application, &self.schedule, of_the_paper),
            false => ReferenceRuns::default(),
        };
        // In real mode they run afterwards, so that they take no core from the nodes.
        let meanwhile = (self.options.mode == Mode::Virtual).then(reference_runs);
        let ran = match self.options.mode {
            Mode::Virtual => self.run_on::<VirtualRun>(&mut session, host, results, interrupt).await,
            #[cfg(all(feature = "real", target_os = "linux"))]
            Mode::Real => self.run_on::<Rig>(&mut session, host, results, interrupt).await,
            #[cfg(not(all(feature = "real", target_os = "linux")))]
            Mode::Real => Err(super::no_real_mode()),
        };
        let live = session.live.take();
        if let Some(live) = &live {
            let saved = SavedRun { directory: &path, has_report: !self.options.leaves_out(RunPart::Report) };
            live.end(ran.as_ref().map_err(|failure| &failure.error).map(|ended| &ended.results), saved);
        }
        let ended = match ran {
            Ok(ended) => ended,
            Err(failure) => {
                live.into_iter().for_each(|live| live.close(None));
                session.directory.discard();
                return Err(failure);
            }
        };
        let ended = match ended.exit {
            Exit::Pass => {
                let (results, reference) = meanwhile.unwrap_or_else(reference_runs).finish(ended.results)?;
                if let (Some(speed), Some(reference)) = (ended.speed, reference) {
                    let both = speed.beside(reference);
                    session.progress.say(&format!("with the run without skill overhead beside it: {both}"));
                }
                Ended { results, ..ended }
            }
            // After an interrupt, or if a node needs attention, the user does not want to wait for them.
            _ => ended,
        };
        // If the disk was full before, the files there are complete, and stay so if this does not fit either.
        let saved = session.finish(&ended.results);
        let saved = if ended.exit == Exit::Internal { Ok(()) } else { saved };
        Ok((ended.and_saved(saved), path, live))
    }

    fn empty_results(&self) -> Results {
        let (setup, application) = (&self.setup, &self.found.application);
        let overrides = self.schedule.overrides.as_ref();
        let comparison = PaperComparison::of(setup, application, overrides, &self.faults);
        let results = Results::new(setup, &application.name, self.options.mode, &self.schedule)
            .with_paper(setup, comparison);
        if self.has_modelled_robot() { results } else { results.without_calibration() }
    }

    /// Returns whether the robot is our model of one, and not another device beside an attached PLC.
    fn has_modelled_robot(&self) -> bool {
        self.options.attach.as_ref().is_none_or(|attach| attach.robot().is_some())
    }

    /// Prints the plan's first warnings: for a grid each would be repeated in every cycle.
    fn warn(&self, progress: &Progress) {
        self.warnings.iter().take(WARNINGS).for_each(|warning| progress.warn(warning));
        let more = self.warnings.len().saturating_sub(WARNINGS);
        if more > 0 {
            let application = self.options.application.as_ref().unwrap_or(&self.setup.application);
            progress.warn(&format!(
                "{more} more of that kind; `plc-node plan {} --setup {}` shows them all",
                in_shell(application),
                in_shell(self.options.setup.name())
            ));
        }
    }

    /// Executes the schedule on a stand, from its start to its end.
    async fn run_on<S: Stand>(
        &self,
        session: &mut Session,
        host: Host,
        results: Results,
        interrupt: impl Future<Output = ()>,
    ) -> Result<Ended, Failure> {
        let directory = session.directory.path().to_owned();
        let feed = session.live.as_ref().map(Live::feed);
        let voice = session.progress.voice();
        let config = StandConfig {
            setup: &self.setup,
            application: &self.found.application,
            application_text: &self.found.text,
            seed: self.options.seed,
            directory: &directory,
            capture: self.options.capture.retention(),
            frames: self.options.trace,
            // The nodes read the copy, so that the run is that of its directory.
            code: self.code.as_ref().map(|code| (directory.as_path(), code)),
            faults: &self.faults,
            feed: feed.as_ref(),
            voice: Some(&voice),
            attach: self.options.attach.as_ref(),
            token: self.token.as_ref(),
        };
        let mut verification =
            Verification::new(&self.setup, &self.found.application, self.options.mode, &self.faults)?;
        let mut interrupt = std::pin::pin!(interrupt);
        let started = tokio::select! {
            () = &mut interrupt => None,
            stand = S::start(&config) => Some(stand),
        };
        let mut stand = match started {
            Some(Ok(stand)) => stand,
            Some(Err(failure)) => {
                session.finish(&Results { status: Status::Failed, ..results })?;
                return Err(failure);
            }
            None => {
                let results = Results { status: Status::Interrupted, ..results };
                return Ok(Ended { results, exit: Exit::Interrupted, failures: Vec::new(), speed: None });
            }
        };
        if let Some(refused) = stand.refused() {
            session.write_host(&host.with_scheduling(&refused))?;
            refused.iter().for_each(|warning| session.progress.warn(warning));
        }
        let attached = stand.attached();
        // A robot that is not our node does not say where its positions come from.
        let is_ours = attached.as_ref().is_none_or(|attached| attached.robot.is_some());
        let positions = results.positions.filter(|_| is_ours);
        let results = Results { attached, positions, ..results };
        let verify = |measured: &Measured| {
            verification.check(measured)?;
            Ok(verification.unverified(measured))
        };
        let ended = session.run(&mut stand, &self.schedule, results, verify, interrupt).await?;
        let finished = stand.finish(self.wants_capture(ended.exit)).await;
        Ok(self.take_up(ended, finished, session))
    }

    /// Saves the stand's trace and captures, and adds its final conditions to the results.
    fn take_up(&self, ended: Ended, finished: Finished, session: &Session) -> Ended {
        let Finished { trace, health, capture, speed } = finished;
        if let Some(speed) = speed {
            session.progress.say(&format!("virtual: {speed}"));
        }
        let mut ended = Ended { speed, ..ended };
        // What a capture lacks is found when it is written to its end.
        let of_rig = health.as_ref().err().map(|failure| &failure.error).filter(|error| is_of_capture(error));
        if let Some(error) = capture.as_ref().err().or(of_rig) {
            ended.results.incomplete.push(format!("The captures are incomplete: {error:#}."));
        }
        let mut ended = ended.and_saved(capture);
        match trace {
            Ok(Some(trace)) => {
                if let Some(lack) = trace.incomplete() {
                    session.progress.warn(&lack);
                    ended.results.incomplete.push(lack);
                }
                ended = ended.and_saved(self.save_trace(&trace, session));
            }
            Ok(None) => {}
            Err(error) => {
                let lack = format!("The report lacks the curves over time: {error:#}.");
                session.progress.warn(&lack);
                ended.results.incomplete.push(lack);
            }
        }
        match health {
            // The two nodes' final counts belong together; their earlier reports are not simultaneous.
            Ok(Some(health)) if ended.failures.is_empty() => ended.results.set_health(&health),
            // A failed run already has its error; the nodes' end adds little.
            Err(Failure { exit, error }) if !ended.exit.is_failed_run() => {
                // No repetition failed, so the exit code must not say so.
                let exit = if exit == Exit::RunFailed { Exit::Internal } else { exit };
                ended.failures.push(error);
                ended.exit = if ended.exit == Exit::Pass { exit } else { ended.exit };
            }
            _ => {}
        }
        ended
    }

    /// Saves the tables for the report, and the timeline and the arm's motion if requested.
    fn save_trace(&self, trace: &Trace, session: &Session) -> anyhow::Result<()> {
        if !self.options.leaves_out(RunPart::Traces) {
            trace.save(session.directory.path())?;
        }
        if self.options.trace {
            let path = session.directory.path().join(timeline::FILE);
            let plan = self.found.plan(&self.setup)?;
            let motions: Vec<_> = plan.motions.iter().map(|motion| motion.name.as_str()).collect();
            replace(&path, &timeline::json(trace, &motions)?, Durability::Written)?;
        }
        #[cfg(feature = "mcap")]
        if self.options.mcap {
            let path = session.directory.path().join(playback::FILE);
            let plan = self.found.plan(&self.setup)?;
            replace(&path, playback::bytes(trace, &self.setup, &plan)?, Durability::Written)?;
        }
        Ok(())
    }

    /// Returns whether the captures of a run with this exit code are written.
    fn wants_capture(&self, exit: Exit) -> bool {
        self.options.capture == Capture::Always || exit.is_failed_run()
    }
}
