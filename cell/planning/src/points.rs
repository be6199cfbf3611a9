//! A list of points as compact points: one head, and each point's difference from the one before it.

use protocol::image::{ErrorNumber, Motion, PointDifference, PointHead, PointMisfit, PointSum};

/// Points of a trajectory in the form in which the PLC sends them.
#[derive(Clone, PartialEq, Debug)]
pub struct CompactPath {
    /// Head of all points, with the origin.
    pub head: PointHead,
    /// Differences of each point from the one before it, the first one from the origin.
    pub differences: Vec<PointDifference>,
}

/// Why a list of points has no compact form.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum CompactError {
    /// A field of the head.
    #[error("{0}")]
    Head(String),
    /// A step that no difference carries.
    #[error("point {index}: {misfit}; choose a coarser resolution or a closer spacing")]
    Step {
        /// Which point, counted from 0.
        index: usize,
        /// The coordinate and its step.
        misfit: PointMisfit,
    },
    /// A point that is the same as the one before it once both are whole steps.
    #[error(
        "point {index} is where the point before it is, in steps of {resolution_um} µm: choose a finer resolution, or leave it out"
    )]
    NoWay {
        /// Which point, counted from 0.
        index: usize,
        /// Length of a step in µm.
        resolution_um: f64,
    },
}

impl CompactPath {
    /// Converts targets (x, y, z in mm; a, b, c in degrees) that follow on the origin of the head.
    ///
    /// # Errors
    ///
    /// [`CompactError`]: the head, or the first point that has no compact form.
    pub fn of(head: PointHead, targets: impl IntoIterator<Item = [f64; 6]>) -> Result<Self, CompactError> {
        head.check().map_err(|(number, finding): (ErrorNumber, _)| {
            CompactError::Head(finding.in_words(number).to_string())
        })?;
        let mut sum = PointSum::default();
        let differences = targets.into_iter().enumerate().map(|(index, target)| {
            let difference =
                sum.advance(&head, target).map_err(|misfit| CompactError::Step { index, misfit })?;
            if difference == PointDifference::default() {
                let resolution_um = head.resolution_um();
                return Err(CompactError::NoWay { index, resolution_um });
            }
            Ok(difference)
        });
        Ok(Self { head, differences: differences.collect::<Result<_, _>>()? })
    }

    /// Converts targets that follow on this origin, reached by motions that are like this one in all else. Angles differ from point to
    /// point only where a target turns the tool. Without a resolution, in 0.01 µm, the steps are the finest that carry the longest way.
    ///
    /// # Errors
    ///
    /// Those of [`of`](Self::of).
    pub fn like(
        motion: &Motion,
        origin: [f64; 6],
        targets: &[[f64; 6]],
        resolution: Option<u16>,
    ) -> Result<Self, CompactError> {
        let turns = targets.iter().any(|target| target[3..] != origin[3..]);
        let resolution = resolution.unwrap_or_else(|| Self::finest_resolution(origin, targets));
        let motion = Motion { target: origin.map(|coordinate| coordinate as f32), ..*motion };
        let head = PointHead::of(&motion, resolution, if turns { 6 } else { 3 });
        Self::of(head, targets.iter().copied())
    }

    /// Returns the motions to the points, whose targets are whole steps from the origin.
    pub fn motions(&self) -> impl Iterator<Item = Motion> {
        self.differences.iter().scan(PointSum::default(), |sum, difference| {
            sum.add(*difference);
            Some(sum.motion(&self.head))
        })
    }

    /// Returns the finest resolution, in 0.01 µm, whose differences carry the steps from each target to the next one, the first one
    /// from the origin; the coarsest one if none does.
    #[must_use]
    pub fn finest_resolution(origin: [f64; 6], targets: &[[f64; 6]]) -> u16 {
        let before = std::iter::once(&origin).chain(targets);
        let steps = before
            .zip(targets)
            .flat_map(|(one, other)| std::iter::zip(one, other).map(|(one, other)| (other - one).abs()));
        let longest = steps.fold(0.0, f64::max);
        // Both ends are rounded, by at most half a step each.
        let needed = (longest * PointHead::STEPS_PER_UNIT / f64::from(i16::MAX - 1)).ceil();
        needed.clamp(PointHead::FINEST.into(), PointHead::COARSEST.into()) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::image::MotionKind;

    const HEAD: PointHead = PointHead::of(
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
        3,
    );

    fn along_y(places: &[f64]) -> Vec<[f64; 6]> {
        places.iter().map(|y| [400.0, *y, 100.0, 0.0, 0.0, 180.0]).collect()
    }

    #[test]
    fn a_list_that_does_not_fit_is_refused_with_the_first_point_that_does_not() {
        let refused = |head, places: &[f64]| CompactPath::of(head, along_y(places)).unwrap_err().to_string();
        let coarse = PointHead { resolution: 1_000, ..HEAD };
        insta::assert_snapshot!([
            refused(HEAD, &[1.0, 2.0, 5.0, 6.0]),
            refused(coarse, &[1.0, 1.004, 2.0]),
            refused(PointHead { resolution: 1_001, ..HEAD }, &[1.0]),
            refused(PointHead { kind: MotionKind::PtpJoint, ..HEAD }, &[1.0]),
        ].join("\n"), @"
        point 2: y is 3 mm from the point before: a difference carries at most 1.63835 mm; choose a coarser resolution or a closer spacing
        point 1 is where the point before it is, in steps of 10 µm: choose a finer resolution, or leave it out
        the head of the compact points cannot be used (its resolution is 10.01 µm, allowed is 0.01 to 10 µm)
        this robot does not run this kind of motion
        ");
    }

    #[test]
    fn the_finest_resolution_carries_the_longest_step_and_a_finer_one_does_not() {
        let origin = HEAD.origin.map(f64::from);
        for step in [0.25, 0.327, 1.0, 17.3, 300.0] {
            let places = along_y(&[step, 2.0 * step, step]);
            let resolution = CompactPath::finest_resolution(origin, &places);
            let fits = |resolution| CompactPath::of(PointHead { resolution, ..HEAD }, places.clone()).is_ok();
            assert!(fits(resolution), "{step} at {resolution}");
            assert!(resolution == 1 || !fits(resolution - 1), "{step} at {resolution}");
        }
    }

    #[test]
    fn two_hundred_thousand_points_end_where_the_list_ends() {
        let places: Vec<_> = (1..=200_000).map(|point| f64::from(point) * 0.010_01).collect();
        let path = CompactPath::of(PointHead { resolution: 1, ..HEAD }, along_y(&places)).unwrap();
        let sum: i64 = path.differences.iter().map(|difference| i64::from(difference[1])).sum();
        assert_eq!(sum, 200_200_000);
    }
}
