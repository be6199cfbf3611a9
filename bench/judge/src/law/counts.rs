//! What the robot counts and how a skill ends.

use protocol::image::{ErrorNumber, Feedback, State, Status};

use super::{Among, Law, PLACE_MM, Seen};
use crate::case::{Execution, Kind};
use crate::kinematics::{Pose, difference, distance, dot, length};
use crate::violation::{Broken, Class};

/// Cycles without motion after which a skill that has all that it needs is stuck: 2 s.
const IDLE: u32 = 500;

impl Law {
    pub(super) fn check_counts(&mut self, seen: &Seen<'_>) {
        let feedback = seen.feedback;
        self.check_state(feedback);
        if feedback.number != self.skill.number || self.skill.has_ended {
            return;
        }
        let total = self.ways.len() as u32;
        let Feedback { executed, accepted, .. } = *feedback;
        if executed < self.skill.executed {
            let figures = [executed, self.skill.executed].map(f64::from);
            return self.report_figure(Class::Count, "`executed` fell and", figures, "motions");
        }
        if executed > accepted || accepted > total {
            return self
                .report(Class::Count, Broken::Words("`executed` ≤ `accepted` ≤ `total` does not hold"));
        }
        let is_one = executed == self.skill.executed + 1;
        while self.skill.executed < executed {
            self.check_executed(self.skill.executed as usize, is_one, feedback);
            self.skill.executed += 1;
        }
        self.check_standing(feedback);
        let ended = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
        if feedback.status.0 & ended != 0 {
            self.check_end(seen);
            self.skill.has_ended = true;
            self.pace.settle();
        }
    }

    /// The motion of this index was executed in the last cycle, which `is_one` says of no other: the tool came to its zone,
    /// or passed or stopped at its target.
    fn check_executed(&mut self, index: usize, is_one: bool, feedback: &Feedback) {
        let Some(way) = self.ways.get(index) else { return };
        let (kind, target, zone_mm) = (way.kind, way.target, way.zone_mm);
        self.skill.holds = kind.has_force();
        if kind.has_force() {
            return self.check_force(way.force_n, feedback);
        }
        let [now, before, ..] = self.tools(&way.tool);
        let step = length(difference(before, now));
        let among = Among { first: index, last: (index + 1).min(self.ways.len() - 1) };
        // Another tool may lead the next motion: this one is then held by the joints alone.
        let is_one_tool = self.ways_among(among).iter().all(|next| next.tool == way.tool);
        let near = if is_one_tool { self.near_stop_mm(among) } else { self.near_stop_by_joints_mm() };
        let goes_on =
            self.ways.get(index + 1).is_some_and(|next| next.kind == Kind::Spline && kind == Kind::Spline);
        let (off, limit) = if goes_on {
            (off_chord(target.at, before, now), near / 4.0 + PLACE_MM)
        } else if zone_mm > 0.0 {
            (distance(now, target.at), zone_mm + step + near)
        } else {
            // Where several motions fit into one cycle it began before all of them.
            let before = if is_one { distance(before, target.at) } else { 0.0 };
            (distance(now, target.at).max(before), near)
        };
        if off > limit {
            let what = "the tool's distance from an executed target";
            self.report_figure(Class::Executed, what, [off, limit], "mm");
        }
    }

    /// Where a LIN force has ended is where the next motion starts.
    pub(super) fn take_up_force(&mut self, executed: u32, flange: &Pose) {
        for index in self.skill.executed as usize..executed as usize {
            let Some(way) = self.ways.get_mut(index).filter(|way| way.kind.has_force()) else {
                continue;
            };
            way.end = *flange;
            if let Some(next) = self.ways.get_mut(index + 1) {
                next.start_at(flange);
            }
            self.limit_zones();
        }
    }

    fn check_force(&mut self, wanted: f64, feedback: &Feedback) {
        let found = f64::from(feedback.contact_force);
        if (found - wanted).abs() > self.force_tolerance_n + 1e-3 {
            let what = "the force of a LIN force that is done";
            self.report_figure(Class::Force, what, [found, wanted], "N");
        }
    }

    /// A running arm rests only at the end of a motion.
    fn check_standing(&mut self, feedback: &Feedback) {
        let is_free = !self.pace.holds && !self.pace.is_led;
        let may_move = is_free && self.pace.wanted() > 0.0 && self.cycle > self.pace.changed_in + 2;
        let presses = self.ways.get(self.skill.executed as usize).is_some_and(|way| way.kind.has_force());
        self.skill.has_moved |= self.has_moved();
        if self.has_moved() || !may_move || feedback.state != State::Running || presses {
            self.skill.idle = 0;
            return;
        }
        self.skill.idle += 1;
        if !self.skill.holds && !self.stands_where_it_may(self.skill.executed) {
            self.report(Class::Stand, Broken::Words("the arm stands where no motion ends"));
        }
        let is_starved = matches!(self.skill.execution, Execution::Continuous | Execution::Trajectory)
            && feedback.accepted == feedback.executed
            && (feedback.accepted as usize) < self.ways.len();
        if self.skill.idle > IDLE && !is_starved {
            self.report(Class::Stuck, Broken::Words("the skill stands still although nothing is missing"));
        }
    }

    fn check_state(&mut self, feedback: &Feedback) {
        let before = self.before.map(|before| before.state);
        let stands = matches!(feedback.state, State::Suspended)
            || (matches!(feedback.state, State::Ready | State::Halted) && !self.skill.holds);
        if stands && before == Some(feedback.state) && self.has_moved() {
            self.report(Class::State, Broken::Words("the arm moves in a state in which it stands"));
        }
    }

    /// The skill has ended.
    fn check_end(&mut self, seen: &Seen<'_>) {
        let feedback = seen.feedback;
        let status = feedback.status;
        if status.contains(Status::DONE) {
            return self.check_done(seen);
        }
        if feedback.state != State::Halted {
            return self.report(Class::State, Broken::Words("a skill failed, and the robot is not halted"));
        }
        let is_commanded = matches!(feedback.error, ErrorNumber::ConnectionLost | ErrorNumber::Disabled);
        if status.contains(Status::ABORTED) || is_commanded {
            return;
        }
        if feedback.error == ErrorNumber::None {
            return self.report(Class::State, Broken::Words("a skill ended by an error that has no number"));
        }
        let bad = feedback.error_motion as usize;
        let by_force = self.ways.get(bad).is_some_and(|way| way.kind.has_force());
        if by_force && feedback.error == ErrorNumber::ForceNotReached {
            return;
        }
        // What is written is checked before anything moves; from then on each motion before the one ahead of it ends.
        let is_next = feedback.error_motion == feedback.executed || !self.skill.has_moved;
        if !is_next || !(self.skill.holds || self.stands_where_it_may(feedback.executed)) {
            self.report(Class::LateError, Broken::Words(late(feedback.error)));
        }
    }

    fn check_done(&mut self, seen: &Seen<'_>) {
        let feedback = seen.feedback;
        let total = self.ways.len() as u32;
        let problem = if feedback.executed != total || feedback.accepted != total {
            Some("Done, and not all motions are executed")
        } else if seen.accepted.sum() != self.skill.sent.sum() {
            Some("Done, and the robot's motions are not those that were sent")
        } else if feedback.error != ErrorNumber::None || feedback.state != State::Ready {
            Some("Done, and not Ready without an error")
        } else if !self.skill.holds && !self.stands_where_it_may(total) {
            Some("Done, and the tool is not at its last target")
        } else {
            None
        };
        if let Some(problem) = problem {
            self.report(Class::Done, Broken::Words(problem));
        }
    }
}

/// The error, in a sentence that says when it came.
const fn late(error: ErrorNumber) -> &'static str {
    match error {
        ErrorNumber::AxisLimit => "an axis limit was met in the middle of a motion",
        ErrorNumber::Unreachable => "an unreachable point was met in the middle of a motion",
        ErrorNumber::Singular => "a singular position was met in the middle of a motion",
        ErrorNumber::ConfigurationChange => "a change of configuration was met in the middle of a motion",
        ErrorNumber::QueueOverrun => "the robot reported QueueOverrun without an overrun",
        _ => "an error ended the skill in the middle of a motion",
    }
}

/// How far a point is from the chord between two others.
fn off_chord(
    point: crate::kinematics::Vector,
    from: crate::kinematics::Vector,
    to: crate::kinematics::Vector,
) -> f64 {
    let along = difference(from, to);
    let square = dot(along, along);
    let share =
        if square > 0.0 { (dot(difference(from, point), along) / square).clamp(0.0, 1.0) } else { 0.0 };
    distance(point, core::array::from_fn(|i| from[i] + share * along[i]))
}
