//! The programmed speed at each moment of a run, from the motion that the robot executes.

use protocol::image::Motion;
use robot_node::Sample;

use records::trace::place::Place;

/// Returns the programmed path speed in mm/s for each cycle. It is NaN if there is none: before and after the run,
/// and in a point-to-point motion, whose speed is programmed as a share of the axes' speed.
pub(super) fn speeds_mm_s<'a>(cycles: impl Iterator<Item = &'a Sample>, motions: &[Motion]) -> Vec<f64> {
    let mut place = Place::default();
    cycles
        .map(|sample| place.follow(sample).and_then(|motion| speed(motions.get(motion)?)).unwrap_or(f64::NAN))
        .collect()
}

fn speed(motion: &Motion) -> Option<f64> {
    (!motion.kind.is_point_to_point()).then(|| motion.velocity_mm_s())
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::image::{MotionKind, State};

    fn sample(state: State, command: u16, executed: u32, accepted: u32) -> Sample {
        Sample { state, command, executed, accepted, ..Sample::default() }
    }

    fn motions() -> Vec<Motion> {
        let line = |velocity| Motion { kind: MotionKind::LinCartesian, velocity, ..Motion::EMPTY };
        let ptp = Motion { kind: MotionKind::PtpJoint, velocity: 5_000, ..Motion::EMPTY };
        vec![line(1_000), ptp, line(2_500)]
    }

    /// Formats the speeds as text, so that a missing one can be compared.
    fn speeds(cycles: &[Sample]) -> Vec<String> {
        speeds_mm_s(cycles.iter(), &motions()).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_continuous_motion_has_the_speed_of_its_current_motion() {
        let cycles = [
            sample(State::Ready, 6, 13, 13),
            sample(State::Running, 7, 0, 2),
            sample(State::Running, 7, 1, 3),
            sample(State::Running, 7, 2, 3),
            sample(State::Ready, 7, 3, 3),
        ];
        assert_eq!(speeds(&cycles), ["NaN", "100", "NaN", "250", "NaN"]);
    }

    #[test]
    fn single_skills_go_through_the_motions_one_after_another() {
        let cycles = [
            sample(State::Running, 7, 0, 1),
            // Its end was between two cycles.
            sample(State::Running, 8, 0, 1),
            sample(State::Ready, 8, 1, 1),
            sample(State::Running, 9, 0, 1),
        ];
        assert_eq!(speeds(&cycles), ["100", "NaN", "NaN", "250"]);
    }
}
