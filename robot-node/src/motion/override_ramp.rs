//! Changes the override while the arm moves: as fast as joints and tool allow, on the path.
//!
//! Each cycle begins a new ramp of the rate: a step in which the arm has the highest jerk that the limits allow, and
//! then phases in which the rate levels out. A ramp is begun only if all of it keeps the limits, so the arm can always
//! finish it; mostly the next cycle replaces it by another one. The last ramp levels out at the override.

use super::knot::Rates;
use super::load::{Load, Ramps};
use super::node::Pace;
use super::path::Path;
use super::piece::{Course, Piece};
use super::time_scale::{BENDS, MOST_BENT, Phase, Ramp, Rate, TimeScale};

/// Least duration of a step, in s. In a longer robot cycle a step is as long as the cycle, so that it is not over before the next
/// one can begin.
const LEAST_STEP_S: f64 = 0.004;

/// Lengths of a step that are tried while the rate is constant, each a quarter of the one before: where a step is longer than a
/// corner, even the slowest one is too fast.
const STEPS: usize = 5;

/// Shares of the highest jerk with which a step is tried: toward the override, and away from it where the present
/// change must be taken back first.
const JERK_SHARES: [f64; 12] = [1.0, 0.93, 0.86, 0.78, 0.65, 0.5, 0.3, 0.15, 0.05, -0.15, -0.3, -0.6];

/// Ways to level out after a step: the seconds for which the rate first keeps its slope, and the share of the highest
/// jerk with which it then levels out. While the law itself uses all of the jerk, only a weak or a late one is
/// possible.
const LEVELS: [[f64; 2]; 10] = [
    [0.0, 0.9],
    [0.0, 0.6],
    [0.0, 0.3],
    [0.0, 0.2],
    [0.0, 0.12],
    [0.0, 0.07],
    [0.0, 0.04],
    [0.012, 0.6],
    [0.036, 0.6],
    [0.1, 0.6],
];

/// This many of them are strong enough to end a ramp at the override.
const LANDINGS: usize = 3;

/// Share of the highest acceleration that steps reach.
const ACCELERATION_SHARE: f64 = 0.99;

/// Largest distance by which a ramp may lead away from the override.
const AWAY: f64 = 1e-6;

/// A ramp is replaced by one that changes the rate within a step by this much more, as a share of the change by the
/// highest jerk.
const LEAST_GAIN: f64 = 1e-3;

/// Share of the planned limits that joints and tool may use while the override changes: a little of the reserve.
const WHILE_SCALED: f64 = 1.008;

/// A ramp is checked where pieces of the law end and at this interval, in s: at least and at most this often in each of
/// its phases.
const CHECK_S: f64 = 0.0005;
const LEAST_CHECKS: f64 = 2.0;
const MOST_CHECKS: f64 = 128.0;

impl Path {
    /// Changes the override, 0…1: the share of the programmed speeds. At 0 the arm stops on the path as soon as the limits allow.
    /// This is done every `cycle_s` seconds.
    pub fn set_override(&mut self, factor: f64, cycle_s: f64) {
        self.factor = factor;
        if self.scale.is_steadily(factor) {
            return;
        }
        if self.rests() {
            self.scale = TimeScale::steady(factor);
            return;
        }
        let mut step_s = cycle_s.max(LEAST_STEP_S);
        for _ in 0..STEPS {
            if let Some(ramp) = self.quickest_ramp(step_s) {
                return self.scale.start(ramp);
            }
            // A ramp under way ends by itself.
            if !self.scale.is_steady() {
                return;
            }
            step_s /= 4.0;
        }
    }

    /// Returns the ramp toward the override that changes the rate most within a step and keeps the limits. None where
    /// the present ramp changes it as much.
    fn quickest_ramp(&self, step_s: f64) -> Option<Ramp> {
        let (part, spot, Pace { square, acceleration }) = self.here()?;
        let knot = part.knot(spot.way, 0.0, &Rates::of(part.ratings))?;
        let (now, speed) = (self.scale.now(), square.sqrt());
        let sign = 1.0_f64.copysign(self.factor - now.share);
        let (most, most_jerk) = (knot.acceleration_at_rest(sign), knot.jerk_at_rest());
        let under_way = self.scale.after(step_s).change;
        let accelerates = now.share * now.share * acceleration + now.change * speed;
        let room = (ACCELERATION_SHARE * most - sign * accelerates) / step_s;
        let course = self.course();
        let least_gain =
            if self.scale.is_steady() { 0.0 } else { LEAST_GAIN * most.min(step_s * most_jerk) / speed };
        // A rate that still moves away from the override goes no farther than it would have gone.
        let farthest = if sign * now.change >= 0.0 { now.share } else { self.scale.target() };
        let is_better = |ramp: &Ramp| {
            sign * (ramp.farthest(-sign) - farthest) >= -AWAY
                && sign * (ramp.change() - under_way) > least_gain
        };
        let mut has_landed = [false; LANDINGS];
        for jerk_share in JERK_SHARES {
            let jerk = if jerk_share > 0.0 {
                jerk_share * most_jerk.min(room)
            } else {
                room.min(jerk_share * most_jerk)
            };
            let bends = self.bends(sign * jerk, step_s);
            let mut behind = None;
            for (index, [hold, level]) in LEVELS.into_iter().enumerate() {
                let level = level * most_jerk / speed;
                if let Some(ramp) = Ramp::stepping(now, bends, step_s, [hold, level], self.factor) {
                    if !is_better(&ramp) {
                        continue;
                    }
                    // The step is the same for all.
                    let behind = behind.get_or_insert_with(|| {
                        let mut course = course.clone();
                        self.keeps_limits(ramp.step(), &mut course).then_some(course)
                    });
                    let Some(behind) = behind else { break };
                    if self.keeps_limits(ramp.leveling(), &mut behind.clone()) {
                        return Some(ramp);
                    }
                } else if has_landed.get(index) == Some(&false) {
                    has_landed[index] = true;
                    let ramp = Ramp::landing(now, step_s, level, self.factor).filter(is_better);
                    if ramp.is_some_and(|ramp| self.keeps_limits(ramp.phases(), &mut course.clone())) {
                        return ramp;
                    }
                }
            }
        }
        None
    }

    /// Returns the law from the present place on.
    fn course(&self) -> Course<impl Iterator<Item = Piece> + Clone> {
        Course::new(self.pieces.iter().copied(), self.time)
    }

    /// Returns the second derivatives of the rate in the parts of the next step that give the arm this jerk, in the
    /// unit of the present part.
    fn bends(&self, jerk: f64, step_s: f64) -> [f64; BENDS] {
        let (mut rate, mut course) = (self.scale.now(), self.course());
        rate.bend = 0.0;
        let each = step_s / BENDS as f64;
        core::array::from_fn(|_| {
            let (Rate { share, change, .. }, to_middle) = rate.after(each / 2.0);
            course.advance(to_middle);
            let Some(piece) = course.piece else { return 0.0 };
            let (_, Pace { square, acceleration }, law_jerk) = piece.at_with_jerk(course.time);
            let own = share * (share * share * law_jerk + 3.0 * change * acceleration);
            rate.bend = ((jerk * course.unit - own) / square.sqrt()).clamp(-MOST_BENT, MOST_BENT);
            let (end, to_end) = rate.after(each);
            course.advance(to_end - to_middle);
            rate = end;
            rate.bend
        })
    }

    /// Returns whether joints and tool keep their limits while the law's time passes as in these phases, along a
    /// course, which is advanced by them.
    pub(super) fn keeps_limits<I: Iterator<Item = Piece>>(
        &self,
        phases: impl IntoIterator<Item = Phase>,
        course: &mut Course<I>,
    ) -> bool {
        for phase in phases.into_iter().filter(|phase| phase.seconds > 0.0) {
            let step = (phase.seconds / LEAST_CHECKS).min(CHECK_S).max(phase.seconds / MOST_CHECKS);
            let (mut now, mut law_now) = (0.0, 0.0);
            while now < phase.seconds {
                let Some(mut piece) = course.piece else { return true };
                let next = (now + step).min(phase.seconds);
                let law_next = phase.at(next).1;
                if !self.keeps_limits_at(&piece, course.time, &phase.at(now).0) {
                    return false;
                }
                let (mut gone, end) = (-course.time, law_next - law_now);
                course.time += end;
                while course.time >= piece.cell.duration {
                    // The loads are highest where one piece ends and the next begins, and the jerk changes at once there.
                    gone += piece.cell.duration;
                    let border = phase.at(now + gone / end * (next - now)).0;
                    if !self.keeps_limits_at(&piece, piece.cell.duration, &border) {
                        return false;
                    }
                    course.leave(&piece);
                    let Some(next_piece) = course.piece else { return true };
                    piece = next_piece;
                    if !self.keeps_limits_at(&piece, 0.0, &border) {
                        return false;
                    }
                }
                (now, law_now) = (next, law_next);
            }
            let Some(piece) = course.piece else { return true };
            if !self.keeps_limits_at(&piece, course.time, &phase.at(phase.seconds).0) {
                return false;
            }
        }
        true
    }

    fn keeps_limits_at(&self, piece: &Piece, time: f64, rate: &Rate) -> bool {
        let (spot, Pace { square, acceleration }, jerk) = piece.at_with_jerk(time);
        let Some(part) = self.part(&spot) else { return true };
        let Some(slopes) = part.slopes(spot.way) else { return true };
        let (ramps, speed) = (Ramps::of(part.ratings), square.sqrt());
        let load = |square: f64, acceleration: f64, jerk: f64| {
            Load::new(&slopes, [square, acceleration, jerk], &ramps).most(acceleration < 0.0, &ramps)
        };
        let Rate { share, change, bend } = *rate;
        let scaled = load(
            share * share * square,
            share * share * acceleration + change * speed,
            share * (share * share * jerk + 3.0 * change * acceleration) + bend * speed,
        );
        if scaled[0].max(scaled[1]) <= WHILE_SCALED {
            return true;
        }
        // The loads may be those of the law itself.
        let own = load(square, acceleration, jerk).map(|load| load.max(WHILE_SCALED));
        scaled[0] <= own[0] && scaled[1] <= own[1]
    }
}
