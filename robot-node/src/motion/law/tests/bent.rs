//! Laws along bent paths whose derivatives are known everywhere.

use super::super::super::grid::Part;
use super::super::super::load::{Load, Ramps};
use super::super::super::node::{Node, Ratings};
use super::super::super::slopes::Slopes;
use super::super::*;
use crate::arm::AXES;

/// Largest share of the jerk that a constant speed uses.
const TWISTING: f64 = 0.9;

/// A coordinate that rises evenly and swings.
#[derive(Clone, Copy, Debug)]
struct Swing {
    rise: f64,
    wide: f64,
    often: f64,
    phase: f64,
}

impl Swing {
    /// The first, second and third derivative by the way.
    fn at(&self, way: f64) -> [f64; 3] {
        let Self { rise, wide, often, phase } = *self;
        let (sin, cos) = libm::sincos(often * way + phase);
        [rise + wide * often * cos, -wide * often * often * sin, -wide * often * often * often * cos]
    }
}

/// A path of the length 1 on which all joints and the tool swing.
#[derive(Clone, Debug)]
pub(in super::super) struct Bent {
    joints: [Swing; AXES],
    tool: [Swing; 3],
    ratings: Ratings,
    programmed: f64,
    nodes: Vec<Node>,
}

impl Bent {
    /// A path that is the same for each seed.
    pub(in super::super) fn random(seed: u32) -> Self {
        let mut drawn = 0;
        let mut between = |low: f64, high: f64| {
            drawn += 1;
            let number = 43_758.545_3 * libm::sin(12.989_8 * f64::from(drawn) + 78.233 * f64::from(seed));
            low + (high - low) * (number - number.floor())
        };
        let mut swing = |rise: f64, wide: f64| Swing {
            rise: between(-rise, rise),
            wide: between(0.1 * wide, wide),
            often: between(2.0, 9.0),
            phase: between(0.0, 6.0),
        };
        let joints = core::array::from_fn(|_| swing(80.0, 12.0));
        let tool = core::array::from_fn(|_| swing(250.0, 40.0));
        let ratings = Ratings {
            speed: [200.0; AXES],
            acceleration: [1_000.0; AXES],
            ramp_s: [0.03; AXES],
            tool_acceleration: 3_000.0,
            tool_ramp_s: 0.04,
            deceleration: 0.8,
            tool_deceleration: 0.9,
        };
        let programmed = between(1.0, 3.0);
        Self { joints, tool, ratings, programmed, nodes: Vec::new() }.with_nodes()
    }

    fn with_nodes(mut self) -> Self {
        self.nodes = (0..=96).map(|node| self.node(f64::from(node) / 96.0)).collect();
        self
    }

    /// A circle of the tool, of which joints know nothing.
    pub(super) fn circle() -> Self {
        let still = Swing { rise: 0.0, wide: 0.0, often: 1.0, phase: 0.0 };
        let swing = |phase: f64| Swing { rise: 0.0, wide: 50.0, often: 12.0, phase };
        let tool = [swing(0.0), swing(core::f64::consts::FRAC_PI_2), still];
        Self { joints: [still; AXES], tool, programmed: 100.0, ..Self::random(0) }.with_nodes()
    }

    /// The same without bends.
    pub(in super::super) fn straight(mut self) -> Self {
        self.joints.iter_mut().chain(&mut self.tool).for_each(|swing| swing.wide = 0.0);
        self.with_nodes()
    }

    /// The same with much wider swings.
    pub(super) fn rough(mut self) -> Self {
        self.joints.iter_mut().chain(&mut self.tool).for_each(|swing| swing.wide *= 8.0);
        self.with_nodes()
    }

    /// The same with this share of the programmed speed.
    pub(super) fn slower(mut self, share: f64) -> Self {
        self.programmed *= share;
        self.with_nodes()
    }

    /// The same in a time that goes faster.
    pub(in super::super) fn faster(mut self, factor: f64) -> Self {
        let Ratings { speed, acceleration, ramp_s, tool_acceleration, tool_ramp_s, .. } = &mut self.ratings;
        speed.iter_mut().for_each(|speed| *speed *= factor);
        acceleration.iter_mut().for_each(|acceleration| *acceleration *= factor * factor);
        ramp_s.iter_mut().for_each(|ramp_s| *ramp_s /= factor);
        *tool_acceleration *= factor * factor;
        *tool_ramp_s /= factor;
        self.programmed *= factor;
        self.with_nodes()
    }

    /// The same with as much acceleration for slowing down as for speeding up.
    pub(in super::super) fn even(mut self) -> Self {
        (self.ratings.deceleration, self.ratings.tool_deceleration) = (1.0, 1.0);
        self
    }

    /// The derivatives at a place, over the limits of the accelerations.
    pub(in super::super) fn slopes(&self, way: f64) -> Slopes {
        let of_joint =
            |order: usize| self.joints.map(|swing| swing.at(way)[order] / self.ratings.acceleration[0]);
        let of_tool =
            |order: usize| self.tool.map(|swing| swing.at(way)[order] / self.ratings.tool_acceleration);
        let [slope, bend, twist] = [0, 1, 2].map(of_joint);
        Slopes { slope, bend, twist, tool: [0, 1, 2].map(of_tool) }
    }

    fn node(&self, way: f64) -> Node {
        let Slopes { slope, bend, twist, tool } = self.slopes(way);
        let Ratings { speed, acceleration, ramp_s, tool_ramp_s, .. } = self.ratings;
        let length = |vector: [f64; 3]| vector.iter().map(|value| value * value).sum::<f64>().sqrt();
        let by_twist = |twist: f64, ramp_s: f64| {
            let root = libm::cbrt(TWISTING / (twist * ramp_s));
            root * root
        };
        let of_joints = (0..AXES).map(|axis| {
            let fastest = speed[axis] / (slope[axis] * acceleration[axis]);
            let twisting = by_twist(twist[axis].abs(), ramp_s[axis]);
            (fastest * fastest).min(1.0 / bend[axis].abs()).min(twisting)
        });
        let of_tool = (1.0 / length(tool[1])).min(by_twist(length(tool[2]), tool_ramp_s));
        Node {
            way,
            programmed: self.programmed,
            highest: of_joints.fold(of_tool, f64::min),
            slope: slope.map(|value| value as f32),
            bend: bend.map(|value| value as f32),
            twist: twist.map(|value| value as f32),
            tool: tool.map(|vector| vector.map(|value| value as f32)),
        }
    }

    /// The same in another unit, of which `unit` are one of its own.
    pub(super) fn in_unit(mut self, unit: f64) -> Self {
        for node in &mut self.nodes {
            node.way *= unit;
            node.programmed *= unit;
            node.highest *= unit * unit;
            let by = |value: f32, order: i32| (0..order).fold(value, |value, _| value / unit as f32);
            node.slope = node.slope.map(|value| by(value, 1));
            node.bend = node.bend.map(|value| by(value, 2));
            node.twist = node.twist.map(|value| by(value, 3));
            node.tool =
                core::array::from_fn(|order| node.tool[order].map(|value| by(value, order as i32 + 1)));
        }
        self
    }

    /// The part of it between two ways.
    pub(super) fn part(&self, from: f64, to: f64) -> Part<'_> {
        Part { nodes: &self.nodes, ratings: &self.ratings, from, to, unit: 1.0, motion: 0, in_blend: false }
    }

    /// The law of the whole path from rest to rest.
    pub(in super::super) fn law(&self) -> Box<Law> {
        law(&[self.part(0.0, 1.0)], Pace::REST).expect("there is a law from rest")
    }

    /// The same, at the begin of its refinement.
    pub(in super::super) fn law_to_refine(&self) -> Box<Law> {
        let duration = duration(&self.law());
        let mut law = Box::<Law>::default();
        law.begin_to_refine(&[self.part(0.0, 1.0)], Pace::REST, duration).expect("it can be refined");
        law
    }

    /// The shares of speed, acceleration and jerk that a pace uses at a place.
    fn used(&self, way: f64, pace: Pace, jerk: f64, slows: bool) -> [f64; 3] {
        let (slopes, ramps) = (self.slopes(way), Ramps::of(&self.ratings));
        let loads = Load::new(&slopes, [pace.square, pace.acceleration, jerk], &ramps);
        let [accelerated, jerked] = loads.most(slows, &ramps);
        let steepest = slopes.slope.iter().fold(0.0, |most: f64, slope| most.max(slope.abs()));
        let (speed, in_s) = (pace.square.sqrt(), self.ratings.acceleration[0] / self.ratings.speed[0]);
        [speed * (steepest * in_s).max(1.0 / self.programmed), accelerated, jerked]
    }
}

/// A law of these parts from a pace on.
pub(super) fn law(parts: &[Part<'_>], pace: Pace) -> Option<Box<Law>> {
    let mut law = Box::<Law>::default();
    law.find(parts, pace)?;
    Some(law)
}

/// How long these parts take at least, about, in s: what many steps of Newton's method come to.
fn least(parts: &[Part<'_>]) -> f64 {
    let mut law = Box::<Law>::default();
    law.begin_to_refine(parts, Pace::REST, 1.0).expect("there are cells enough");
    let mut weight = 60.0 * law.cells() as f64 / duration(&law);
    for _ in 0..40 {
        law.step(2, weight);
        weight *= 1.4;
    }
    law.find_paces();
    duration(&law)
}

pub(super) fn duration(law: &Law) -> f64 {
    (0..law.cells()).map(|cell| law.cell(cell).duration).sum()
}

/// The largest shares of speeds, accelerations and jerks that a law uses, over paths of which each is driven between two
/// ways.
fn most(law: &Law, paths: &[(&Bent, [f64; 2])]) -> [f64; 3] {
    let mut most = [0.0_f64; 3];
    for (number, (bent, [from, to])) in paths.iter().enumerate() {
        let end = law.begins().get(number + 1).copied().unwrap_or(law.cells());
        let mut begin = *from;
        for number in law.begins()[number]..end {
            let cell = law.cell(number);
            // Where the acceleration changes its sign in a cell, either limit holds.
            let slows = [0.0, 1.0].iter().all(|share| cell.at(share * cell.duration).1.acceleration < 0.0);
            for part in 0..=16 {
                let (way, pace) = cell.at(cell.duration * f64::from(part) / 16.0);
                let used = bent.used(begin + way, pace, cell.jerk(&pace), slows);
                // From where the arm moves the first acceleration is given.
                let used = if number == 0 && law.start.square > 0.0 { [used[0], 0.0, 0.0] } else { used };
                most = core::array::from_fn(|i| most[i].max(used[i]));
            }
            begin += cell.length;
        }
        assert!((begin - to).abs() < 1e-9, "a part ends at {begin}");
    }
    most
}

pub(super) fn is_kept(law: &Law, paths: &[(&Bent, [f64; 2])], what: &str) {
    let most = most(law, paths);
    assert!(most.iter().all(|most| *most < 1.008), "{most:?} of the limits, {what}");
}

/// Numbers of paths.
const SEEDS: u32 = 12;

/// Ratios of the duration of a law to that of the optimum, in percent more, for the whole of each path.
const MORE: [f64; SEEDS as usize] = [2.6, 1.5, 0.9, 2.8, 3.6, 3.9, 2.0, 1.2, 0.2, 0.6, 3.2, 1.6];

#[test]
fn a_law_keeps_its_limits_everywhere_and_is_near_the_optimum() {
    for (seed, more) in (0..SEEDS).zip(MORE) {
        let bent = Bent::random(seed).even();
        let law = bent.law();
        is_kept(&law, &[(&bent, [0.0, 1.0])], &format!("seed {seed}"));
        let ratio = duration(&law) / least(&[bent.part(0.0, 1.0)]);
        assert!((0.999..1.0 + more / 100.0).contains(&ratio), "{ratio} of the optimum with seed {seed}");
        let bent = Bent::random(seed);
        is_kept(&bent.law(), &[(&bent, [0.0, 1.0])], &format!("seed {seed}, with less to slow down"));
    }
}

#[test]
fn so_does_a_law_of_a_short_part() {
    for (from, to) in [(0.0, 0.02), (0.3, 0.4), (0.6, 0.9)] {
        let (mut taken, mut optimum) = (0.0, 0.0);
        for seed in 0..SEEDS {
            let bent = Bent::random(seed).even();
            let parts = [bent.part(from, to)];
            let law = law(&parts, Pace::REST).expect("there is a law from rest");
            is_kept(&law, &[(&bent, [from, to])], &format!("from {from} to {to} with seed {seed}"));
            (taken, optimum) = (taken + duration(&law), optimum + least(&parts));
        }
        let ratio = taken / optimum;
        assert!((0.999..1.021).contains(&ratio), "{ratio} of the optimum from {from} to {to}");
    }
}

#[test]
fn where_another_part_follows_the_limits_of_both_hold() {
    let (mut taken, mut optimum) = (0.0, 0.0);
    for seed in 0..SEEDS {
        let [one, other] = [seed, seed + 50].map(Bent::random);
        let ways = [0.0, 0.43, 0.37, 1.0];
        let parts = [one.part(ways[0], ways[1]), other.part(ways[2], ways[3])];
        let whole = law(&parts, Pace::REST).expect("there is a law from rest");
        is_kept(&whole, &[(&one, [ways[0], ways[1]]), (&other, [ways[2], ways[3]])], &format!("seed {seed}"));
        // The unit of the second part is another one.
        let other = other.clone().in_unit(4.0);
        let second = Part { unit: 4.0, ..other.part(4.0 * ways[2], 4.0 * ways[3]) };
        let same = law(&[parts[0], second], Pace::REST).expect("there is a law from rest");
        assert!((duration(&same) / duration(&whole) - 1.0).abs() < 1e-9, "seed {seed}");
        (taken, optimum) = (taken + duration(&whole), optimum + least(&parts));
    }
    assert!((0.999..1.06).contains(&(taken / optimum)), "{} of the optimum", taken / optimum);
}

#[test]
fn a_law_from_where_the_arm_moves_takes_as_long_as_the_rest_of_that_from_rest() {
    let (mut found, mut slower, mut none) = (0, 0, 0);
    for seed in 0..SEEDS {
        let bent = Bent::random(seed);
        let whole = bent.law();
        let (mut begin, mut left) = (0.0, duration(&whole));
        for number in 0..whole.cells() {
            let cell = whole.cell(number);
            if number % 5 == 4 && begin < 0.9 {
                match law(&[bent.part(begin, 1.0)], cell.at(0.0).1) {
                    Some(law) => {
                        let what = format!("from cell {number} with seed {seed}");
                        is_kept(&law, &[(&bent, [begin, 1.0])], &what);
                        let ratio = duration(&law) / left;
                        assert!((0.96..1.15).contains(&ratio), "{ratio} of the time, {what}");
                        (found, slower) = (found + 1, slower + usize::from(ratio > 1.01));
                    }
                    // Rarely the arm brakes so hard that the passes find no way on, or only a slower one.
                    None => none += 1,
                }
            }
            begin += cell.length;
            left -= cell.duration;
        }
    }
    assert!(found >= 160 && slower <= 8, "{found} laws, {slower} of them slower, and {none} not found");
}

/// Refines a law until its end. Returns how that ended, the number of steps and the share of the former duration.
fn refined(bent: &Bent, what: &str) -> (Progress, usize, f64) {
    let found = duration(&bent.law());
    let mut law = bent.law_to_refine();
    for steps in 1..=MOST_STEPS {
        let progress = law.refine();
        let share = duration(&law) / found;
        match progress {
            Progress::Unfinished => continue,
            Progress::Faster => {
                is_kept(&law, &[(bent, [0.0, 1.0])], what);
                assert!(share < 0.99, "{share} of the time, {what}");
            }
            Progress::Useless => {}
        }
        return (progress, steps, share);
    }
    panic!("it has not ended, {what}");
}

#[test]
fn a_refined_law_keeps_its_limits_and_is_nearly_optimal() {
    let (mut ended, mut refined_to_the_end) = (0, 0);
    for seed in 0..SEEDS {
        let bent = Bent::random(seed).even();
        let (progress, steps, share) = refined(&bent, &format!("seed {seed}"));
        let passes = duration(&bent.law()) / least(&[bent.part(0.0, 1.0)]);
        if steps == 2 {
            // The law of the passes stays.
            assert!(
                progress == Progress::Useless && (0.998..1.012).contains(&passes),
                "{passes} of the optimum with seed {seed}"
            );
            ended += 1;
            continue;
        }
        // Without repairs.
        assert_eq!(steps, 8, "seed {seed}");
        assert!(progress == Progress::Faster || share >= 0.99, "{share} of the time with seed {seed}");
        let ratio = share * passes;
        assert!((0.998..1.0065).contains(&ratio), "{ratio} of the optimum with seed {seed}");
        refined_to_the_end += 1;
    }
    assert!(ended >= 1 && refined_to_the_end >= 1, "{ended} ended soon, {refined_to_the_end} did not");
}

#[test]
fn a_refined_law_that_exceeds_a_limit_is_repaired_or_not_taken() {
    // Where the acceleration changes its sign, the limits jump.
    let ends = (0..SEEDS).map(|seed| refined(&Bent::random(seed), &format!("seed {seed}")));
    let ends: Vec<(Progress, usize, f64)> = ends.collect();
    let repaired =
        ends.iter().filter(|(progress, steps, _)| *progress == Progress::Faster && *steps > 8).count();
    let given_up =
        ends.iter().filter(|(progress, steps, _)| *progress == Progress::Useless && *steps == 12).count();
    assert!(repaired >= 2 && given_up >= 3, "{ends:?}");
}
