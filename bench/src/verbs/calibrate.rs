//! Finds the numbers of a setup that only the paper's Table 2 can fix, in virtual time.
//!
//! Each figure depends on one number more than on the others, so they are found in turn: the controller's time quantum
//! from the MADs of RC and SM, the programmed speed from RC's AET, the cost of a skill call from SM's AET. The quantum
//! has two figures to meet; it gets the least sum of squared relative errors. Where the setup gives the start of a
//! program a quantum of its own, each has its figure: the start RC's MAD, the motion SM's.
//!
//! It goes on as long as that brings it closer, so that a setup with numbers that it found keeps them.

use std::fmt::Write as _;

use anyhow::{Context, bail};
use clap::Args;
use planning::Application;
use plc_node::ExecutionType;
use setup::Setup;

use crate::out;
use crate::output::errln;
use crate::output::exit::{Exit, Failure};
use crate::records::calibrated::{QUANTUM, SKILL_OVERHEAD, START_QUANTUM, VELOCITY};
use crate::records::results::{PaperFigure, Results};
use crate::records::schedule::{REPETITIONS, SEED, Schedule};
use crate::stands::virtual_run;
use crate::verbs::setup_option::SetupOption;

/// The MAD of 25 repetitions is known to a sixth of itself only; the quantum is found from this many times as many.
const MAD_REPETITIONS: u32 = 8;

/// So much of itself a MAD of that many repetitions may be off, in nineteen of twenty cases. No other quantum is looked for
/// where the setup's own is that close.
const MAD_KNOWN_TO: f64 = 0.12;

/// How far the search for a speed goes in one step, as a factor, and how often it then halves the interval.
const STRIDE: f64 = 1.15;
const HALVINGS: usize = 10;

/// Slower programs are not looked at.
const LEAST_PERCENT: f64 = 0.5;

/// Options of a calibration.
#[derive(Args, Debug)]
pub struct CalibrateOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// Repetitions of each execution type that a step averages over.
    #[arg(long, value_name = "N", default_value_t = REPETITIONS, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub reps: u32,
    /// Seed of the clocks and phases.
    #[arg(long, value_name = "N", default_value_t = SEED)]
    pub seed: u64,
}

/// Calibrates a setup and prints the numbers that were found.
///
/// # Errors
///
/// The setup or its application cannot be used, or the paper has no figures for it.
pub fn run(options: &CalibrateOptions) -> Result<Exit, Failure> {
    let (setup, found) = options.setup.load()?;
    found.plan(&setup)?;
    let progress = |text: &str| errln!("{text}");
    let found = calibrate(&setup, &found.application, options.reps, options.seed, progress)?;
    out!("{}", found.report());
    Ok(Exit::Pass)
}

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
    // All types, as in the table: the phases of one type's repetitions depend on what ran between them.
    let run = |setup: &Setup| {
        virtual_run::whole(setup, application, &Schedule::new(&ExecutionType::ALL, reps, seed))
    };
    let mads = |setup: &Setup| {
        let plan = Schedule::new(
            &[ExecutionType::Rc, ExecutionType::Sm],
            reps.saturating_mul(MAD_REPETITIONS),
            seed,
        );
        virtual_run::whole(setup, application, &plan)
    };
    if setup.robot.start_quantum_us.is_some() {
        // SM's motions are no starts, so its MAD knows nothing of the start's quantum: two searches, one after the other.
        let sm = [(ExecutionType::Sm, paper.sm.mad_ms)];
        setup = with_quantum(QUANTUM, &sm, setup, interpreter, &mads, &mut progress)?;
        let rc = [(ExecutionType::Rc, paper.rc.mad_ms)];
        setup = with_quantum(START_QUANTUM, &rc, setup, start, &mads, &mut progress)?;
    } else {
        let both = [(ExecutionType::Rc, paper.rc.mad_ms), (ExecutionType::Sm, paper.sm.mad_ms)];
        setup = with_quantum(QUANTUM, &both, setup, interpreter, &mads, &mut progress)?;
    }

    // RC pays the overhead once, and SM's motions have RC's speed: each round takes back what the other did. Motions end on
    // the controller's quantum, so the AETs go up in steps and no round need meet them better than the one before.
    let motions = planning::plan(application, &setup)?.motions.len();
    let calls = f64::from(u32::try_from(motions).unwrap_or(u32::MAX));
    let mut best = Calibration { results: run(&setup)?, setup };
    loop {
        let mut trial = best.setup.clone();
        let velocity_percent = falling_to(paper.rc.aet_ms, trial.motions.velocity_percent.value, |percent| {
            trial.motions.velocity_percent.value = percent;
            aet(&run(&trial)?, ExecutionType::Rc)
        });
        let velocity_percent = velocity_percent.context("cannot calibrate the speed on RC's AET")?;
        trial.motions.velocity_percent.value = (velocity_percent * 1_000.0).round() / 1_000.0;

        let missing_us = (paper.sm.aet_ms - aet(&run(&trial)?, ExecutionType::Sm)?) * 1_000.0 / calls;
        let overhead = f64::from(trial.robot.skill_overhead_us.value) + missing_us;
        if overhead < 0.0 {
            bail!("SM takes longer than the paper's even without any overhead of a skill call");
        }
        trial.robot.skill_overhead_us.value = overhead.round() as u32;
        let found = Calibration { results: run(&trial)?, setup: trial };
        progress(&format!(
            "{VELOCITY} = {}, {SKILL_OVERHEAD} = {}: AET of RC {:.1} ms, of SM {:.1} ms",
            found.setup.motions.velocity_percent.value,
            found.setup.robot.skill_overhead_us.value,
            aet(&found.results, ExecutionType::Rc)?,
            aet(&found.results, ExecutionType::Sm)?,
        ));
        let off = |of: &Calibration| -> anyhow::Result<f64> {
            let rc = aet(&of.results, ExecutionType::Rc)? / paper.rc.aet_ms - 1.0;
            let sm = aet(&of.results, ExecutionType::Sm)? / paper.sm.aet_ms - 1.0;
            Ok(libm::hypot(rc, sm))
        };
        if off(&found)? >= off(&best)? {
            return Ok(best);
        }
        best = found;
    }
}

fn aet(results: &Results, of: ExecutionType) -> anyhow::Result<f64> {
    Ok(results.figure(of).context("no sample")?.aet_ms)
}

/// Where a setup has a quantum in µs, if it has it.
type Quantum = fn(&mut Setup) -> Option<&mut u32>;

fn interpreter(setup: &mut Setup) -> Option<&mut u32> {
    Some(&mut setup.robot.interpreter_quantum_us.value)
}

fn start(setup: &mut Setup) -> Option<&mut u32> {
    setup.robot.start_quantum_us.as_mut().map(|start| &mut start.value)
}

/// The setup with the quantum whose MADs differ least from the `wanted` ones (in ms), found in coarse and then in fine steps;
/// with its own one where nobody could tell them from those.
fn with_quantum(
    key: &str,
    wanted: &[(ExecutionType, f64)],
    mut setup: Setup,
    quantum: Quantum,
    run: &impl Fn(&Setup) -> anyhow::Result<Results>,
    progress: &mut impl FnMut(&str),
) -> anyhow::Result<Setup> {
    let mut error_of = |setup: &mut Setup, quantum_us: u32| -> anyhow::Result<f64> {
        if let Some(quantum) = quantum(setup) {
            *quantum = quantum_us;
        }
        let results = run(setup)?;
        let mad = |of| results.figure(of).map_or(0.0, |figure| figure.mad_ms);
        let (rc, sm) = (mad(ExecutionType::Rc), mad(ExecutionType::Sm));
        progress(&format!("{key} = {quantum_us}: MAD of RC {rc:.1} ms, of SM {sm:.1} ms"));
        let off = |(of, wanted): &(ExecutionType, f64)| mad(*of) / wanted - 1.0;
        Ok(wanted.iter().map(off).map(|off| off * off).sum())
    };
    let own = quantum(&mut setup).map_or(0, |quantum| *quantum);
    if error_of(&mut setup, own)? <= wanted.len() as f64 * MAD_KNOWN_TO * MAD_KNOWN_TO {
        return Ok(setup);
    }
    let mut best = (f64::INFINITY, 0_u32);
    for (step, reach) in [(8_000, 40_000), (2_000, 6_000), (500, 1_500)] {
        let (middle, first) = (best.1, best.1.saturating_sub(reach));
        for quantum_us in (first..=middle + reach).step_by(step).filter(|quantum_us| *quantum_us != middle) {
            let error = error_of(&mut setup, quantum_us)?;
            if error < best.0 {
                best = (error, quantum_us);
            }
        }
    }
    if let Some(quantum) = quantum(&mut setup) {
        *quantum = best.1;
    }
    Ok(setup)
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
        if let Some(start) = &self.setup.robot.start_quantum_us {
            let _ = writeln!(
                text,
                "start_quantum_us = {{ value = {}, from = \"calibrated\", note = \"MAD of RC; bench calibrate\" }}\n",
                start.value,
            );
        }
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
    use crate::records::conditions::Measured;
    use crate::records::mode::Mode;
    use std::time::Duration;

    #[test]
    fn a_quantum_whose_mads_are_as_good_as_the_wanted_ones_is_kept_and_a_worse_one_is_bettered() {
        let setup = setup::setup("A").unwrap();
        // A MAD of a thousandth of the quantum.
        let run = |setup: &Setup| {
            let plan = Schedule::new(&[ExecutionType::Sm], 2, 1);
            let mut results = Results::new(setup, "of a test", Mode::Virtual, &plan);
            let mad = Duration::from_nanos(setup.robot.interpreter_quantum_us.value.into());
            for execution in [Duration::from_secs(1) - mad, Duration::from_secs(1) + mad] {
                let measured = Measured::lasting(execution);
                results.record(ExecutionType::Sm, &measured).unwrap();
            }
            Ok(results)
        };
        let wanted = [(ExecutionType::Sm, 0.012)];
        for (own, kept) in [(12_000, true), (13_000, true), (11_200, true), (14_000, false), (0, false)] {
            let mut setup = setup.clone();
            setup.robot.interpreter_quantum_us.value = own;
            let found =
                with_quantum("quantum", &wanted, setup, interpreter, &run, &mut |_: &str| {}).unwrap();
            assert_eq!(found.robot.interpreter_quantum_us.value, if kept { own } else { 12_000 });
        }
    }

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
