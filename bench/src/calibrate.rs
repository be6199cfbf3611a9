//! Finds the three numbers of a setup that only the paper's Table 2 can fix, in virtual time.
//!
//! Each figure depends on one number more than on the others, so they are found in turn and the round is repeated
//! until nothing moves: the programmed speed from RC's AET, the cost of a skill call from SM's AET, the controller's
//! time quantum from the MADs of RC and SM. What two figures of one number say at once is settled by least squares
//! of the relative errors.

use std::fmt::Write as _;

use anyhow::{Context, bail};
use plc_node::ExecutionType;
use setup::{Application, Setup};

use crate::plan::Plan;
use crate::results::{PaperFigure, QUANTUM, Results, SKILL_OVERHEAD, VELOCITY};
use crate::virtual_run;

/// Rounds over the three numbers; each is a correction of the one before.
const ROUNDS: usize = 3;

/// What a calibration found.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The setup with the numbers that were found.
    pub setup: Setup,
    /// What it reaches.
    pub results: Results,
}

/// Calibrates a setup on the paper's figures for it.
///
/// # Errors
///
/// The paper has no figures for this setup, a run fails, or a figure is out of reach of its number.
pub fn calibrate(
    setup: &Setup,
    application: &Application,
    reps: u32,
    seed: u64,
    mut progress: impl FnMut(&str),
) -> anyhow::Result<Calibration> {
    let Some(paper) = setup.paper.clone() else {
        bail!("setup {} has no [paper] figures to calibrate on", setup.name);
    };
    let mut setup = setup.clone();
    let run = |setup: &Setup, types: &[ExecutionType]| {
        virtual_run::whole(setup, application, &Plan::new(types, reps, seed))
    };
    let aet = |setup: &Setup, of| -> anyhow::Result<f64> {
        Ok(run(setup, &[of])?.figure(of).context("no sample")?.aet_ms)
    };
    for round in 1..=ROUNDS {
        // Speed: slower takes longer.
        let mut trial = setup.clone();
        setup.motions.velocity_percent.value = round_to(
            bisect(0.5, 100.0, 20, |percent| {
                trial.motions.velocity_percent.value = percent;
                Ok(aet(&trial, ExecutionType::Rc)? > paper.rc.aet_ms)
            })
            .context("RC")?,
            0.001,
        );
        progress(&format!("round {round}: {VELOCITY} = {}", setup.motions.velocity_percent.value));
        // Overhead: more takes longer; the answer is linear in it, so one step of Newton's method is exact but for
        // the cycles that it is rounded up to.
        let calls = f64::from(u32::try_from(application.motion.len()).unwrap_or(u32::MAX));
        for _ in 0..3 {
            let missing_us = (paper.sm.aet_ms - aet(&setup, ExecutionType::Sm)?) * 1_000.0 / calls;
            let overhead = f64::from(setup.robot.skill_overhead_us.value) + missing_us;
            if overhead < 0.0 {
                bail!("SM takes longer than the paper's even without any overhead of a skill call");
            }
            setup.robot.skill_overhead_us.value = overhead.round() as u32;
        }
        progress(&format!("round {round}: {SKILL_OVERHEAD} = {}", setup.robot.skill_overhead_us.value));
        let quantum = quantum(&setup, &paper, &run)?;
        setup.robot.interpreter_quantum_us.value = quantum;
        progress(&format!("round {round}: {QUANTUM} = {quantum}"));
    }
    let results = run(&setup, &ExecutionType::ALL)?;
    Ok(Calibration { setup, results })
}

/// The quantum whose MADs differ least from the paper's, found in coarse and then in fine steps.
fn quantum(
    setup: &Setup,
    paper: &setup::Paper,
    run: &impl Fn(&Setup, &[ExecutionType]) -> anyhow::Result<Results>,
) -> anyhow::Result<u32> {
    let mut trial = setup.clone();
    let mut error_of = |quantum_us: u32| -> anyhow::Result<f64> {
        trial.robot.interpreter_quantum_us.value = quantum_us;
        let results = run(&trial, &[ExecutionType::Rc, ExecutionType::Sm])?;
        let error = |of, paper: setup::Figure| {
            let found = results.figure(of).map_or(0.0, |figure| figure.mad_ms);
            ((found - paper.mad_ms) / paper.mad_ms).powi(2)
        };
        Ok(error(ExecutionType::Rc, paper.rc) + error(ExecutionType::Sm, paper.sm))
    };
    let mut best = (f64::INFINITY, 0_u32);
    for (step, reach) in [(4_000, 60_000), (500, 3_500)] {
        let (middle, first) = (best.1, best.1.saturating_sub(reach));
        for quantum_us in (first..=middle + reach).step_by(step) {
            let error = error_of(quantum_us)?;
            if error < best.0 {
                best = (error, quantum_us);
            }
        }
    }
    Ok(best.1)
}

/// The place between `low` and `high` where `is_low` turns false.
fn bisect(
    mut low: f64,
    mut high: f64,
    steps: usize,
    mut is_low: impl FnMut(f64) -> anyhow::Result<bool>,
) -> anyhow::Result<f64> {
    if !is_low(low)? || is_low(high)? {
        bail!("the paper's AET is not reached anywhere between {low} and {high}");
    }
    for _ in 0..steps {
        let middle = f64::midpoint(low, high);
        if is_low(middle)? { low = middle } else { high = middle }
    }
    Ok(f64::midpoint(low, high))
}

fn round_to(value: f64, step: f64) -> f64 {
    let per_one = (1.0 / step).round();
    (value * per_one).round() / per_one
}

impl Calibration {
    /// The lines to put into the setup's file, and what they reach.
    #[must_use]
    pub fn report(&self) -> String {
        let mut text = String::new();
        let _ = writeln!(
            text,
            "[motions]\nvelocity_percent = {{ value = {:?}, from = \"calibrated\", note = \"RC's AET; bench calibrate\" }}\n\n\
             [robot]\nskill_overhead_us = {{ value = {}, from = \"calibrated\", note = \"SM's AET; bench calibrate\" }}\n\
             interpreter_quantum_us = {{ value = {}, from = \"calibrated\", note = \"MADs of RC and SM; bench calibrate\" }}\n",
            self.setup.motions.velocity_percent.value,
            self.setup.robot.skill_overhead_us.value,
            self.setup.robot.interpreter_quantum_us.value,
        );
        for of in ExecutionType::ALL {
            let paper = self.results.paper.as_ref().and_then(|paper| paper.get(of).copied());
            if let (Some(found), Some(paper)) = (self.results.figure(of), paper) {
                let PaperFigure { aet_ms, mad_ms } = paper;
                let _ = writeln!(
                    text,
                    "# {of}: AET {:.1} ms (paper {aet_ms}), MAD {:.1} ms (paper {mad_ms})",
                    found.aet_ms, found.mad_ms
                );
            }
        }
        text
    }
}
