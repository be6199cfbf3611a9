//! The arm of a setup, or another one of its kind: the laws must hold for any.

use super::dice::Dice;
use crate::case::{Arm, Frame};
use crate::kinematics::{Joints, Links};

/// How far a random arm's speeds, accelerations and jerks are from the setup's, as a factor.
const RATED: [f64; 2] = [0.1, 6.0];

/// The share of tools that reach far.
const LONG_TOOL: f64 = 0.15;

/// The share of joints whose offset is any angle.
const ANY_OFFSET: f64 = 0.25;

/// How near to the ends of its range a joint may be at the start, as a share of the range.
const MARGIN: f64 = 0.1;

/// An arm of the same kind with other links, ranges and limits.
pub(super) fn another(dice: &mut Dice, arm: &Arm) -> Arm {
    let (links, ranges) = match arm.links {
        Links::Scara { .. } => scara(dice),
        Links::SixAxes { .. } => six_axes(dice),
        Links::ThreeParallel { .. } => three_parallel(dice),
    };
    let mut rated = |limits: &[f64]| -> Vec<f64> {
        limits.iter().map(|limit| limit * dice.scale(RATED[0], RATED[1])).collect()
    };
    let [speed_deg_s, acceleration_deg_s2, jerk_deg_s3] =
        [&arm.speed_deg_s, &arm.acceleration_deg_s2, &arm.jerk_deg_s3].map(|limits| rated(limits));
    let home_deg = ranges.iter().map(|(lower, upper)| f64::midpoint(*lower, *upper)).collect();
    let (lower_deg, upper_deg) = ranges.into_iter().unzip();
    Arm { links, lower_deg, upper_deg, speed_deg_s, acceleration_deg_s2, jerk_deg_s3, home_deg }
}

type Ranges = Vec<(f64, f64)>;

fn scara(dice: &mut Dice) -> (Links, Ranges) {
    let links = Links::Scara {
        link_1_mm: dice.scale(120.0, 500.0),
        link_2_mm: dice.scale(120.0, 500.0),
        height_mm: dice.between(-100.0, 300.0),
    };
    let mut either = |least: f64, most: f64| (-dice.between(least, most), dice.between(least, most));
    let mut ranges = vec![either(70.0, 175.0), either(70.0, 160.0), (0.0, 0.0), either(180.0, 720.0)];
    let lowest = dice.between(-100.0, 100.0);
    ranges[2] = (lowest, lowest + dice.between(80.0, 400.0));
    (links, ranges)
}

fn three_parallel(dice: &mut Dice) -> (Links, Ranges) {
    let forward = if dice.chance(0.5) { 1.0 } else { -1.0 };
    let links = Links::ThreeParallel {
        d_mm: [
            dice.between(80.0, 300.0),
            dice.between(60.0, 200.0),
            dice.between(60.0, 150.0),
            dice.between(40.0, 150.0),
        ],
        a_mm: [forward * dice.scale(200.0, 700.0), forward * dice.scale(200.0, 700.0)],
        offsets_deg: core::array::from_fn(|_| offset(dice)),
        signs: core::array::from_fn(|_| if dice.chance(0.3) { -1 } else { 1 }),
    };
    let [least, most] = if dice.chance(0.4) { [90.0, 200.0] } else { [200.0, 400.0] };
    let ranges = (0..6).map(|_| (-dice.between(least, most), dice.between(least, most))).collect();
    (links, ranges)
}

/// The angle of a joint that stands at 0: a right one as a rule, or any.
fn offset(dice: &mut Dice) -> f64 {
    if dice.chance(ANY_OFFSET) {
        return dice.between(-180.0, 180.0).round();
    }
    [0.0, 0.0, 0.0, 90.0, -90.0, 180.0][dice.below(6)]
}

fn six_axes(dice: &mut Dice) -> (Links, Ranges) {
    let or_none = |dice: &mut Dice, most: f64| if dice.chance(0.5) { 0.0 } else { dice.between(-most, most) };
    let mut offsets_deg = [0.0; 6];
    let mut signs = [1; 6];
    for axis in 0..6 {
        offsets_deg[axis] = offset(dice);
        signs[axis] = if dice.chance(0.3) { -1 } else { 1 };
    }
    let links = Links::SixAxes {
        a1_mm: or_none(dice, 120.0).abs(),
        a2_mm: or_none(dice, 60.0),
        b_mm: or_none(dice, 40.0),
        c1_mm: dice.between(200.0, 500.0),
        c2_mm: dice.scale(150.0, 500.0),
        c3_mm: dice.scale(150.0, 500.0),
        c4_mm: dice.between(20.0, 120.0),
        offsets_deg,
        signs,
    };
    // Ranges of the upright model: the joints' own follow from offsets and signs.
    let model =
        [(150.0, 230.0), (80.0, 130.0), (60.0, 200.0), (150.0, 300.0), (100.0, 130.0), (200.0, 500.0)];
    let ranges = (0..6).map(|axis| {
        let (least, most) = model[axis];
        let (lower, upper) = (-dice.between(least, most), dice.between(least, most));
        let joint = |angle: f64| (angle + offsets_deg[axis]) * f64::from(signs[axis]);
        (joint(lower).min(joint(upper)), joint(lower).max(joint(upper)))
    });
    let ranges = ranges.collect();
    (links, ranges)
}

/// Joints anywhere within their ranges, not at the ends and not stretched out.
pub(super) fn anywhere(dice: &mut Dice, arm: &Arm) -> Joints {
    let mut joints = [0.0; 6];
    for (axis, joint) in joints.iter_mut().enumerate().take(arm.links.axes()) {
        *joint = within(dice.between(MARGIN, 1.0 - MARGIN), arm, axis);
    }
    joints
}

/// A joint at a share of its range.
pub(super) fn within(share: f64, arm: &Arm, axis: usize) -> f64 {
    let (lower, upper) = (arm.lower_deg[axis], arm.upper_deg[axis]);
    lower + share * (upper - lower)
}

/// Tools 1 and 2. An arm that holds its tool upright has upright tools.
pub(super) fn tools(dice: &mut Dice, arm: &Arm) -> Vec<Frame> {
    let is_upright = arm.links.axes() == 4;
    let tool = |number: u8| {
        // Grippers as a rule, or a long tool.
        let far = if dice.chance(LONG_TOOL) { 300.0 } else { 60.0 };
        let mut at = |most: f64| dice.between(-most, most);
        let [b, c] = if is_upright { [0.0, 0.0] } else { [at(60.0), at(60.0)] };
        Frame { number, mm_deg: [at(far), at(far), far + at(far), at(180.0), b, c].map(f64::round) }
    };
    (1..=2).map(tool).collect()
}

/// Bases 1 and 2.
pub(super) fn bases(dice: &mut Dice, arm: &Arm) -> Vec<Frame> {
    let is_upright = arm.links.axes() == 4;
    let base = |number: u8| {
        let mut at = |most: f64| dice.between(-most, most);
        let [b, c] = if is_upright { [0.0, 0.0] } else { [at(90.0), at(180.0)] };
        Frame { number, mm_deg: [at(400.0), at(400.0), at(200.0), at(180.0), b, c].map(f64::round) }
    };
    (1..=2).map(base).collect()
}
