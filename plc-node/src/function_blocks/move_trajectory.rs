//! A path through compact points: MoveContinuous with 30 points in the image in place of five motions.

use protocol::image::{Command, CompactPoints, Control, Feedback, Services, Skill, Slots};
use setup::Refill;

use super::skill::{SkillCall, serves_refill, skill_outputs};
use super::{BlockError, BufferMode, Outputs, Tally};
use crate::{AxesGroup, MotionSource};

/// Drives a path through compact points as one skill. Only robots with the service `COMPACT` have it.
///
/// Its source is one of [compact points](crate::PointList). The first 30 (15 with angles) are written with the start; point k + 30 goes into
/// the place of point k when the robot has executed that one, or with [`Refill::Accepted`] accepted it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct MoveTrajectory {
    /// Its parameter is the number of points.
    pub(super) call: SkillCall<u32>,
    /// The count by which places become free.
    refill: Refill,
}

impl MoveTrajectory {
    /// Returns the block with places that become free by this count.
    #[must_use]
    pub const fn refilled_by(mut self, refill: Refill) -> Self {
        self.refill = refill;
        self
    }

    /// Returns up to which point of its skill it writes, by the robot's counts, into images that hold `capacity` points.
    pub(crate) const fn writes_to(&self, tally: &Tally, capacity: u32) -> u32 {
        tally.freed(self.refill).saturating_add(capacity)
    }

    /// Runs one scan. `mode`, the number of points and their head are read at the rising edge of `execute`; the points are read
    /// from the source when places become free, the first ones when the skill starts.
    pub fn call(
        &mut self,
        execute: bool,
        points: &mut dyn MotionSource,
        mode: BufferMode,
        group: &mut AxesGroup,
    ) -> Outputs {
        let (total, head) = (points.total(), points.point_head());
        let is_kept = serves_refill(group, self.refill);
        let is_served = group.feedback().is_none_or(takes_points);
        let read = || match total {
            0 => Err(BlockError::NoMotions),
            _ if !is_served => Err(BlockError::CompactNotServed),
            _ if !is_kept => Err(BlockError::RefillNotServed),
            _ => Ok(total),
        };
        self.call.call(execute, mode, group, read, |command, total| {
            let head = head.ok_or(BlockError::NoMotions)?;
            command.skill = Skill::MoveTrajectory;
            command.control.set(Control::COMPACT, true);
            command.slots = Slots::Points(CompactPoints::new(head));
            (command.total, command.written) = (total, 0);
            fill(command, 0, points)?;
            Ok(true)
        });
        if self.call.is_sent()
            && let Err(error) = fill(&mut group.command, self.call.tally.freed(self.refill), points)
        {
            self.call.fail(group, error);
        }
        self.call.outputs()
    }
}

skill_outputs!(MoveTrajectory: call);

/// Returns whether the robot takes compact points.
const fn takes_points(feedback: &Feedback) -> bool {
    feedback.services.contains(Services::COMPACT)
}

/// Writes points into every free place, of which the robot has freed those before `freed`.
fn fill(command: &mut Command, freed: u32, points: &mut dyn MotionSource) -> Result<(), BlockError> {
    let Slots::Points(image) = &mut command.slots else { return Ok(()) };
    let end = freed.saturating_add(image.head.capacity()).min(command.total).min(points.available());
    while command.written < end {
        let index = command.written;
        let ended = BlockError::SourceEnded { index, total: command.total };
        image.set_difference(index, points.difference(index).ok_or(ended)?);
        command.written += 1;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use planning::CompactPath;
    use proptest::prelude::*;
    use protocol::image::{Image, Motion, MotionKind, Order, PointHead, PointSum, State, Status};

    use super::*;
    use crate::{PointList, WaitLimits};

    fn head(coordinates: u8) -> PointHead {
        PointHead::of(
            &Motion {
                kind: MotionKind::Spline,
                target: [400.0, 0.0, 100.0, 0.0, 0.0, 180.0],
                velocity: 5_000,
                acceleration: 5_000,
                approximation: 50,
                base: 1,
                ..Motion::EMPTY
            },
            5,
            coordinates,
        )
    }

    fn path(coordinates: u8, count: u32) -> CompactPath {
        let place = |point: u32| {
            let turn = if coordinates == 6 { f64::from(point) * 0.01 } else { 0.0 };
            [400.0 + f64::from(point % 7), f64::from(point) * 0.25, 100.0, turn, 0.0, 180.0]
        };
        CompactPath::of(PointHead { resolution: 50, ..head(coordinates) }, (1..=count).map(place)).unwrap()
    }

    proptest! {
        #[test]
        fn every_point_arrives_once_and_in_order_and_no_place_in_use_is_touched(
            coordinates in proptest::sample::select(vec![3_u8, 6]),
            count in 1..=120_u32,
            by_accepted in any::<bool>(),
            script in proptest::collection::vec((any::<bool>(), 0..=20_u32, 0..=20_u32, any::<bool>()), 1..100),
        ) {
            let path = path(coordinates, count);
            let mut source = PointList::from(path.clone());
            let refill = if by_accepted { Refill::Accepted } else { Refill::Executed };
            let mut block = MoveTrajectory::default().refilled_by(refill);
            let mut group = AxesGroup::new(WaitLimits { answer_scans: 10_000, silent_scans: 10_000 });
            let services = Services::COMPACT | Services::KEEPS_ACCEPTED;
            let mut robot = Feedback { services, ..Feedback::default() };
            let (mut seen, mut image, mut taken) = (robot, None::<Image>, Vec::new());
            let mut sum = PointSum::default();
            let eager = (true, 20, 20, true);
            for (command_arrives, takes, executes, feedback_arrives) in
                script.into_iter().chain(core::iter::repeat_n(eager, 20))
            {
                group.read(Some(seen));
                let outputs = block.call(true, &mut source, BufferMode::default(), &mut group);
                prop_assert!(!outputs.error, "{:?}", block.error());
                let freed = if by_accepted { robot.accepted } else { robot.executed };
                prop_assert!(group.command().written <= count.min(freed + path.head.capacity()));
                let mut bytes = [0; 256];
                Order::BigEndian.emit_command(group.command(), &mut bytes);
                if command_arrives {
                    image = Some(bytes);
                }
                if let Some(command) = image.and_then(|image| Order::BigEndian.parse_command(&image).ok())
                    && command.number != 0
                {
                    (robot.number, robot.state, robot.status) = (command.number, State::Running, Status::BUSY);
                    for _ in 0..takes.min(command.written - robot.accepted) {
                        sum.add(command.slots.points().unwrap().difference(robot.accepted));
                        taken.push(sum.motion(&path.head));
                        robot.accepted += 1;
                    }
                    robot.executed += executes.min(robot.accepted - robot.executed);
                    if robot.executed == count {
                        (robot.state, robot.status) = (State::Ready, Status::DONE);
                    }
                }
                if feedback_arrives {
                    seen = robot;
                }
            }
            group.read(Some(robot));
            prop_assert!(block.call(true, &mut source, BufferMode::default(), &mut group).done);
            let mut again = PointList::from(path);
            let planned: Vec<_> = (0..count).map(|index| again.get(index).unwrap()).collect();
            prop_assert_eq!(taken, planned);
        }
    }

    #[test]
    fn a_robot_without_compact_points_is_sent_none() {
        let mut source = PointList::from(path(3, 9));
        let mut group = AxesGroup::new(WaitLimits { answer_scans: 10, silent_scans: 10 });
        let mut block = MoveTrajectory::default();
        group.read(Some(Feedback { services: Services::KEEPS_ACCEPTED, ..Feedback::default() }));
        assert!(block.call(true, &mut source, BufferMode::default(), &mut group).error);
        assert_eq!(block.error(), Some(BlockError::CompactNotServed));
        assert_eq!((group.command().number, group.command().written), (0, 0));
    }

    #[test]
    fn the_bit_compact_goes_with_the_next_skill() {
        let mut group = AxesGroup::new(WaitLimits { answer_scans: 10, silent_scans: 10 });
        group.read(Some(Feedback { services: Services::COMPACT, ..Feedback::default() }));
        let mut block = MoveTrajectory::default();
        assert!(block.call(true, &mut PointList::from(path(3, 9)), BufferMode::default(), &mut group).busy);
        assert!(group.command().is_compact());
        let (number, status) = (group.command().number, Status::DONE);
        let counts = Feedback { number, status, executed: 9, accepted: 9, ..Feedback::default() };
        group.read(Some(Feedback { state: State::Ready, ..counts }));
        assert!(block.call(true, &mut PointList::from(path(3, 9)), BufferMode::default(), &mut group).done);
        let mut program = super::super::RunProgram::default();
        assert!(program.call(true, 1, BufferMode::default(), &mut group).busy);
        assert!(!group.command().control.contains(Control::COMPACT));
    }
}
