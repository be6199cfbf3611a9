//! Compact points: the second form of bytes 36..256 of a command, with [`Skill::MoveTrajectory`](super::Skill::MoveTrajectory).
//!
//! ```text
//! 36..60 origin          6 × f32   mm and degrees
//! 60..62 velocity        u16       0.1 mm/s
//! 62..64 acceleration    u16       1 mm/s²
//! 64..66 deceleration    u16       1 mm/s²; 0 is the same as the acceleration
//! 66..68 jerk            u16       10 mm/s³; 0 is the robot's own
//! 68..70 zone            u16       0.01 mm
//! 70     kind            u8        LIN or SPLINE
//! 71     tool and base   u8        tool in the high four bits, base in the low four
//! 72..74 resolution      u16       0.01 µm (0.00001°): the length of a step
//! 74     coordinates     u8        3 or 6
//! 75     content         u8        0
//! 76..256 ring           90 × i16  30 points of three differences, or 15 of six, in steps
//! ```
//!
//! A difference counts from the point before it. Its sum is kept in integers, so that it does not drift.

use core::fmt;

use super::{ErrorNumber, Finding, HEAD_LEN, IMAGE_LEN, Motion, MotionKind};
use machine::wire::{ByteOrder, Reader, Truncated, Writer};

/// First byte of the ring.
pub const RING_AT: usize = 76;

/// Differences in the ring.
pub const RING_DIFFERENCES: usize = 90;

const _: () = assert!(RING_AT + 2 * RING_DIFFERENCES == IMAGE_LEN);

/// Differences of one point from the one before, in steps: x, y, z, a, b, c.
pub type PointDifference = [i16; 6];

/// Head of the points of a trajectory, which holds for all of them: bytes 36..76.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct PointHead {
    /// Place from which the first difference counts: x, y, z in mm, a, b, c in degrees, of the tool in the base.
    pub origin: [f32; 6],
    /// Path velocity in 0.1 mm/s.
    pub velocity: u16,
    /// Path acceleration in 1 mm/s².
    pub acceleration: u16,
    /// Path deceleration in 1 mm/s²; 0 is the same as the acceleration.
    pub deceleration: u16,
    /// Path jerk in 10 mm/s³; 0 is the robot's own.
    pub jerk: u16,
    /// Approximation distance in 0.01 mm.
    pub approximation: u16,
    /// Kind of each motion: [`MotionKind::LinCartesian`] or [`MotionKind::Spline`].
    pub kind: MotionKind,
    /// Number of the tool frame, 0..=15.
    pub tool: u8,
    /// Number of the base frame, 0..=15.
    pub base: u8,
    /// Length of a step in 0.01 µm (0.00001°).
    pub resolution: u16,
    /// Coordinates that differ from point to point: 3 or 6.
    pub coordinates: u8,
    /// Content of the ring; 0 is positions.
    pub content: u8,
}

impl PointHead {
    /// Finest resolution, in 0.01 µm.
    pub const FINEST: u16 = 1;
    /// Coarsest resolution, in 0.01 µm.
    pub const COARSEST: u16 = 1_000;
    /// Steps of the finest resolution in 1 mm, or 1 degree.
    pub const STEPS_PER_UNIT: f64 = 100_000.0;

    /// Creates the head of points that follow on the target of a motion and are like it in all else.
    #[must_use]
    pub const fn of(motion: &Motion, resolution: u16, coordinates: u8) -> Self {
        Self {
            origin: motion.target,
            velocity: motion.velocity,
            acceleration: motion.acceleration,
            deceleration: motion.deceleration,
            jerk: motion.jerk,
            approximation: motion.approximation,
            kind: motion.kind,
            tool: motion.tool,
            base: motion.base,
            resolution,
            coordinates,
            content: 0,
        }
    }

    /// Returns how many points the ring holds.
    #[must_use]
    pub const fn capacity(&self) -> u32 {
        (RING_DIFFERENCES / self.differing()) as u32
    }

    /// Returns how many coordinates differ from point to point: the angles too, or the place only.
    const fn differing(&self) -> usize {
        if self.coordinates == 6 { 6 } else { 3 }
    }

    /// Returns the length of a step in µm (0.001°).
    #[must_use]
    pub fn resolution_um(&self) -> f64 {
        f64::from(self.resolution) / 100.0
    }

    /// Returns the differences of point `index`, counted from 0, in a ring; those of the angles are 0 where they do not differ.
    #[must_use]
    pub fn difference_in(&self, ring: &[i16; RING_DIFFERENCES], index: u32) -> PointDifference {
        let mut all = PointDifference::default();
        let (first, coordinates) = self.place(index);
        let place = ring.get(first..first + coordinates).unwrap_or_default();
        all.iter_mut().zip(place).for_each(|(one, difference)| *one = *difference);
        all
    }

    /// Returns the first difference of a point in the ring, and how many it has.
    const fn place(&self, index: u32) -> (usize, usize) {
        ((index % self.capacity()) as usize * self.differing(), self.differing())
    }

    /// Checks what only this form has. The robot checks the rest as that of a motion.
    ///
    /// # Errors
    ///
    /// The field, its value and its limits.
    pub fn check(&self) -> Result<(), (ErrorNumber, Finding)> {
        let head = |index, value: f32, lower, upper| {
            Err((ErrorNumber::PointHead, Finding::new(index, value, lower, upper)))
        };
        if !(Self::FINEST..=Self::COARSEST).contains(&self.resolution) {
            return head(1, f32::from(self.resolution) / 100.0, 0.01, 10.0);
        }
        if !matches!(self.coordinates, 3 | 6) {
            return head(2, self.coordinates.into(), 3.0, 6.0);
        }
        if self.content != 0 {
            return head(3, self.content.into(), 0.0, 0.0);
        }
        match self.kind {
            MotionKind::LinCartesian | MotionKind::Spline => Ok(()),
            _ => Err((ErrorNumber::MotionKindNotSupported, Finding::NONE)),
        }
    }

    fn parse<O: ByteOrder>(reader: &mut Reader<'_, O>) -> Result<Self, Truncated> {
        let mut origin = [0.0; 6];
        for coordinate in &mut origin {
            *coordinate = reader.f32()?;
        }
        let [velocity, acceleration, deceleration, jerk, approximation] =
            [reader.u16()?, reader.u16()?, reader.u16()?, reader.u16()?, reader.u16()?];
        let (kind, frames) = (reader.u8()?.into(), reader.u8()?);
        Ok(Self {
            origin,
            velocity,
            acceleration,
            deceleration,
            jerk,
            approximation,
            kind,
            tool: frames >> 4,
            base: frames & 0x0F,
            resolution: reader.u16()?,
            coordinates: reader.u8()?,
            content: reader.u8()?,
        })
    }

    fn emit<O: ByteOrder>(&self, writer: &mut Writer<'_, O>) {
        self.origin.iter().for_each(|coordinate| writer.f32(*coordinate));
        let Self { velocity, acceleration, deceleration, jerk, approximation, .. } = *self;
        [velocity, acceleration, deceleration, jerk, approximation]
            .into_iter()
            .for_each(|value| writer.u16(value));
        writer.u8(self.kind.into());
        writer.u8(self.tool << 4 | self.base & 0x0F);
        writer.u16(self.resolution);
        writer.u8(self.coordinates);
        writer.u8(self.content);
    }
}

/// The second form of bytes 36..256.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct CompactPoints {
    /// Head of all points.
    pub head: PointHead,
    /// Differences in the order of the image: point `k` in place `k mod 30`, or `k mod 15`.
    pub ring: [i16; RING_DIFFERENCES],
}

impl CompactPoints {
    /// Creates the form with an empty ring.
    #[must_use]
    pub const fn new(head: PointHead) -> Self {
        Self { head, ring: [0; RING_DIFFERENCES] }
    }

    pub(super) fn parse<O: ByteOrder>(reader: &mut Reader<'_, O>) -> Result<Self, Truncated> {
        let mut points = Self::new(PointHead::parse(reader)?);
        for difference in &mut points.ring {
            *difference = reader.u16()?.cast_signed();
        }
        Ok(points)
    }

    pub(super) fn emit<O: ByteOrder>(&self, writer: &mut Writer<'_, O>) {
        self.head.emit(writer);
        self.ring.iter().for_each(|difference| writer.u16(difference.cast_unsigned()));
    }

    /// Returns the differences of point `index`, counted from 0.
    #[must_use]
    pub fn difference(&self, index: u32) -> PointDifference {
        self.head.difference_in(&self.ring, index)
    }

    /// Writes the differences of point `index`, counted from 0, into its place.
    pub fn set_difference(&mut self, index: u32, difference: PointDifference) {
        let (first, coordinates) = self.head.place(index);
        let place = self.ring.get_mut(first..first + coordinates).unwrap_or_default();
        place.iter_mut().zip(difference).for_each(|(place, difference)| *place = difference);
    }
}

/// Sum of the differences of all points so far, in steps.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct PointSum([i64; 6]);

impl PointSum {
    /// Adds the differences of the next point.
    pub fn add(&mut self, difference: PointDifference) {
        let sums = self.0.iter_mut().zip(difference);
        sums.for_each(|(sum, steps)| *sum = sum.saturating_add(i64::from(steps)));
    }

    /// Returns the last point that was added: x, y, z in mm, a, b, c in degrees.
    #[must_use]
    pub fn target(&self, head: &PointHead) -> [f64; 6] {
        let mut target = head.origin.map(f64::from);
        for (coordinate, steps) in target.iter_mut().zip(self.0) {
            *coordinate += steps.saturating_mul(head.resolution.into()) as f64 / PointHead::STEPS_PER_UNIT;
        }
        target
    }

    /// Returns the motion to the last point that was added, with its [target](Self::target) rounded to single precision.
    #[must_use]
    pub fn motion(&self, head: &PointHead) -> Motion {
        Motion {
            kind: head.kind,
            target: self.target(head).map(|coordinate| coordinate as f32),
            velocity: head.velocity,
            acceleration: head.acceleration,
            deceleration: head.deceleration,
            jerk: head.jerk,
            approximation: head.approximation,
            tool: head.tool,
            base: head.base,
            ..Motion::EMPTY
        }
    }

    /// Adds the point that is nearest to `target`, x, y, z in mm and a, b, c in degrees, and returns its differences.
    ///
    /// # Errors
    ///
    /// [`PointMisfit`] where a coordinate is farther from the point before than a difference reaches. Nothing is added then.
    pub fn advance(&mut self, head: &PointHead, target: [f64; 6]) -> Result<PointDifference, PointMisfit> {
        let mut difference = PointDifference::default();
        let coordinates = head.differing();
        let places = difference.iter_mut().zip(self.0).zip(target.into_iter().zip(head.origin));
        for (index, ((difference, sum), (target, origin))) in places.enumerate() {
            let steps = (target - f64::from(origin)) * PointHead::STEPS_PER_UNIT / f64::from(head.resolution);
            // Half a step away from zero; the sum stays far below 2^53, where numbers are whole.
            let rounded = (if steps < 0.0 { steps - 0.5 } else { steps + 0.5 }) as i64;
            let found = rounded.saturating_sub(sum);
            let most = if index < coordinates { i64::from(i16::MAX) } else { 0 };
            let least = if index < coordinates { i64::from(i16::MIN) } else { 0 };
            if !steps.is_finite() || !(least..=most).contains(&found) {
                let unit = f64::from(head.resolution) / PointHead::STEPS_PER_UNIT;
                let [step, reach] = [found as f64 * unit, most as f64 * unit];
                return Err(PointMisfit { coordinate: index as u8, step, reach });
            }
            *difference = found as i16;
        }
        self.add(difference);
        Ok(difference)
    }
}

/// A coordinate of a point that no difference carries.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct PointMisfit {
    /// Which coordinate, from 0: x, y, z, a, b, c.
    pub coordinate: u8,
    /// Its difference from the point before, in mm or degrees.
    pub step: f64,
    /// Largest difference that the resolution carries, in mm or degrees; 0 for angles where three coordinates differ.
    pub reach: f64,
}

impl fmt::Display for PointMisfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { coordinate, step, reach } = *self;
        let name = ["x", "y", "z", "a", "b", "c"].get(usize::from(coordinate)).unwrap_or(&"a coordinate");
        let unit = if coordinate < 3 { "mm" } else { "degrees" };
        write!(
            f,
            "{name} is {step} {unit} from the point before: a difference carries at most {reach} {unit}"
        )
    }
}

impl core::error::Error for PointMisfit {}

/// Content of bytes 36..256 of a command.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Slots {
    /// Five motions: motion `k` in slot `k mod 5`.
    Motions([Motion; super::SLOTS]),
    /// Compact points.
    Points(CompactPoints),
}

impl Slots {
    /// Five empty slots.
    pub const EMPTY: Self = Self::Motions([Motion::EMPTY; super::SLOTS]);

    /// Returns the compact points, if these are some.
    #[must_use]
    pub const fn points(&self) -> Option<&CompactPoints> {
        match self {
            Self::Points(points) => Some(points),
            Self::Motions(_) => None,
        }
    }
}

const _: () = assert!(HEAD_LEN + 40 == RING_AT);

#[cfg(test)]
mod tests;
