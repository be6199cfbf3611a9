//! Where the target of a planned motion comes from: what one changes in an application to move it.

use std::fmt;

use crate::application::{Application, Course, Place, Segment};
use crate::motion::{Motion, Role};

/// What in an application decides where a motion ends.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Source {
    /// This frame.
    Frame(String),
    /// This frame, at which a path begins, and the step's `approach_mm`.
    Approach(String),
    /// This frame, at which a path ends, and the step's `retreat_mm`.
    Retreat(String),
    /// The frames before and after it, and the obstacle between them.
    Obstacle,
}

impl Source {
    /// Finds what decides where a planned motion of an application ends; none for a motion that was not planned from it.
    pub(crate) fn of(motion: &Motion, application: &Application) -> Option<Self> {
        let ends_at = |place: &Place| {
            (0..application.cells()).any(|cell| application.pose(place, cell).point == motion.target.point)
        };
        let frame = |place: &Place| Self::Frame(place.name.clone());
        let (start, course) = (&application.start.0, &application.steps.get(motion.step)?.course);
        match (motion.role, course) {
            (Role::ToStart, _) if ends_at(start) => Some(frame(start)),
            (Role::ToStart | Role::Crossing, _) => Some(Self::Obstacle),
            (_, Course::Reach(place)) => Some(frame(place)),
            (Role::Way, Course::Follow { from, approach_mm, .. }) => match from.as_ref()? {
                from if *approach_mm > 0.0 => Some(Self::Approach(from.name.clone())),
                from => Some(frame(from)),
            },
            (Role::PreMovement, Course::Follow { from, .. }) => from.as_ref().map(frame),
            (Role::Path, Course::Follow { segments, .. }) => {
                segments.iter().flat_map(Segment::places).find(|place| ends_at(place)).map(frame)
            }
            (Role::PostMovement, Course::Follow { segments, .. }) => {
                let end = segments.last()?.places().last()?;
                Some(Self::Retreat(end.name.clone()))
            }
        }
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame(frame) => write!(f, "frame `{frame}`"),
            Self::Approach(frame) => write!(f, "frame `{frame}` or the step's approach_mm"),
            Self::Retreat(frame) => write!(f, "frame `{frame}` or the step's retreat_mm"),
            Self::Obstacle => f.write_str("the frames before and after it or the obstacle between them"),
        }
    }
}
