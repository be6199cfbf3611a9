//! Virtual runs that a table and report need besides the measured one. They run on another core.

use std::thread::{self, JoinHandle};

use anyhow::{Context, anyhow};
use planning::Application;
use plc_node::ExecutionType;
use setup::Setup;

use records::arms::Arms;
use records::plant_speed::PlantSpeed;
use records::results::{Results, WithoutOverhead};
use records::schedule::{SEED, Schedule};
use stands::planned_cell::PlannedCell;
use stands::virtual_run;

/// Repetitions of RC on each arm: their times differ by much less than those of the arms.
const ARMS_REPETITIONS: u32 = 3;

/// The reference runs of a run; by default none.
#[derive(Default)]
pub(super) struct ReferenceRuns {
    without_overhead: Option<JoinHandle<anyhow::Result<(Results, PlantSpeed)>>>,
    arms: Option<JoinHandle<anyhow::Result<Arms>>>,
}

impl ReferenceRuns {
    /// Starts the run without the calibrated overhead, if the setup has one, and the runs on the paper's arms if the run
    /// is `of_the_paper`.
    pub(super) fn start(
        setup: &Setup,
        application: &Application,
        schedule: &Schedule,
        of_the_paper: bool,
    ) -> Self {
        let without_overhead = (setup.robot.skill_overhead_us.value > 0).then(|| {
            let (mut setup, application, schedule) = (setup.clone(), application.clone(), schedule.clone());
            setup.robot.skill_overhead_us.value = 0;
            thread::spawn(move || without_overhead(&setup, &application, &schedule))
        });
        Self { without_overhead, arms: of_the_paper.then(|| thread::spawn(arms)) }
    }

    /// Waits for them and adds what they found; returns also how much faster than the plant the run without overhead was.
    ///
    /// # Errors
    ///
    /// One of them failed.
    pub(super) fn finish(self, results: Results) -> anyhow::Result<(Results, Option<PlantSpeed>)> {
        let (without_overhead, speed) = self.without_overhead.map(joined).transpose()?.unzip();
        let arms = self.arms.map(joined).transpose()?;
        let without_skill_overhead: Option<WithoutOverhead> =
            without_overhead.map(|results: Results| results.as_without_overhead());
        Ok((Results { without_skill_overhead, arms, ..results }, speed))
    }
}

fn joined<T>(thread: JoinHandle<anyhow::Result<T>>) -> anyhow::Result<T> {
    thread.join().map_err(|_| anyhow!("a virtual run beside the measured one broke off"))?
}

/// Executes the whole schedule on a setup without skill overhead.
fn without_overhead(
    setup: &Setup,
    application: &Application,
    schedule: &Schedule,
) -> anyhow::Result<(Results, PlantSpeed)> {
    virtual_run::whole_with_speed(setup, PlannedCell::of(setup, application)?, schedule)
}

/// Runs RC on the paper's two arms, each as its own setup and as the other one programs the motions.
fn arms() -> anyhow::Result<Arms> {
    let (a, found_a) = planning::setup_with_application("A")?;
    let (b, found_b) = planning::setup_with_application("B")?;
    let aet = |arm: &Setup, motions: &Setup, application: &Application| {
        let setup = Setup { motions: motions.motions.clone(), ..arm.clone() };
        let schedule = Schedule::new(&[ExecutionType::Rc], ARMS_REPETITIONS, SEED);
        let results = virtual_run::whole(&setup, application, &schedule)?;
        let figure = results.figure(ExecutionType::Rc).context("the run has no samples")?;
        anyhow::Ok(figure.aet_ms)
    };
    Ok(Arms {
        a_ms: aet(&a, &a, &found_a.application)?,
        b_ms: aet(&b, &b, &found_b.application)?,
        b_as_a_ms: aet(&b, &a, &found_b.application)?,
        a_as_b_ms: aet(&a, &b, &found_a.application)?,
    })
}
