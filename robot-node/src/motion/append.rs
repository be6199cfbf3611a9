//! Appends a motion to the path: with a corner, or as the continuation of a line or a spline.

use protocol::image::Motion;

use super::blend::{self, Blend};
use super::curve::Curve;
use super::path::Path;
use super::piece::Spot;
use super::segment::Segment;
use super::spline::Spline;
use crate::RobotConfig;
use crate::arm::{Arm, Violation};

/// Outcome of appending a motion.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Appended {
    /// It is on the path.
    Planned,
    /// It is on the path, but came too late for the corner before it: the arm stops there exactly.
    Late,
}

/// Two motions of a spline as pieces of one.
pub(super) struct Joined {
    one: Segment,
    /// The second one, if it does not have its shape from the first already.
    next: Option<Segment>,
    /// The new corner before the first one, if there is one.
    corner: Option<Option<Blend>>,
}

impl Path {
    /// Checks a motion that is to be [appended](Self::append) next. One that continues a spline already gets its shape
    /// from that spline.
    ///
    /// # Errors
    ///
    /// As [`Segment::prepare`].
    pub fn prepare(&self, motion: &Motion, config: &RobotConfig) -> Result<Segment, Violation> {
        self.prepare_to(motion.target.map(f64::from), motion, config)
    }

    /// As [`prepare`](Self::prepare), to a target in double precision.
    ///
    /// # Errors
    ///
    /// As [`Segment::prepare`].
    pub fn prepare_to(
        &self,
        target: [f64; 6],
        motion: &Motion,
        config: &RobotConfig,
    ) -> Result<Segment, Violation> {
        let last = self.queue.len().checked_sub(1).filter(|last| self.is_ahead(*last));
        let before = last.and_then(|last| self.queue.get(last)).filter(|planned| !planned.stops);
        Segment::prepare_to(target, before.map(|planned| &planned.segment), motion, &self.end, config)
    }

    /// Appends a motion that starts at [`end`](Self::end). `last` says that none follows.
    pub fn append(&mut self, segment: Segment, last: bool, arm: &Arm) -> Appended {
        let Some(before) = self.push(segment, last, arm) else {
            self.plan_last();
            return Appended::Planned;
        };
        if let Some(appended) = self.go_on(before, arm) {
            return appended;
        }
        for share in [1.0, 0.5, 0.25] {
            let blend = match (self.queue.get(before), self.queue.back()) {
                (Some(before), Some(last)) => {
                    Blend::after_zone(before.zone, &before.segment, &last.segment, share, arm)
                }
                _ => None,
            };
            let is_corner = blend.is_some();
            self.set_blend(before, blend);
            if !is_corner {
                self.plan_last();
                return Appended::Planned;
            }
            if self.plan(&self.leaves(before)) {
                return Appended::Planned;
            }
        }
        self.set_blend(before, None);
        self.stop_after(before);
        self.plan_last();
        Appended::Late
    }

    /// Plans the last motion, which begins at rest.
    fn plan_last(&mut self) -> bool {
        self.plan(&self.place_of(self.queue.len().saturating_sub(1), 0.0))
    }

    /// A place on the straight part of a motion.
    pub(super) fn place_of(&self, index: usize, way: f64) -> Spot {
        Spot { motion: self.left_behind + index as u32, in_blend: false, way }
    }

    /// Where a motion's straight part ends.
    pub(super) fn leaves(&self, index: usize) -> Spot {
        let way = self.queue.get(index).map_or(0.0, |planned| {
            planned.segment.curve.length() - planned.corner.as_ref().map_or(0.0, |corner| corner.from_zone)
        });
        self.place_of(index, way)
    }

    /// Joins the last motion and the one before it to one curve, if they are lines in the same direction or motions of
    /// one spline.
    fn go_on(&mut self, before: usize, arm: &Arm) -> Option<Appended> {
        let (one, next) = (self.queue.get(before)?, self.queue.back()?);
        match (&one.segment.curve, &next.segment.curve) {
            (Curve::Line(_), Curve::Line(_))
                if one.segment.goes_straight_on_to(&next.segment, arm, self.cycle_s) =>
            {
                self.set_goes_on(before, true);
                let is_feasible = self.plan(&self.leaves(before));
                self.set_goes_on(before, is_feasible);
                is_feasible.then_some(Appended::Planned)
            }
            (Curve::Spline(_), Curve::Spline(_)) => self.go_on_with_spline(before, arm),
            _ => None,
        }
    }

    /// Makes the last motion and the one before it pieces of one spline. Each changes the shape of the other, which is
    /// possible only until the arm reaches the first one.
    fn go_on_with_spline(&mut self, before: usize, arm: &Arm) -> Option<Appended> {
        let (joined, is_shaped) = self.joined(before, arm)?;
        let is_ahead = self.is_ahead(before);
        if joined.is_some_and(|joined| self.take_if_feasible(before, joined, arm)) {
            return Some(Appended::Planned);
        }
        if is_shaped {
            self.straighten_last(before, arm);
        }
        self.stop_after(before);
        self.plan_last();
        Some(if is_ahead { Appended::Planned } else { Appended::Late })
    }

    /// Returns the last motion and the one before it as pieces of one spline, where the arm can follow that, and whether the last one
    /// has its shape already; none where they are not both of a spline.
    pub(super) fn joined(&self, before: usize, arm: &Arm) -> Option<(Option<Joined>, bool)> {
        let (one, next) = (self.queue.get(before)?, self.queue.back()?);
        let (Curve::Spline(first), Curve::Spline(second)) = (&one.segment.curve, &next.segment.curve) else {
            return None;
        };
        let is_shaped = second.before() == Some(*first.from());
        let goes_on = self.is_ahead(before) && first.goes_on_to(second);
        let joined = if goes_on { self.join(before, (first, second), is_shaped, arm) } else { None };
        Some((joined, is_shaped))
    }

    /// Two motions of a spline as pieces of one; none where the arm cannot follow that.
    fn join(
        &self,
        before: usize,
        (first, second): (&Spline, &Spline),
        is_shaped: bool,
        arm: &Arm,
    ) -> Option<Joined> {
        let corner = before.checked_sub(1).and_then(|index| self.queue.get(index));
        let start = corner.map_or(&self.start, |corner| &corner.segment.end);
        let shape = first.with_neighbours(first.before(), Some(*second.to()));
        let one = self.queue.get(before)?.segment.reshaped(shape, start, arm)?;
        let next = if is_shaped {
            None
        } else {
            let shape = second.with_neighbours(Some(*first.from()), None);
            Some(self.queue.back()?.segment.reshaped(shape, &one.end, arm)?)
        };
        let corner = corner
            .filter(|corner| corner.corner.is_some())
            .map(|corner| Blend::after_zone(corner.zone, &corner.segment, &one, 1.0, arm));
        Some(Joined { one, next, corner })
    }

    /// Replaces two motions by pieces of one spline and plans. Returns false and changes nothing where the arm cannot
    /// continue into that.
    fn take_if_feasible(&mut self, before: usize, mut joined: Joined, arm: &Arm) -> bool {
        let changed = self.take_joined(before, &mut joined, arm);
        let is_feasible = self.plan(&changed);
        if !is_feasible {
            self.swap(before, &mut joined, arm);
            self.set_goes_on(before, false);
        }
        is_feasible
    }

    /// Replaces two motions by pieces of one spline, which `joined` then holds. Returns from where on the path changes.
    pub(super) fn take_joined(&mut self, before: usize, joined: &mut Joined, arm: &Arm) -> Spot {
        // Its shape changes from its start on, or from the corner there on.
        let corner = before.checked_sub(1).filter(|_| joined.corner.is_some());
        let was = corner.map(|corner| self.leaves(corner).way);
        self.swap(before, joined, arm);
        self.set_goes_on(before, true);
        match (corner, was) {
            (Some(corner), Some(was)) => self.place_of(corner, was.min(self.leaves(corner).way)),
            _ => self.place_of(before, 0.0),
        }
    }

    fn swap(&mut self, before: usize, joined: &mut Joined, arm: &Arm) {
        if let Some(planned) = self.queue.get_mut(before) {
            core::mem::swap(&mut planned.segment, &mut joined.one);
        }
        if let Some(next) = &mut joined.next {
            let was = self.queue.back().map(|last| last.segment.clone());
            self.set_last(next.clone(), arm);
            *next = was.unwrap_or_else(|| next.clone());
        }
        if let (Some(corner), Some(blend)) = (before.checked_sub(1), &mut joined.corner) {
            let was = self.queue.get(corner).and_then(|planned| planned.corner.clone());
            self.set_blend(corner, core::mem::replace(blend, was));
        }
    }

    /// The last piece of a spline begins at a stop after all: it becomes a straight line, as a single one is, if the
    /// arm can follow that.
    pub(super) fn straighten_last(&mut self, before: usize, arm: &Arm) {
        let (Some(before), Some(last)) = (self.queue.get(before), self.queue.back()) else { return };
        let Curve::Spline(piece) = &last.segment.curve else { return };
        let alone = piece.with_neighbours(None, None);
        if let Some(straight) = last.segment.reshaped(alone, &before.segment.end, arm) {
            self.set_last(straight, arm);
        }
    }

    /// Returns whether the arm has not reached this motion nor the corner before it.
    pub(super) fn is_ahead(&self, index: usize) -> bool {
        if index >= self.queue.len() {
            return false;
        }
        if index == 0 { !self.in_blend() && self.is_at_start() } else { index > usize::from(self.in_blend()) }
    }

    pub(super) fn set_goes_on(&mut self, index: usize, goes_on: bool) {
        if let Some(planned) = self.queue.get_mut(index) {
            planned.goes_on = goes_on;
        }
    }

    /// Gives the last motion another shape.
    fn set_last(&mut self, segment: Segment, arm: &Arm) {
        let Some(last) = self.queue.back_mut() else { return };
        if !last.stops && last.segment.curve != segment.curve {
            last.zone = blend::wanted_zone(&segment, arm);
        }
        self.end = segment.end;
        last.segment = segment;
    }

    /// Says that no motion will follow: the last one stops at its end as intended.
    pub fn close(&mut self) {
        if let Some(last) = self.queue.back_mut() {
            last.stops = true;
        }
    }

    pub(super) fn set_blend(&mut self, index: usize, blend: Option<Blend>) {
        let start = blend.as_ref().map_or(0.0, |blend| blend.to_zone);
        if let Some(planned) = self.queue.get_mut(index) {
            planned.corner = blend;
        }
        if let Some(next) = self.queue.get_mut(index + 1) {
            next.start = start;
        }
    }

    pub(super) fn stop_after(&mut self, index: usize) {
        if let Some(planned) = self.queue.get_mut(index) {
            planned.stops = true;
        }
    }
}
