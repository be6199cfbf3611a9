//! Several motions that come in one robot cycle: each is appended, and the law is planned once after the last one.
//!
//! A batch is taken whole or not at all. Where no law leads into it, [`Path::end_batch`] restores the path, and the motions come
//! again in a later cycle; at rest they are appended one by one, by [`Path::append`].

use super::blend::{self, Blend};
use super::curve::Curve;
use super::path::{Batch, Path, Planned};
use super::piece::Spot;
use super::segment::Segment;
use crate::arm::Arm;

impl Path {
    /// Begins a batch.
    pub fn begin_batch(&mut self) {
        let motions = self.queue.len();
        let before = |back: usize| motions.checked_sub(back).and_then(|index| self.queue.get(index)).cloned();
        let last = [before(1), before(2)];
        self.batch = Some(Batch { motions, end: self.end, last, changed: None, is_late: false });
    }

    /// Appends a motion of a batch that starts at [`end`](Self::end) and plans nothing. `last` says that none follows.
    pub fn append_to_batch(&mut self, segment: Segment, last: bool, arm: &Arm) {
        let Some(mut batch) = self.batch.take() else { return };
        let before = self.push(segment, last, arm);
        let changed = match before {
            Some(before) => self.connect(before, arm),
            None => Some(self.start_of_last()),
        };
        batch.is_late |= changed.is_none();
        if let Some(place) = changed {
            batch.changed =
                Some(batch.changed.map_or(place, |first| if place < first { place } else { first }));
        }
        self.batch = Some(batch);
    }

    /// Plans the law once for all motions of the batch. Returns false, with the path as it was before the batch, where a motion came
    /// too late.
    pub fn end_batch(&mut self) -> bool {
        let Some(batch) = self.batch.take() else { return true };
        let Some(changed) = batch.changed.filter(|_| !batch.is_late) else {
            let is_empty = self.queue.len() == batch.motions;
            if !is_empty {
                self.undo(batch);
            }
            return is_empty;
        };
        let is_planned = self.plan(&changed);
        if !is_planned {
            self.undo(batch);
        }
        is_planned
    }

    fn undo(&mut self, batch: Batch) {
        let Batch { motions, end, last, .. } = batch;
        self.queue.truncate(motions);
        self.end = end;
        for (back, planned) in (1..).zip(last) {
            let index = motions.checked_sub(back);
            if let (Some(place), Some(planned)) = (index.and_then(|index| self.queue.get_mut(index)), planned)
            {
                *place = planned;
            }
        }
    }

    /// Connects the last motion with the one before it: as one line or one spline, by a corner, or by a stop. Returns from where on
    /// the path changes; none where the motion is too late.
    fn connect(&mut self, before: usize, arm: &Arm) -> Option<Spot> {
        let (one, next) = (self.queue.get(before)?, self.queue.back()?);
        match (&one.segment.curve, &next.segment.curve) {
            (Curve::Line(_), Curve::Line(_))
                if one.segment.goes_straight_on_to(&next.segment, arm, self.cycle_s) =>
            {
                self.set_goes_on(before, true);
                return Some(self.leaves(before));
            }
            (Curve::Spline(_), Curve::Spline(_)) => return self.connect_spline(before, arm),
            _ => {}
        }
        let blend = Blend::after_zone(one.zone, &one.segment, &next.segment, 1.0, arm);
        let is_corner = blend.is_some();
        self.set_blend(before, blend);
        Some(if is_corner { self.leaves(before) } else { self.start_of_last() })
    }

    fn connect_spline(&mut self, before: usize, arm: &Arm) -> Option<Spot> {
        if !self.is_ahead(before) {
            return None;
        }
        let (joined, is_shaped) = self.joined(before, arm)?;
        if let Some(mut joined) = joined {
            return Some(self.take_joined(before, &mut joined, arm));
        }
        if is_shaped {
            self.straighten_last(before, arm);
        }
        self.stop_after(before);
        Some(self.start_of_last())
    }

    /// Appends a motion to the queue alone. Returns the number of the one before, if the path may go on from that without a stop.
    pub(super) fn push(&mut self, segment: Segment, last: bool, arm: &Arm) -> Option<usize> {
        self.end = segment.end;
        let before = self.queue.len().checked_sub(1);
        let is_over = last || segment.approximation_mm == 0.0;
        let zone = if is_over { 0.0 } else { blend::wanted_zone(&segment, arm) };
        let planned = Planned { zone, stops: is_over, start: 0.0, corner: None, goes_on: false, segment };
        self.queue.push_back(planned);
        before.filter(|before| self.queue.get(*before).is_some_and(|planned| !planned.stops))
    }

    /// The place at which the last motion begins.
    fn start_of_last(&self) -> Spot {
        self.place_of(self.queue.len().saturating_sub(1), 0.0)
    }
}
