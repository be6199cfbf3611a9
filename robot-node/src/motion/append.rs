//! One more motion at the end of the path: its corner, or a spline that goes on.

use super::along;
use super::blend::{self, Blend};
use super::curve::Curve;
use super::path::{Corner, Law, Path, Planned};
use super::profile::Pace;
use super::segment::Segment;
use crate::arm::Arm;

/// What came of one more motion.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Appended {
    /// It is on the path.
    Planned,
    /// It is on the path, but came too late for the corner before it, which is an exact stop.
    Late,
}

impl Path {
    /// Puts one more motion, which starts at [`end`](Self::end), at the end of the path. `last` says that none
    /// follows.
    pub fn append(&mut self, segment: Segment, last: bool, arm: &Arm) -> Appended {
        self.end = segment.end;
        let before = self.queue.len().checked_sub(1);
        let is_over = last || segment.approximation_mm == 0.0;
        self.queue.push_back(Planned {
            segment,
            zone: if is_over { 0.0 } else { blend::wanted_zone(&segment, arm) },
            stops: is_over,
            straight: Law::at_rest(0.0),
            corner: None,
            goes_on: false,
        });
        let open = before.filter(|before| self.queue.get(*before).is_some_and(|planned| !planned.stops));
        let Some(before) = open else {
            self.plan();
            return Appended::Planned;
        };
        if let Some(appended) = self.go_on(before, arm) {
            return appended;
        }
        for share in [1.0, 0.5, 0.25] {
            let blend = match (self.queue.get(before), self.queue.back()) {
                (Some(before), Some(last)) => Blend::between(&before.segment, &last.segment, share, arm),
                _ => None,
            };
            self.set_blend(before, blend);
            if blend.is_none() || self.is_feasible() {
                self.plan();
                return Appended::Planned;
            }
        }
        self.set_blend(before, None);
        self.stop_after(before);
        self.plan();
        Appended::Late
    }

    /// Makes the last motion and the one before it pieces of one spline, if both are motions of one. Both take their
    /// shape from each other, which is only possible until the arm comes to the first one.
    fn go_on(&mut self, before: usize, arm: &Arm) -> Option<Appended> {
        let (one, next) = (self.queue.get(before)?, self.queue.back()?);
        let (Curve::Spline(first), Curve::Spline(second)) = (&one.segment.curve, &next.segment.curve) else {
            return None;
        };
        let is_ahead = if before == 0 {
            !self.place.in_blend
                && one.straight.from == 0.0
                && self.place.time == 0.0
                && one.straight.profile.at(0.0).1 == Pace::REST
        } else {
            before > usize::from(self.place.in_blend)
        };
        let separate = (one.segment, next.segment);
        let joined = (is_ahead && first.goes_on_to(second)).then(|| {
            let shapes = (
                first.with_neighbours(first.before(), Some(*second.to())),
                second.with_neighbours(Some(*first.from()), None),
            );
            let corner = before.checked_sub(1).and_then(|index| self.queue.get(index));
            let start = corner.map_or(self.start, |corner| corner.segment.end);
            let one = along::reshaped(&separate.0, shapes.0, &start, arm)?;
            let next = along::reshaped(&separate.1, shapes.1, &one.end, arm)?;
            let old = corner.and_then(Planned::blend);
            let new = corner
                .filter(|_| old.is_some())
                .and_then(|corner| Blend::between(&corner.segment, &one, 1.0, arm));
            Some(((one, next), old, new))
        });
        if let Some((pieces, old, new)) = joined.flatten() {
            self.set_pieces(before, pieces, true);
            if let Some(corner) = before.checked_sub(1).filter(|_| old.is_some()) {
                self.set_blend(corner, new);
            }
            if self.is_feasible() {
                self.plan();
                return Some(Appended::Planned);
            }
            self.set_pieces(before, separate, false);
            if let Some(corner) = before.checked_sub(1).filter(|_| old.is_some()) {
                self.set_blend(corner, old);
            }
        }
        self.stop_after(before);
        self.plan();
        Some(if is_ahead { Appended::Planned } else { Appended::Late })
    }

    fn set_pieces(&mut self, before: usize, pieces: (Segment, Segment), goes_on: bool) {
        self.end = pieces.1.end;
        if let Some(planned) = self.queue.get_mut(before) {
            (planned.segment, planned.goes_on) = (pieces.0, goes_on);
        }
        if let Some(planned) = self.queue.back_mut() {
            planned.segment = pieces.1;
        }
    }

    /// No motion will follow: the last one stops at its end, and that is as wanted.
    pub fn close(&mut self) {
        if let Some(last) = self.queue.back_mut() {
            last.stops = true;
        }
    }

    fn set_blend(&mut self, index: usize, blend: Option<Blend>) {
        if let Some(planned) = self.queue.get_mut(index) {
            planned.corner = blend.map(|blend| Corner { blend, law: Law::at_rest(0.0) });
        }
        if let Some(next) = self.queue.get_mut(index + 1) {
            next.straight.from = blend.map_or(0.0, |blend| blend.to_zone);
        }
    }

    fn stop_after(&mut self, index: usize) {
        if let Some(planned) = self.queue.get_mut(index) {
            planned.stops = true;
        }
    }
}
