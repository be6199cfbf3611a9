//! Executes one schedule. It saves each repetition before the next one starts, so that an early end loses nothing.

use records::conditions::{Health, Measured};
use records::exit::Exit;
use records::feed::Feed;
use records::host::Host;
use records::plant_speed::PlantSpeed;
use records::results::{Results, Status};
use records::run_directory::{Durability, RunDirectory};
use records::schedule::{Schedule, Step};
use report::export::Exports;
use report::live::Live;
use report::progress::Progress;
use stands::Stand;

/// The files of a run, and its progress on screen and in the live view.
#[derive(Debug)]
pub struct Session {
    /// The run directory.
    pub directory: RunDirectory,
    /// Exported files outside of it.
    pub exports: Exports,
    /// The lines on the terminal.
    pub progress: Progress,
    /// The page that shows the run in progress.
    pub live: Option<Live>,
}

/// Result of a run, and how it ended.
#[derive(Debug)]
pub struct Ended {
    /// Its results.
    pub results: Results,
    /// The program's exit code.
    pub exit: Exit,
    /// Why a repetition failed, if one did, and which parts of the run could not be saved.
    pub failures: Vec<anyhow::Error>,
    /// How much faster than the plant it was, if its time was virtual.
    pub speed: Option<PlantSpeed>,
}

impl Ended {
    /// Adds the result of saving more of the run. If that failed, a run that passed becomes a failure.
    #[must_use]
    pub fn and_saved(mut self, saved: anyhow::Result<()>) -> Self {
        if let Err(error) = saved {
            self.failures.push(error);
            if self.exit == Exit::Pass {
                self.exit = Exit::Internal;
            }
        }
        self
    }
}

impl Session {
    /// Writes the description of the computer.
    ///
    /// # Errors
    ///
    /// It cannot be written.
    pub fn write_host(&self, host: &Host) -> anyhow::Result<()> {
        self.directory.write_host(&host.to_json()?)
    }

    /// Executes the schedule on the stand until it is done, a repetition fails or is not what `verify` accepts, or
    /// `interrupt` resolves. `verify` returns what it could not verify.
    ///
    /// # Errors
    ///
    /// The initial results cannot be written. If the results of a repetition cannot be written, the run ends with
    /// what it measured, and earlier files are kept.
    pub async fn run(
        &mut self,
        stand: &mut impl Stand,
        schedule: &Schedule,
        mut results: Results,
        mut verify: impl FnMut(&Measured) -> anyhow::Result<Vec<String>>,
        interrupt: impl Future<Output = ()>,
    ) -> anyhow::Result<Ended> {
        let mut interrupt = std::pin::pin!(interrupt);
        let mut failures = Vec::new();
        let feed = self.live.as_ref().map(Live::feed);
        let show = |results: &Results| feed.iter().for_each(|feed| feed.results(results));
        // A file that cannot be written should be noticed before the first repetition.
        self.save(&results, Durability::Written)?;
        results.status = Status::Complete;
        show(&results);
        for step in schedule.steps() {
            self.progress.running(step.execution_type, step.repetition);
            if let Some(feed) = &feed {
                feed.next(step.execution_type, step.repetition);
            }
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
            let outcome = record(&mut results, &step, outcome, &mut verify);
            let health = stand.health();
            self.warn_repeated(&health, results.repeated, feed.as_ref());
            results.set_health(&health);
            let so_far = if outcome.is_ok() { Status::Running } else { Status::Failed };
            let status = std::mem::replace(&mut results.status, so_far);
            let saved = self
                .directory
                .save(&step, &outcome, &results)
                .and_then(|()| self.exports.write(&results, Durability::Written));
            self.progress.finished(step.execution_type, step.repetition, &results);
            show(&results);
            if let Err(error) = outcome {
                failures.push(failure(error, &step, schedule.reps, feed.as_ref()));
            }
            if let Err(error) = saved {
                self.progress.end();
                failures.push(error.context("the run ends here, since the disk does not take its results"));
                return Ok(Ended { results, exit: Exit::Internal, failures, speed: None });
            }
            if results.status == Status::Failed {
                break;
            }
            results.status = status;
        }
        self.progress.end();
        let saved = self.finish(&results);
        Ok(Ended { exit: exit(results.status, &failures), results, failures, speed: None }.and_saved(saved))
    }

    /// Warns of repetitions that were run again, behind the `known` ones.
    fn warn_repeated(&self, health: &Health, known: u32, feed: Option<&Feed>) {
        for lost in health.repeated.iter().skip(known as usize) {
            self.progress.warn(&format!("run again, {lost}"));
            if let Some(feed) = feed {
                feed.alarm(format!("run again, {lost}"));
            }
        }
    }

    /// Writes the final results.
    ///
    /// # Errors
    ///
    /// They cannot be written.
    pub fn finish(&self, results: &Results) -> anyhow::Result<()> {
        self.save(results, Durability::Synced)
    }

    fn save(&self, results: &Results, durability: Durability) -> anyhow::Result<()> {
        self.directory.save_results(results)?;
        self.exports.write(results, durability)
    }
}

/// Returns the error of a failed repetition with its name, and shows it in the live view.
fn failure(error: anyhow::Error, step: &Step, reps: u32, feed: Option<&Feed>) -> anyhow::Error {
    let Step { execution_type, repetition, .. } = step;
    if let Some(feed) = feed {
        feed.alarm(format!("{execution_type} {repetition} failed: {error:#}"));
    }
    error.context(format!("repetition {execution_type} {repetition} of {reps} failed"))
}

/// Adds a repetition to the results, as failed if `verify` does not accept it or a joint exceeded its rating.
fn record(
    results: &mut Results,
    step: &Step,
    outcome: anyhow::Result<Measured>,
    mut verify: impl FnMut(&Measured) -> anyhow::Result<Vec<String>>,
) -> anyhow::Result<Measured> {
    let outcome = outcome.and_then(|measured| {
        results.add_unverified(verify(&measured)?);
        results.record(step.execution_type, &measured)?;
        Ok(measured)
    });
    if let Err(error) = &outcome {
        results.record_failure(step.execution_type, step.repetition, format!("{error:#}"));
    }
    outcome
}

/// Returns the exit code of a run that ended like this.
fn exit(status: Status, failures: &[anyhow::Error]) -> Exit {
    match status {
        Status::Failed => failures.first().map_or(Exit::RunFailed, Exit::of_run),
        Status::Interrupted => Exit::Interrupted,
        Status::Running | Status::Complete => Exit::Pass,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plc_node::ExecutionType;
    use records::conditions::Health;
    use records::exit::Failure;
    use records::mode::Mode;
    use robot_node::Quality;
    use stands::{Finished, StandConfig};
    use std::time::Duration;

    /// Takes one millisecond more in every run, fails in run `fails_at` and exceeds a rating in run `exceeds_at`.
    #[derive(Default)]
    struct Scripted {
        runs: u64,
        fails_at: u64,
        exceeds_at: u64,
    }

    impl Stand for Scripted {
        async fn start(_config: &StandConfig<'_>) -> Result<Self, Failure> {
            Ok(Self::default())
        }

        async fn finish(self, _keeps_capture: bool) -> Finished {
            Finished { trace: Ok(None), health: Ok(None), capture: Ok(()), speed: None }
        }

        async fn execute(&mut self, _step: Step) -> anyhow::Result<Measured> {
            self.runs += 1;
            if self.runs == self.fails_at {
                anyhow::bail!("the connection to the robot was lost");
            }
            let execution = Duration::from_millis(self.runs);
            let peak = if self.runs == self.exceeds_at { 2250.0 } else { 1.0 };
            let joint_jerk = robot_node::quality::Load { peak, ..Default::default() };
            let quality = Some(Quality { joint_jerk, ..Quality::default() });
            Ok(Measured { quality, ..Measured::lasting(execution) })
        }

        fn health(&self) -> Health {
            Health::default()
        }
    }

    struct SessionOutcome {
        ended: Ended,
        samples: String,
        saved: Results,
    }

    fn run(mut stand: Scripted, interrupt: impl Future<Output = ()>) -> SessionOutcome {
        let place = tempfile::tempdir().unwrap();
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let schedule = Schedule::new(&ExecutionType::ALL, 2, 1);
        let results = Results::new(&setup, &found.application.name, Mode::Real, &schedule);
        let mut session = Session {
            directory: RunDirectory::create(place.path(), &setup, &found.text, None, Durability::Synced)
                .unwrap(),
            exports: Exports::json(place.path().join("exported.json")),
            progress: Progress::start(&schedule, true),
            live: None,
        };
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let ended = runtime
            .block_on(session.run(&mut stand, &schedule, results, |_| Ok(Vec::new()), interrupt))
            .unwrap();
        let read = |name| std::fs::read_to_string(place.path().join(name)).unwrap();
        assert_eq!(read("results.json"), read("exported.json"));
        SessionOutcome {
            ended,
            samples: read("samples.csv"),
            saved: serde_json::from_str(&read("results.json")).unwrap(),
        }
    }

    #[test]
    fn a_successful_run_saves_every_repetition() {
        let outcome = run(Scripted::default(), std::future::pending());
        assert_eq!((outcome.ended.exit, outcome.saved.status), (Exit::Pass, Status::Complete));
        assert_eq!(outcome.saved, outcome.ended.results);
        insta::assert_snapshot!(outcome.samples, @"
        type,repetition,execution_ms,robot_execution_ms,blends_suppressed,plc_missed,robot_missed,error
        rc,1,1,1,0,0,0,
        sm,1,2,2,0,0,0,
        cm,1,3,3,0,0,0,
        rc,2,4,4,0,0,0,
        sm,2,5,5,0,0,0,
        cm,2,6,6,0,0,0,
        ");
    }

    #[test]
    fn a_failed_repetition_is_marked_and_the_earlier_ones_are_kept() {
        let outcome = run(Scripted { fails_at: 5, ..Scripted::default() }, std::future::pending());
        assert_eq!((outcome.ended.exit, outcome.saved.status), (Exit::RunFailed, Status::Failed));
        insta::assert_snapshot!(format!("{:#}", outcome.ended.failures[0]), @"repetition sm 2 of 2 failed: the connection to the robot was lost");
        insta::assert_snapshot!(outcome.samples, @r#"
        type,repetition,execution_ms,robot_execution_ms,blends_suppressed,plc_missed,robot_missed,error
        rc,1,1,1,0,0,0,
        sm,1,2,2,0,0,0,
        cm,1,3,3,0,0,0,
        rc,2,4,4,0,0,0,
        sm,2,,,,,,"the connection to the robot was lost"
        "#);
    }

    #[test]
    fn a_joint_beyond_its_rating_fails_the_run_and_gives_no_sample_but_counts_in_the_motion_figures() {
        let outcome = run(Scripted { exceeds_at: 5, ..Scripted::default() }, std::future::pending());
        assert_eq!((outcome.ended.exit, outcome.saved.status), (Exit::RatingExceeded, Status::Failed));
        insta::assert_snapshot!(format!("{:#}", outcome.ended.failures[0]), @"repetition sm 2 of 2 failed: a joint had a jerk of 225000.0 % of its rating, by the differences from one robot cycle to the next");
        let sm = outcome.saved.results.sm.unwrap();
        assert_eq!((sm.samples_ms, sm.failed.len()), (vec![2.0], 1));
        assert_eq!(sm.quality.unwrap().joint_jerk.peak, 2250.0);
        assert!(outcome.samples.contains("\nsm,2,,,,,,\"a joint had"), "{}", outcome.samples);
    }

    #[test]
    fn an_interrupt_keeps_the_finished_repetitions() {
        let mut turns = 0;
        let after_three = std::future::poll_fn(move |_| {
            turns += 1;
            if turns > 3 { std::task::Poll::Ready(()) } else { std::task::Poll::Pending }
        });
        let outcome = run(Scripted::default(), after_three);
        assert_eq!((outcome.ended.exit, outcome.saved.status), (Exit::Interrupted, Status::Interrupted));
        assert_eq!(outcome.samples.lines().count(), 1 + 3);
    }
}
