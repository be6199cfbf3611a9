//! LIN force: along a line until the contact force is reached, and then holding it.
//!
//! The arm is moved cycle by cycle, by one law for approach and contact. Its velocity along the line is the smallest of
//!
//! - what is programmed, by the override,
//! - the velocity from which it can stop within the rest of the line,
//! - in contact, what it can stop from before the force is reached on the stiffest surface that it is set for, and
//! - in contact, the admittance: [`SHARE`] of what would reach that force on that surface within one cycle.
//!
//! On a surface of stiffness k the last one reduces the error of the force by the factor 1 − `SHARE`·k/k_stiffest per
//! cycle. So the loop is stable and does not overshoot for any k up to the stiffest; a softer surface makes it slower.
//! Stops are computed with [`JERK_SHARE`] of the arm's jerk; the rest is needed to follow that curve. Velocity,
//! acceleration and jerk along the line keep their limits all the time, and so every axis keeps its own.
//!
//! *Done* means: the force was within its tolerance for the whole settling time, and the arm came to rest. It is held
//! from then on, also in `Ready`, until the robot starts the next motion, halts or loses its connection; then the arm
//! stays where it is. Held or not, it never leaves the line. An end of the line without the force is an error, and so is
//! a force that swings about the one to be reached, as on a surface that is much stiffer than the stiffest.

use protocol::image::Motion;

use crate::arm::{Arm, Frame, Joints, LEAST_WAY_MM, Violation, distance, dot, length};
use crate::motion::{Curve, Limits, Segment, next_change};
use crate::{ForceControl, RobotConfig};

/// Share of the remaining path to the programmed force, on the stiffest surface, that one cycle covers.
const SHARE: f64 = 0.25;

/// Share of the jerk with which stops are computed.
const JERK_SHARE: f64 = 0.25;

/// Share of the path's jerk for the force. The path before may end with a cycle, and the force begin two later: the end of that
/// braking still counts with a sixth of its jerk in the differences of that cycle.
const AFTER_A_PATH: f64 = 5.0 / 6.0;

/// Cycles from the one that enters a surface to the first one that is slowed by what was felt there, and one more.
const BLIND_CYCLES: f64 = 2.0;

/// Largest angle between force and line, in degrees; rounding of frames causes less.
const MOST_ASTRAY_DEG: f64 = 5.0;

/// Distance in mm at which the arm counts as being at an end of the line. Without it, the remaining path would shrink
/// forever.
const AT_END_MM: f64 = 1e-3;

/// How often the force may swing from too little to too much. On no surface up to the stiffest does it do so at all.
const MOST_SWINGS: u32 = 10;

/// Where a press stands.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Phase {
    /// Until the motions before it are executed.
    Waiting,
    /// On its way, or settling.
    Pressing,
    /// Done: the force is held.
    Holding,
}

/// What a cycle of pressing came to.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Outcome {
    /// It goes on.
    Open,
    /// The force is there.
    Reached,
    /// The arm came to an end of the line without it, or it does not settle.
    Missed(Violation),
}

/// A LIN force and how far it is.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Press {
    pub(super) phase: Phase,
    /// Its line.
    curve: Curve,
    /// What is allowed along it.
    limits: Limits,
    /// The tool in the flange.
    pub(super) tool: Frame,
    /// The root in the base.
    pub(super) base_inverse: Frame,
    /// The unit vector along it, in the root.
    direction: [f64; 3],
    wanted_n: f64,
    control: ForceControl,
    cycle_s: f64,
    /// Way along the line in mm, and its derivatives.
    way: f64,
    speed: f64,
    acceleration: f64,
    /// Cycles in a row within the tolerance.
    settled: u32,
    swings: Swings,
}

/// How the force swings about the one to be reached.
#[derive(Clone, Copy, PartialEq, Default, Debug)]
struct Swings {
    /// Whether it was too little when it was last beyond the tolerance.
    was_less: bool,
    /// How often it went from too little to too much.
    count: u32,
    highest_n: f64,
}

impl Swings {
    /// Takes the force of a cycle, and how much of it is missing where that is more than the tolerance.
    fn take(&mut self, found_n: f64, missing_n: Option<f64>) {
        self.highest_n = self.highest_n.max(found_n);
        let Some(missing_n) = missing_n else { return };
        self.count += u32::from(self.was_less && missing_n < 0.0);
        self.was_less = missing_n > 0.0;
    }
}

/// Creates the pressing part of a checked motion, if it has one.
pub(super) fn of(
    motion: &Motion,
    segment: &Segment,
    config: &RobotConfig,
) -> Result<Option<Press>, Violation> {
    match config.force.filter(|_| motion.kind.has_force()) {
        Some(control) => Press::new(motion, segment, control, config.cycle.as_secs_f64()).map(Some),
        None => Ok(None),
    }
}

impl Press {
    fn new(
        motion: &Motion,
        segment: &Segment,
        control: ForceControl,
        cycle_s: f64,
    ) -> Result<Self, Violation> {
        let ends = [0.0, segment.curve.length()].map(|way| segment.curve.position(way));
        let [Some(from), Some(to)] = ends else { return Err(Violation::Kind(motion.kind.into())) };
        let way_mm = distance(from, to);
        if way_mm < LEAST_WAY_MM {
            return Err(Violation::ZeroLength { way_mm });
        }
        let direction: [f64; 3] = core::array::from_fn(|i| (to[i] - from[i]) / way_mm);
        let force = segment.base_inverse.inverse().rotation.rotate(motion.auxiliary.map(f64::from));
        let (wanted_n, limit_n) = (length(force), control.max_n);
        if !(wanted_n > 0.0 && wanted_n <= limit_n) {
            return Err(Violation::Force { value_n: wanted_n, limit_n });
        }
        let angle_deg = libm::acos((dot(force, direction) / wanted_n).clamp(-1.0, 1.0)).to_degrees();
        if angle_deg > MOST_ASTRAY_DEG {
            return Err(Violation::ForceDirection { angle_deg, limit_deg: MOST_ASTRAY_DEG });
        }
        let limits = segment.steady_limits();
        // Along the line the axes may allow less than the force's own limit.
        let jerk_mm_s3 = control.jerk_mm_s3.min(AFTER_A_PATH * limits.jerk);
        let control = ForceControl { jerk_mm_s3, ..control };
        let press = Self {
            phase: Phase::Waiting,
            curve: segment.curve,
            limits,
            tool: segment.tool,
            base_inverse: segment.base_inverse,
            direction,
            wanted_n,
            control,
            cycle_s,
            way: 0.0,
            speed: 0.0,
            acceleration: 0.0,
            settled: 0,
            swings: Swings::default(),
        };
        let (value, limit) = (limits.speed, press.fastest_approach());
        if value > limit {
            let stiffness_n_per_mm = control.stiffest_n_per_mm;
            return Err(Violation::Approach { value, limit, force_n: wanted_n, stiffness_n_per_mm });
        }
        Ok(press)
    }

    /// Returns the highest speed, in mm/s, from which the arm stops before the stiffest surface presses with the
    /// programmed force.
    fn fastest_approach(&self) -> f64 {
        let depth_mm = self.wanted_n / self.control.stiffest_n_per_mm;
        let (mut slow, mut fast) = (0.0, self.limits.speed.max(1.0) * 2.0);
        for _ in 0..40 {
            let middle = (slow + fast) / 2.0;
            let blind_mm = BLIND_CYCLES * self.cycle_s * middle;
            if middle <= self.stops_within(depth_mm - blind_mm) { slow = middle } else { fast = middle }
        }
        slow
    }

    /// Returns the speed in mm/s from which the arm stops within `way` mm.
    fn stops_within(&self, way: f64) -> f64 {
        let way = way.max(0.0);
        let by_jerk = libm::cbrt(way * way * self.control.jerk_mm_s3 * JERK_SHARE);
        by_jerk.min((self.limits.acceleration * way).sqrt())
    }

    /// Returns the force of the tool along the line, in N, when the surfaces press on it with `force`.
    fn along(&self, force: [f64; 3]) -> f64 {
        0.0 - dot(force, self.direction)
    }

    /// Moves the arm for one cycle, with `share` (0…1) of its speed, against surfaces that press on it with `force` now.
    pub(super) fn step(
        &mut self,
        share: f64,
        force: [f64; 3],
        arm: &Arm,
        near: &Joints,
    ) -> Result<Joints, Violation> {
        let wanted = if share > 0.0 { self.wanted_speed(share, self.along(force)) } else { 0.0 };
        self.change_speed(wanted);
        if self.speed == 0.0 {
            return Ok(*near);
        }
        self.way = (self.way + self.speed * self.cycle_s).clamp(0.0, self.curve.length());
        self.curve.joints(self.way, arm, near)
    }

    fn wanted_speed(&self, share: f64, pressing_n: f64) -> f64 {
        let missing_n = self.wanted_n - pressing_n;
        // Half of the tolerance, so that the force settles well within it.
        if missing_n.abs() <= self.control.tolerance_n / 2.0 {
            return 0.0;
        }
        let highest = share * self.limits.speed;
        let toward = |way: f64| (SHARE * way / self.cycle_s).min(self.stops_within(way)).min(highest);
        let stiffest = self.control.stiffest_n_per_mm;
        let left = if missing_n < 0.0 { self.way } else { self.curve.length() - self.way };
        if left < AT_END_MM {
            return 0.0;
        }
        let is_in_contact = pressing_n > 0.0;
        let by_force = missing_n.abs() / stiffest;
        toward(if is_in_contact { left.min(by_force) } else { left }).copysign(missing_n)
    }

    /// Goes to the wanted speed as fast as acceleration and jerk allow, without passing it.
    fn change_speed(&mut self, wanted: f64) {
        let (step, most) = (self.control.jerk_mm_s3 * self.cycle_s, self.limits.acceleration);
        let change = next_change(
            wanted - self.speed,
            self.acceleration * self.cycle_s,
            most * self.cycle_s,
            step * self.cycle_s,
        );
        self.acceleration = change / self.cycle_s;
        self.speed += change;
    }

    /// Returns the outcome of the pressing, now that the surfaces press with `force`.
    pub(super) fn outcome(&mut self, force: [f64; 3]) -> Outcome {
        let found_n = self.along(force);
        let missing_n = self.wanted_n - found_n;
        let within = missing_n.abs() <= self.control.tolerance_n;
        self.settled = if within { self.settled.saturating_add(1) } else { 0 };
        let is_at_rest = self.speed == 0.0;
        if is_at_rest && f64::from(self.settled) * self.cycle_s >= self.control.settling.as_secs_f64() {
            return Outcome::Reached;
        }
        self.swings.take(found_n, (!within).then_some(missing_n));
        if self.swings.count > MOST_SWINGS {
            let (highest_n, wanted_n) = (self.swings.highest_n, self.wanted_n);
            let stiffness_n_per_mm = self.control.stiffest_n_per_mm;
            return Outcome::Missed(Violation::ForceUnsteady { highest_n, wanted_n, stiffness_n_per_mm });
        }
        // With too much force the arm moves back, towards the other end of the line.
        let way_mm = if found_n > self.wanted_n { 0.0 } else { self.curve.length() };
        let is_there = (way_mm - self.way).abs() < AT_END_MM && self.speed.abs() < AT_END_MM / self.cycle_s;
        if is_there && !within {
            return Outcome::Missed(Violation::ForceNotReached { found_n, wanted_n: self.wanted_n, way_mm });
        }
        Outcome::Open
    }

    /// Starts the settling time anew: the motion is suspended.
    pub(super) const fn unsettle(&mut self) {
        self.settled = 0;
    }
}
