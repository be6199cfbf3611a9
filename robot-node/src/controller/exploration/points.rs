//! Compact points in every order of commands, losses, old images and restarts: more of them than an image holds, so that places are
//! refilled.

use planning::CompactPath;
use plc_node::function_blocks::MoveTrajectory;
use protocol::image::{MotionKind, PointHead, Slots};

use super::*;

/// A fault of a PLC that the rules must find.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum PlantedFault {
    /// It writes the next point into its place before that is free.
    RefillsEarly,
    /// It counts new points whose places it has not written yet.
    CountsBeforeWriting,
}

/// Points: two more than an image holds with angles.
const POINTS: usize = 17;

/// Values of joint 3 at the points, in mm: 0.008 to 0.014 mm apart, so that no two neighbours in a place are equal.
pub(super) const TARGETS: [f64; POINTS] = {
    let (mut targets, mut at, mut index) = ([0.0; POINTS], HOME, 0);
    while index < POINTS {
        at -= 0.008 + 0.001 * (index % 7) as f64;
        targets[index] = at;
        index += 1;
    }
    targets
};

/// The points, in steps of 0.1 µm.
pub(super) fn path() -> CompactPath {
    let config = config();
    let place = |joint_3: f64| {
        let mut joints = config.home;
        joints[2] = joint_3;
        config.arm.forward(&joints).to_mm_deg()
    };
    let line = Motion {
        kind: MotionKind::LinCartesian,
        target: place(HOME).map(|coordinate| coordinate as f32),
        velocity: 10_000,
        acceleration: 5_000,
        approximation: 1,
        ..Motion::EMPTY
    };
    CompactPath::of(PointHead::of(&line, 10, 6), TARGETS.map(place)).unwrap()
}

impl Skills {
    pub(super) fn trajectory(self) -> MoveTrajectory {
        match self {
            Self::Points(refill, _) => MoveTrajectory::default().refilled_by(refill),
            _ => MoveTrajectory::default(),
        }
    }
}

impl Explored {
    pub(super) fn restart_plc(&mut self) {
        let Self { controller, at, connected, seen, seen_before, skills, .. } = self.clone();
        *self = Self::new(skills);
        (self.controller, self.at, self.connected) = (controller, at, connected);
        (self.seen, self.seen_before) = (seen, seen_before);
    }

    pub(super) fn restart_robot(&mut self) {
        let config = RobotConfig { home: *self.controller.joints(), ..self.skills.config() };
        self.controller = Controller::new(config, Vec::new(), 1);
    }

    /// Alters the image on its way to the robot, as a PLC with the fault would have sent it.
    pub(super) fn plant_fault(&mut self, source: &mut dyn MotionSource) {
        let Skills::Points(_, Some(fault)) = self.skills else { return };
        let [written, written_before] = [self.seen.written, self.seen_before.written];
        let before = self.seen_before.slots;
        match (fault, &mut self.seen.slots) {
            (PlantedFault::RefillsEarly, Slots::Points(points)) => {
                source
                    .difference(written)
                    .into_iter()
                    .for_each(|early| points.set_difference(written, early));
            }
            (PlantedFault::CountsBeforeWriting, slots) if written > written_before && written_before > 0 => {
                *slots = before;
            }
            _ => {}
        }
    }

    /// Returns how many motions are executed; of compact points only whether places are free by that, and whether all are.
    pub(super) fn executed_key(&self) -> u32 {
        self.count_key(self.controller.feedback().executed)
    }

    /// Returns the same of the present path.
    pub(super) fn executed_on_path_key(&self) -> u32 {
        self.count_key(self.controller.interpolator.path().executed())
    }

    const fn count_key(&self, count: u32) -> u32 {
        match self.skills {
            Skills::Points(..) if count >= 2 && count < POINTS as u32 => 2,
            _ => count,
        }
    }

    /// Returns what else decides with compact points: the points in the images that the robot had.
    pub(super) fn points_key(&self) -> impl std::hash::Hash + Eq + use<> {
        let is_points = matches!(self.skills, Skills::Points(..));
        let number = self.group.command().number;
        is_points
            .then_some([self.seen, self.seen_before].map(|image| (image.number == number, image.written)))
    }
}

#[test]
fn compact_points_keep_all_rules_in_every_order_of_commands_losses_old_images_and_restarts() {
    let Found { ends, states, .. } = explore(Skills::Points(Refill::Executed, None));
    assert!(ends.iter().any(|end| end.done) && ends.iter().any(|end| end.command_aborted));
    // An older image has fewer points.
    assert!(ends.iter().any(|end| end.error_id == u16::from(ErrorNumber::QueueOverrun)));
    assert_eq!(states.len(), 3, "Halted, Ready and Running turn up");
}

#[test]
fn so_do_those_that_are_refilled_by_what_was_accepted() {
    let Found { ends, states, .. } = explore(Skills::Points(Refill::Accepted, None));
    assert!(ends.iter().any(|end| end.done) && ends.iter().any(|end| end.command_aborted));
    assert_eq!(states.len(), 3, "Halted, Ready and Running turn up");
}

#[test]
#[should_panic(expected = "at 174.")]
fn a_plc_that_refills_a_place_before_it_is_free_breaks_a_rule() {
    explore(Skills::Points(Refill::Accepted, Some(PlantedFault::RefillsEarly)));
}

#[test]
#[should_panic(expected = "at 174.")]
fn a_plc_that_counts_a_point_before_it_writes_it_breaks_a_rule() {
    explore(Skills::Points(Refill::Accepted, Some(PlantedFault::CountsBeforeWriting)));
}
