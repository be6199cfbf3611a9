//! How fast the tool goes on lines and circles, and the joints point to point: as programmed, times the override.
//!
//! Where the override falls, the arm is faster for a while: it slows down as its limits allow. How fast that is, is the
//! robot's affair; but once the acceleration that it had can be taken back it must not become faster than it was, except by
//! [`RISE`], or along a bend on which a joint already brakes with all that it has.

use protocol::image::{Command, Control};

use super::{Among, JOINT_NOISE, Law, SHARE, TOOL_NOISE_MM, joint};
use crate::case::Kind;
use crate::kinematics::{Pose, Vector, difference, distance, dot, length};
use crate::violation::Class;
use crate::way::Way;

/// So many cycles in a row within what the override allows, and without braking, end a slowing down.
const COMPLIANT: u32 = 10;

/// The way along a spline is known by quadrature: what its speed may be off, as a share.
const QUADRATURE: f64 = 1e-5;

/// What a bend may add to chords from one cycle to the next while the way along it grows no faster.
const BEND: f64 = 1e-3;

/// How much faster than it was an arm may become while it slows down for the override: where a bend takes all of a joint's jerk,
/// less speed is all that makes room for slowing down.
const RISE: f64 = 1e-2;

/// The share of an acceleration or a jerk from which on it counts as all that there is: the robot's planning keeps a reserve, and
/// a ramp of the override is made of steps.
const ALL_USED: f64 = 0.75;

/// Cycles that an override may take where no limit is in the way: it changes steadily, not at once.
const RAMP: u32 = 6;

/// The share of the programmed speed below which an arm that has hardly begun to move may still get faster.
const CREEP: f64 = 1e-3;

/// The share of the programmed speed that is allowed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// The override as the PLC gives it, 0…1.
    factor: f64,
    /// The PLC suspends.
    pub(super) holds: bool,
    /// Set while a master leads the arm, which may stand or go slower then.
    pub(super) is_led: bool,
    /// While the arm slows down: the share that it comes from.
    slows_from: Option<f64>,
    /// The cycle in which the share changed last.
    pub(super) changed_in: u32,
    compliant: u32,
    /// On which motion that was, and the highest share of its programmed speed as long as it may still rise.
    highest: Option<(usize, f64)>,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            factor: 1.0,
            holds: false,
            is_led: false,
            slows_from: None,
            changed_in: 0,
            compliant: 0,
            highest: None,
        }
    }
}

impl Pace {
    /// What the PLC commands in this cycle.
    pub(super) fn command(&mut self, cycle: u32, command: Option<&Command>) {
        let before = self.wanted();
        let is_led = command.is_some_and(|command| command.control.contains(Control::SYNC));
        if core::mem::replace(&mut self.is_led, is_led) != is_led {
            self.changed_in = cycle;
        }
        match command {
            Some(command) => {
                if command.control.contains(Control::SUSPEND) {
                    self.holds = true;
                } else if command.control.contains(Control::RESUME) {
                    self.holds = false;
                }
                self.factor = f64::from(command.override_percent.min(100)) / 100.0;
            }
            // It stops, as for a halt.
            None => self.holds = true,
        }
        let now = self.wanted();
        if now == before {
            return;
        }
        (self.changed_in, self.compliant, self.highest) = (cycle, 0, None);
        let from = self.slows_from.unwrap_or(0.0).max(before);
        self.slows_from = (now < from).then_some(from);
    }

    /// The share that is wanted now.
    pub(super) fn wanted(&self) -> f64 {
        if self.holds { 0.0 } else { self.factor }
    }

    /// The share that is allowed now.
    fn allowed(&self) -> f64 {
        self.slows_from.unwrap_or(0.0).max(self.wanted())
    }

    /// Starts anew with the next skill: the arm stands.
    pub(super) const fn settle(&mut self) {
        (self.slows_from, self.compliant, self.holds) = (None, 0, false);
    }

    /// How fast the arm was on one motion, as a share of what is programmed; while it may still rise, a share as it is wanted is by
    /// chance. One that still brakes may not be slow enough for the next motion.
    fn see(&mut self, share: f64, brakes: bool, may_rise: bool) {
        self.compliant = if share <= self.wanted() * (1.0 + SHARE) && !brakes && !may_rise {
            self.compliant + 1
        } else {
            0
        };
        if self.compliant >= COMPLIANT {
            self.slows_from = None;
        }
    }
}

impl Law {
    pub(super) fn check_pace(&mut self) {
        if self.skill.has_ended || self.ways.is_empty() {
            return;
        }
        let among = self.among_last(2);
        let ways = self.ways_among(among);
        let Some(first) = ways.first() else { return };
        if ways.iter().all(|way| way.kind.is_point_to_point()) {
            self.check_shares(among);
        } else if ways.iter().all(|way| !way.kind.is_point_to_point() && way.tool == first.tool) {
            self.check_tool(among);
        }
    }

    /// The tool on lines, circles and splines.
    fn check_tool(&mut self, among: Among) {
        let Some(&Way { tool, kind, .. }) = self.ways.get(among.first) else { return };
        let chords = self.chords(&tool);
        let velocity = self.most(among, |way| way.velocity);
        let (step, step_before) = (length(chords[0]), length(chords[1]));
        self.check_speed(among, step, step_before, velocity * self.cycle_s);
        let limit = velocity * self.pace.allowed();
        let is_spline = self.ways_among(among).iter().any(|way| way.kind == Kind::Spline);
        let share = if is_spline { QUADRATURE } else { SHARE };
        if step > limit * self.cycle_s * (1.0 + share) + 2.0 * TOOL_NOISE_MM {
            let figure = step / self.cycle_s;
            let class = if kind.has_force() { Class::PressSpeed } else { Class::ToolSpeed };
            return self.report_figure(class, "the tool's speed", [figure, limit], "mm/s");
        }
        let [second, third] = bends(&chords);
        if self.samples_of_skill >= 3 && self.is_one_tool(3) {
            let among = self.among_last(3);
            let (class, square) = (Class::ToolAcceleration, self.powers[1]);
            let limit = self.most(among, |way| way.deceleration);
            let slower = step_before - self.longest_way(&tool, [step, step_before]);
            let beyond = slower - limit * square * (1.0 + SHARE) - 4.0 * TOOL_NOISE_MM - BEND * step_before;
            if beyond > 0.0 && beyond > shortened(&chords) {
                let figures = [slower / square, limit];
                return self.report_figure(class, "the tool's deceleration", figures, "mm/s²");
            }
            let limit = self.most(among, |way| way.acceleration.max(way.deceleration));
            if length(second) > limit * square * (1.0 + SHARE) + 4.0 * TOOL_NOISE_MM {
                let figures = [length(second) / square, limit];
                return self.report_figure(class, "the tool's acceleration", figures, "mm/s²");
            }
        }
        if self.samples_of_skill >= 4 && self.is_one_tool(4) {
            let cube = self.powers[2];
            let limit = self.most(self.among_last(4), |way| way.jerk.unwrap_or(self.path_jerk));
            if length(third) > limit * cube * (1.0 + SHARE) + 8.0 * TOOL_NOISE_MM {
                let figures = [length(third) / cube, limit];
                self.report_figure(Class::ToolJerk, "the tool's jerk", figures, "mm/s³");
            }
        }
    }

    /// The joints point to point.
    fn check_shares(&mut self, among: Among) {
        let [q0, q1, q2, q3] = self.samples.map(|sample| sample.joints);
        let (speeds, accelerations) = (self.differences[0], self.differences[1]);
        let shares = [(q0, q1), (q1, q2), (q2, q3)].map(|(to, from)| {
            (0..self.axes).map(|axis| (to[axis] - from[axis]).abs() / speeds[axis]).fold(0.0, f64::max)
        });
        let [share, share_before, _] = shares;
        let velocity = self.most(among, |way| way.velocity);
        self.check_speed(among, share, share_before, velocity);
        let limit = velocity * self.pace.allowed();
        for axis in 0..self.axes {
            let share = (q0[axis] - q1[axis]).abs() / speeds[axis];
            if share > limit * (1.0 + SHARE) + 2.0 * JOINT_NOISE / speeds[axis] {
                return self.report(Class::ShareOfSpeed, joint(axis, share, limit, "of its rated speed"));
            }
        }
        let all = self.among_last(3);
        if self.samples_of_skill < 3 || !self.ways_among(all).iter().all(|way| way.kind.is_point_to_point()) {
            return;
        }
        let limit = self.most_share(all, shares);
        for (axis, rated) in accelerations.into_iter().enumerate().take(self.axes) {
            let share = self.joint_differences(axis)[1].abs() / rated;
            if share > limit * (1.0 + SHARE) + 4.0 * JOINT_NOISE / rated {
                let what = joint(axis, share, limit, "of its rated acceleration");
                return self.report(Class::ShareOfAcceleration, what);
            }
        }
    }

    /// A motion that is faster than wanted does not become faster than it was.
    ///
    /// A LIN force is led by the force as well.
    fn check_speed(&mut self, among: Among, step: f64, before: f64, programmed: f64) {
        let is_led = self.ways_among(among).iter().any(|way| way.kind.has_force());
        if !among.is_one() || programmed <= 0.0 || is_led {
            return;
        }
        let share = step / programmed;
        let may_rise = self.cycle - self.pace.changed_in <= self.settles_in + RAMP;
        let (on, highest) = self.pace.highest.unwrap_or((among.first, 0.0));
        if may_rise && on == among.first {
            self.pace.highest = Some((on, highest.max(share)));
        }
        let most = highest.max(self.pace.wanted()).max(CREEP) * (1.0 + RISE) + TOOL_NOISE_MM / programmed;
        let is_known = self.pace.highest.is_some() && on == among.first;
        let slows = self.pace.slows_from.is_some();
        let is_at_a_limit = slows && self.brakes_at_a_limit(among);
        if slows && !may_rise && is_known && share > most {
            if is_at_a_limit {
                self.pace.highest = Some((on, share));
            } else {
                let what = "while it slows down for the override, the share of the programmed speed";
                self.report_figure(Class::ToolSpeed, what, [share, most], "");
            }
        }
        self.pace.see(share, is_at_a_limit || step < before * (1.0 - BEND), may_rise);
    }

    /// Whether a joint already brakes with all of its acceleration or its jerk, or the tool with all of its jerk, although the tool
    /// becomes faster: along a bend that can be so, and slowing down would take more.
    fn brakes_at_a_limit(&self, among: Among) -> bool {
        let Some(way) = self.ways_among(among).first().filter(|way| !way.kind.is_point_to_point()) else {
            return false;
        };
        let [_, accelerations, jerks] = self.differences;
        let of_joints = (0..self.axes).any(|axis| {
            let [step, change, jerk] = self.joint_differences(axis);
            let brakes = |by: f64, most: f64| by * step.signum() < -ALL_USED * most;
            brakes(change, accelerations[axis]) || brakes(jerk, jerks[axis])
        });
        let chords = self.chords(&way.tool);
        let [_, jerk] = bends(&chords);
        let most = way.jerk.unwrap_or(self.path_jerk) * self.powers[2];
        of_joints || (length(jerk) > ALL_USED * most && dot(jerk, chords[0]) <= 0.0)
    }

    /// The highest share of the rated accelerations, the one for slowing down where the joints' speeds tell that the arm does. In a
    /// corner, and where it turns from one to the other, the higher one counts.
    fn most_share(&self, among: Among, [last, before, first]: [f64; 3]) -> f64 {
        let rising = self.most(among, |way| way.acceleration);
        let falling = self.most(among, |way| way.deceleration);
        match among.is_one() && self.samples_of_skill >= 4 {
            true if first + SHARE < before && before + SHARE < last => rising,
            true if first > before + SHARE && before > last + SHARE => falling,
            _ => rising.max(falling),
        }
    }

    fn most(&self, among: Among, of: impl Fn(&Way) -> f64) -> f64 {
        self.ways_among(among).iter().map(of).fold(0.0, f64::max)
    }

    /// How far the tool went in the last cycle, at most. Where it may have come to a target and gone on from there in another
    /// direction, that is more than the chord.
    fn longest_way(&self, tool: &Pose, [step, before]: [f64; 2]) -> f64 {
        let [to, from, ..] = self.tools(tool);
        let by = |way: &Way| {
            let [came, went] = [from, to].map(|place| distance(place, way.target.at));
            if came <= before { came + went } else { step }
        };
        self.ways_among(self.among_last(2)).iter().map(by).fold(step, f64::max)
    }

    /// Whether the last samples belong to motions that lead one tool.
    fn is_one_tool(&self, samples: usize) -> bool {
        let ways = self.ways_among(self.among_last(samples));
        let Some(first) = ways.first() else { return false };
        ways.iter().all(|way| !way.kind.is_point_to_point() && way.tool == first.tool)
    }
}

/// How the newest of three chords differs from the one before, and how that differs from the difference before.
fn bends([newest, before, first]: &[Vector; 3]) -> [Vector; 2] {
    let second = difference(*before, *newest);
    [second, difference(difference(*first, *before), second)]
}

/// By how much a bend may shorten a chord: a deceleration is along the path, and a chord is shorter than the way by up to a sixth of
/// the square of the angle between two of them.
fn shortened([newest, before, first]: &[Vector; 3]) -> f64 {
    let half_square = |one: Vector, other: Vector| {
        let lengths = length(one) * length(other);
        if lengths > 0.0 { (1.0 - dot(one, other) / lengths).max(0.0) } else { 0.0 }
    };
    half_square(*newest, *before).max(half_square(*before, *first)) / 3.0 * length(*before)
}
