//! Where the arm stops although the plan passes: corners that it cannot follow, and splines that it cannot bend into.
//!
//! These are no errors of the robot. Its look-ahead makes the corners by [`Blend`] and joins splines by
//! [`Segment::reshaped`]; where neither is possible, it stops exactly at the target. The same code finds them before a run.

use std::fmt;

use arm::motion::{Blend, Curve, Hindrance, Segment};
use arm::{Arm, Joints};

use crate::out_of_reach::Missing;

/// A place at which the arm stops exactly although the plan passes it. Prints itself as a warning.
#[derive(Clone, PartialEq, Debug)]
pub struct Stopped {
    /// Number of the motion before it in the plan, from 1.
    pub number: usize,
    /// The names of the motions before and after it.
    pub names: [String; 2],
    /// The zone between them, in mm.
    pub zone_mm: f64,
    /// What the arm cannot follow there.
    pub unfit: Unfit,
}

/// What the arm cannot follow between two motions.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Unfit {
    /// The spline of both.
    Spline,
    /// The spline of both, which turns back there, so that the arm stops wherever it stands.
    TurnsBack,
    /// The corner: where on it, and why; none where no corner is left within the zone.
    Corner(Option<Hindrance>),
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { number, names: [one, other], zone_mm, unfit } = self;
        write!(f, "motion {number} `{one}` will stop exactly before motion {} `{other}`: ", number + 1)?;
        match unfit {
            Unfit::Spline => {
                return f.write_str(
                    "the arm cannot follow the spline of both; move the frames, or add one between",
                );
            }
            Unfit::TurnsBack => {
                return f.write_str("the spline turns back there; move the frames, or add one between");
            }
            Unfit::Corner(Some(Hindrance { share, violation })) => {
                let percent = 100.0 * share;
                write!(f, "after {percent:.0} % of the corner in the zone of {zone_mm:.2} mm, {violation}")?;
                if let Some(missing) = violation.missing() {
                    write!(f, "; {}", Missing(missing))?;
                }
            }
            Unfit::Corner(None) => {
                write!(f, "the arm cannot round the corner in the zone of {zone_mm:.2} mm")?
            }
        }
        f.write_str("; lower approximation_mm, or move the frames")
    }
}

/// The last motions of a continuous motion, as the robot's look-ahead has them.
pub(crate) struct Course {
    /// The robot's cycle, in s.
    cycle_s: f64,
    /// The motion before the last one, if there is a corner between them that is still to be checked: a successor may bend
    /// the last one.
    before: Option<Segment>,
    /// The last motion and the joints at its start, unless the arm is to stop at its end.
    last: Option<(Segment, Joints)>,
}

impl Course {
    /// A motion that is still to begin.
    pub(crate) const fn new(cycle_s: f64) -> Self {
        Self { cycle_s, before: None, last: None }
    }

    /// Returns the last motion, unless the arm is to stop at its end.
    pub(crate) fn last(&self) -> Option<&Segment> {
        self.last.as_ref().map(|(segment, _)| segment)
    }

    /// Appends a motion that starts at the joints `from`. `ends` says that the arm is to stop at its end, and `stands` that it
    /// stands at its start. Tells `stopped` of each place at which the arm stops although it is to pass: how many motions
    /// begin between there and the end of this one, and what does not fit.
    pub(crate) fn append(
        &mut self,
        (segment, from): (Segment, Joints),
        [stands, ends]: [bool; 2],
        arm: &Arm,
        mut stopped: impl FnMut(usize, Unfit),
    ) {
        let mut last = self.last.take();
        let joint = last
            .as_mut()
            .filter(|_| !stands)
            .map(|(last, start)| join(last, start, &segment, arm, self.cycle_s));
        if let (Some(before), Some((last, _))) = (self.before.take(), &last) {
            check_corner(&before, last, arm).into_iter().for_each(|unfit| stopped(2, unfit));
        }
        match (joint, last) {
            (Some(Joint::Stop(unfit)), _) => stopped(1, unfit),
            (Some(Joint::Corner), Some((last, _))) if ends => {
                check_corner(&last, &segment, arm).into_iter().for_each(|unfit| stopped(1, unfit));
            }
            (Some(Joint::Corner), Some((last, _))) => self.before = Some(last),
            _ => {}
        }
        self.last = (!ends).then_some((segment, from));
    }
}

/// How one motion goes on to the next.
enum Joint {
    /// As one curve.
    Planned,
    /// By a corner.
    Corner,
    /// Not at all.
    Stop(Unfit),
}

/// Joins two motions as the robot does, which bends the first one if both are motions of a spline.
fn join(last: &mut Segment, start: &Joints, next: &Segment, arm: &Arm, cycle_s: f64) -> Joint {
    match (&last.curve, &next.curve) {
        (Curve::Line(_), Curve::Line(_)) if last.goes_straight_on_to(next, arm, cycle_s) => Joint::Planned,
        (Curve::Spline(first), Curve::Spline(second)) if !first.goes_on_to(second) => {
            Joint::Stop(Unfit::TurnsBack)
        }
        (Curve::Spline(first), Curve::Spline(second)) => {
            let is_bent = second.before() == Some(*first.from());
            let shape = first.with_neighbours(first.before(), Some(*second.to()));
            match last.reshaped(shape, start, arm).filter(|_| is_bent) {
                Some(bent) => {
                    *last = bent;
                    Joint::Planned
                }
                None => Joint::Stop(Unfit::Spline),
            }
        }
        _ => Joint::Corner,
    }
}

fn check_corner(first: &Segment, second: &Segment, arm: &Arm) -> Option<Unfit> {
    let is_possible = Blend::between(first, second, 1.0, arm).is_some();
    (!is_possible).then(|| Unfit::Corner(Blend::hindrance(first, second, arm)))
}
