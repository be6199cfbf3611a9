//! The least case that still breaks the same law.

use setup::Setup;

use crate::case::{Arm, Case, Event, Execution, Run};
use crate::driver;
use crate::violation::{Class, Violation};

/// Largest number of smaller cases that are run.
const TRIES: u32 = 3_000;

/// Makes a case smaller, as long as the first law that it breaks stays of the same class. Returns it with what it breaks.
#[must_use]
pub fn shrink(case: &Case, violation: &Violation, setup: &Setup, classes: &[Class]) -> (Case, Violation) {
    let mut shrinker =
        Shrinker { best: case.clone(), violation: violation.clone(), setup, classes, tries: 0 };
    loop {
        let before = shrinker.best.clone();
        shrinker.leave_out();
        shrinker.simplify();
        if shrinker.best == before || shrinker.tries >= TRIES {
            return (shrinker.best, shrinker.violation);
        }
    }
}

struct Shrinker<'a> {
    best: Case,
    violation: Violation,
    setup: &'a Setup,
    classes: &'a [Class],
    tries: u32,
}

impl Shrinker<'_> {
    /// Keeps a changed case if it breaks the same law.
    fn try_with(&mut self, change: impl FnOnce(&mut Case)) -> bool {
        if self.tries >= TRIES {
            return false;
        }
        let mut changed = self.best.clone();
        change(&mut changed);
        if changed == self.best {
            return false;
        }
        self.tries += 1;
        let found =
            driver::run(&changed, self.setup, self.classes).ok().and_then(|outcome| outcome.violation);
        let Some(violation) = found.filter(|found| found.class == self.violation.class) else { return false };
        (self.best, self.violation) = (changed, violation);
        true
    }

    /// The same for a run.
    fn try_run(&mut self, index: usize, change: impl FnOnce(&mut Run)) -> bool {
        self.try_with(|case| {
            if let Some(run) = case.runs.get_mut(index) {
                change(run);
            }
        })
    }

    /// Runs, motions and events that are not needed.
    fn leave_out(&mut self) {
        for index in (0..self.best.runs.len()).rev() {
            if self.best.runs.len() > 1 {
                self.try_with(|case| {
                    case.runs.remove(index);
                });
            }
        }
        for index in 0..self.best.runs.len() {
            self.halve_motions(index);
            for event in (0..self.best.runs[index].events.len()).rev() {
                self.try_run(index, |run| {
                    run.events.remove(event);
                });
            }
        }
        self.try_with(|case| case.surfaces.clear());
    }

    /// Leaves out motions: half of them, a quarter, down to one by one.
    fn halve_motions(&mut self, index: usize) {
        let mut size = self.best.runs[index].motions.len().div_ceil(2);
        loop {
            let mut end = self.best.runs[index].motions.len();
            while end > 0 {
                let start = end.saturating_sub(size);
                if end - start < self.best.runs[index].motions.len() {
                    self.try_run(index, |run| {
                        run.motions.drain(start..end);
                    });
                }
                end = start;
            }
            if size <= 1 {
                return;
            }
            size = size.div_ceil(2);
        }
    }

    /// Makes a case plainer: the setup's own arm, no delays, round numbers.
    fn simplify(&mut self) {
        let own = Arm::of(self.setup);
        self.try_with(|case| case.arm = Arm { home_deg: case.arm.home_deg.clone(), ..own });
        self.try_with(|case| case.controller = None);
        self.try_with(|case| case.skill_overhead_ms = 0);
        self.try_with(|case| case.seed = 0);
        for digits in [0, 1, 3] {
            let plainer = |joints: &[f64]| joints.iter().map(|joint| rounded(*joint, digits)).collect();
            self.try_with(|case| case.arm.home_deg = plainer(&case.arm.home_deg));
        }
        for run in 0..self.best.runs.len() {
            self.try_run(run, |run| run.execution = Execution::Continuous);
            for event in 0..self.best.runs[run].events.len() {
                for cycle in [1, 10, 50] {
                    self.try_run(run, |run| sooner(&mut run.events, event, cycle));
                }
            }
            for motion in 0..self.best.runs[run].motions.len() {
                self.simplify_motion(run, motion);
            }
        }
        self.leave_out_frames();
    }

    fn simplify_motion(&mut self, run: usize, motion: usize) {
        let mut change = |change: &dyn Fn(&mut crate::case::Programmed)| {
            self.try_run(run, |run| {
                if let Some(motion) = run.motions.get_mut(motion) {
                    change(motion);
                }
            })
        };
        change(&|motion| motion.written_in_cycle = 0);
        change(&|motion| motion.deceleration = 0);
        change(&|motion| motion.jerk = 0);
        for zone in [0, 100, 500, 1_000, 2_000, 5_000] {
            if change(&|motion| motion.approximation = zone) {
                break;
            }
        }
        for (velocity, acceleration) in [(10_000, 5_000), (5_000, 2_000), (2_500, 5_000)] {
            if change(&|motion| (motion.velocity, motion.acceleration) = (velocity, acceleration)) {
                break;
            }
        }
        for digits in [0, 1, 2, 3] {
            let whole = change(&|motion| {
                motion.target = motion.target.map(|part| rounded(part.into(), digits) as f32);
                motion.auxiliary = motion.auxiliary.map(|part| rounded(part.into(), digits) as f32);
            });
            if whole {
                break;
            }
            for coordinate in 0..6 {
                change(&|motion| {
                    motion.target[coordinate] = rounded(motion.target[coordinate].into(), digits) as f32;
                });
            }
        }
    }

    /// Frames that no motion uses.
    fn leave_out_frames(&mut self) {
        self.try_with(|case| {
            let motions = case.runs.iter().flat_map(|run| &run.motions);
            let (tools, bases): (Vec<u8>, Vec<u8>) = motions.map(|motion| (motion.tool, motion.base)).unzip();
            case.tools.retain(|frame| tools.contains(&frame.number));
            case.bases.retain(|frame| bases.contains(&frame.number));
        });
    }
}

fn rounded(value: f64, digits: u32) -> f64 {
    let unit = f64::from(10_u32.pow(digits));
    (value * unit).round() / unit
}

/// Lets an event happen some cycles sooner, and all that follow.
fn sooner(events: &mut [Event], index: usize, cycles: u32) {
    let before = index.checked_sub(1).and_then(|before| events.get(before)).map_or(0, |event| event.cycle);
    let Some(this) = events.get(index).map(|event| event.cycle) else { return };
    let by = cycles.min(this.saturating_sub(before));
    for event in events.iter_mut().skip(index) {
        event.cycle -= by;
    }
}
