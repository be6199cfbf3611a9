//! Finds the three numbers of a setup that only the paper's Table 2 can fix, in virtual time.
//!
//! Each figure depends on one number more than on the others, so they are found in turn: the controller's time quantum
//! from the MADs of RC and SM, the programmed speed from RC's AET, the cost of a skill call from SM's AET. The quantum
//! has two figures to meet; it gets the least sum of squared relative errors.

use std::fmt::Write as _;

use anyhow::{Context, bail};
use planning::Application;
use plc_node::ExecutionType;
use setup::Setup;

use crate::plan::Plan;
use crate::results::{PaperFigure, QUANTUM, Results, SKILL_OVERHEAD, VELOCITY};
use crate::virtual_run;

/// The MAD of 25 repetitions is known to a sixth of itself only; the quantum is found from this many times as many.
const MAD_REPETITIONS: u32 = 8;

/// Rounds over speed and overhead.
const ROUNDS: usize = 3;

/// How far the search for a speed goes in one step, as a factor, and how often it then halves the interval.
const STRIDE: f64 = 1.15;
const HALVINGS: usize = 10;

/// Slower programs are not looked at.
const LEAST_PERCENT: f64 = 0.5;

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
    let mads = |setup: &Setup| {
        let plan =
            Plan::new(&[ExecutionType::Rc, ExecutionType::Sm], reps.saturating_mul(MAD_REPETITIONS), seed);
        virtual_run::whole(setup, application, &plan)
    };
    setup.robot.interpreter_quantum_us.value = quantum(&setup, &paper, &mads, &mut progress)?;

    // RC pays the overhead once, and SM's motions have RC's speed: each round takes back what the other did.
    let motions = planning::plan(application, &setup)?.motions.len();
    let calls = f64::from(u32::try_from(motions).unwrap_or(u32::MAX));
    for _ in 0..ROUNDS {
        let mut trial = setup.clone();
        let velocity_percent = falling_to(paper.rc.aet_ms, setup.motions.velocity_percent.value, |percent| {
            trial.motions.velocity_percent.value = percent;
            aet(&trial, ExecutionType::Rc)
        });
        let velocity_percent = velocity_percent.context("cannot calibrate the speed on RC's AET")?;
        setup.motions.velocity_percent.value = (velocity_percent * 1_000.0).round() / 1_000.0;
        progress(&format!("{VELOCITY} = {}", setup.motions.velocity_percent.value));

        let missing_us = (paper.sm.aet_ms - aet(&setup, ExecutionType::Sm)?) * 1_000.0 / calls;
        let overhead = f64::from(setup.robot.skill_overhead_us.value) + missing_us;
        if overhead < 0.0 {
            bail!("SM takes longer than the paper's even without any overhead of a skill call");
        }
        setup.robot.skill_overhead_us.value = overhead.round() as u32;
        progress(&format!("{SKILL_OVERHEAD} = {}", setup.robot.skill_overhead_us.value));
    }
    let results = run(&setup, &ExecutionType::ALL)?;
    Ok(Calibration { setup, results })
}

/// The quantum whose MADs differ least from the paper's, found in coarse and then in fine steps.
fn quantum(
    setup: &Setup,
    paper: &setup::Paper,
    run: &impl Fn(&Setup) -> anyhow::Result<Results>,
    progress: &mut impl FnMut(&str),
) -> anyhow::Result<u32> {
    let mut trial = setup.clone();
    let mut error_of = |quantum_us: u32| -> anyhow::Result<f64> {
        trial.robot.interpreter_quantum_us.value = quantum_us;
        let results = run(&trial)?;
        let mad = |of| results.figure(of).map_or(0.0, |figure| figure.mad_ms);
        let (rc, sm) = (mad(ExecutionType::Rc), mad(ExecutionType::Sm));
        progress(&format!("{QUANTUM} = {quantum_us}: MAD of RC {rc:.1} ms, of SM {sm:.1} ms"));
        Ok((rc / paper.rc.mad_ms - 1.0).powi(2) + (sm / paper.sm.mad_ms - 1.0).powi(2))
    };
    let mut best = (f64::INFINITY, 0_u32);
    for (step, reach) in [(8_000, 40_000), (2_000, 6_000), (500, 1_500)] {
        let (middle, first) = (best.1, best.1.saturating_sub(reach));
        for quantum_us in (first..=middle + reach).step_by(step).filter(|quantum_us| *quantum_us != middle) {
            let error = error_of(quantum_us)?;
            if error < best.0 {
                best = (error, quantum_us);
            }
        }
    }
    Ok(best.1)
}

/// The percentage near `start` at which what falls with it falls to `wanted`. Only near it: a faster program need not
/// be faster once the joints cannot follow.
fn falling_to(
    wanted: f64,
    start: f64,
    mut value_at: impl FnMut(f64) -> anyhow::Result<f64>,
) -> anyhow::Result<f64> {
    let (mut low, mut high) = (start, start);
    while value_at(low)? <= wanted {
        (high, low) = (low, low / STRIDE);
        if low < LEAST_PERCENT {
            bail!("{wanted} ms is not reached down to {LEAST_PERCENT} %");
        }
    }
    while low == high || value_at(high)? > wanted {
        high *= STRIDE;
        if high > 100.0 {
            bail!("{wanted} ms is not reached up to 100 %");
        }
    }
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        if value_at(middle)? > wanted { low = middle } else { high = middle }
    }
    Ok(f64::midpoint(low, high))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_falling_curve_is_followed_up_and_down_to_the_wanted_value() {
        let curve = |percent: f64| Ok(1_000.0 / percent);
        for start in [1.0, 20.0, 90.0] {
            let found = falling_to(50.0, start, curve).unwrap();
            assert!((found - 20.0).abs() < 0.02, "{found}");
        }
        assert!(falling_to(5.0, 20.0, curve).is_err());
        assert!(falling_to(5_000.0, 20.0, curve).is_err());
    }
}
