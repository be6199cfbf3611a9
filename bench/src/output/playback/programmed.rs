//! Which speed is programmed at each moment of a run, by the motion that the robot is at.

use protocol::image::{Motion, State};

use crate::records::trace::RobotTick;

/// For each cycle the programmed path speed in mm/s. It is no number where there is none: before and after the run, and in a
/// point-to-point motion, whose speed is programmed as a share of the axes'.
pub(super) fn speeds_mm_s<'a>(ticks: impl Iterator<Item = &'a RobotTick>, motions: &[Motion]) -> Vec<f64> {
    let mut place = Place::default();
    ticks
        .map(|tick| place.follow(tick).and_then(|motion| speed(motions.get(motion)?)).unwrap_or(f64::NAN))
        .collect()
}

fn speed(motion: &Motion) -> Option<f64> {
    (!motion.kind.is_point_to_point()).then(|| motion.velocity_mm_s())
}

/// How far the sequence is: a program or a MoveContinuousSkill has all motions or many, a single skill has one.
#[derive(Default)]
struct Place {
    /// The command that is executed; the one before the run was never seen to run.
    command: Option<u16>,
    /// Motions of the commands before it, and its own as far as they are accepted: all, once it has ended.
    before: u32,
    accepted: u32,
}

impl Place {
    /// The index of the motion that the robot is at in this cycle, while it runs.
    fn follow(&mut self, tick: &RobotTick) -> Option<usize> {
        if tick.state != State::Running {
            return None;
        }
        if self.command.replace(tick.command) != Some(tick.command) {
            self.before += std::mem::take(&mut self.accepted);
        }
        self.accepted = self.accepted.max(tick.accepted);
        usize::try_from(self.before + tick.executed).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::image::MotionKind;

    fn tick(state: State, command: u16, executed: u32, accepted: u32) -> RobotTick {
        RobotTick {
            at_ms: 0.0,
            state,
            command,
            executed,
            accepted,
            blends_suppressed: 0,
            path_speed_mm_s: 0.0,
            pose: [0.0; 6],
            joints: [0.0; 6],
        }
    }

    fn motions() -> Vec<Motion> {
        let line = |velocity| Motion { kind: MotionKind::LinCartesian, velocity, ..Motion::EMPTY };
        let ptp = Motion { kind: MotionKind::PtpJoint, velocity: 5_000, ..Motion::EMPTY };
        vec![line(1_000), ptp, line(2_500)]
    }

    /// The speeds in words, so that a missing one can be compared.
    fn speeds(ticks: &[RobotTick]) -> Vec<String> {
        speeds_mm_s(ticks.iter(), &motions()).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_continuous_motion_has_the_speed_of_the_motion_that_it_is_at() {
        let ticks = [
            tick(State::Ready, 6, 13, 13),
            tick(State::Running, 7, 0, 2),
            tick(State::Running, 7, 1, 3),
            tick(State::Running, 7, 2, 3),
            tick(State::Ready, 7, 3, 3),
        ];
        assert_eq!(speeds(&ticks), ["NaN", "100", "NaN", "250", "NaN"]);
    }

    #[test]
    fn single_skills_follow_each_other_through_the_motions() {
        let ticks = [
            tick(State::Running, 7, 0, 1),
            // Its end fell between two cycles.
            tick(State::Running, 8, 0, 1),
            tick(State::Ready, 8, 1, 1),
            tick(State::Running, 9, 0, 1),
        ];
        assert_eq!(speeds(&ticks), ["100", "NaN", "NaN", "250"]);
    }
}
