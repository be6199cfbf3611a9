//! What the judge can find, and how it says so.

use core::fmt;

/// A law that was broken. The order is the one in which a cycle is judged: the first one broken is reported.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Class {
    /// A joint is not a finite number.
    Finite,
    /// A joint is out of its range.
    Range,
    /// A joint moved farther in a robot cycle than its rated speed allows: the arm jumped.
    JointSpeed,
    /// A joint changed its speed more than its rated acceleration allows.
    JointAcceleration,
    /// A joint changed its acceleration more than its rated jerk allows.
    JointJerk,
    /// The tool is off its line or circle, outside the zones of the corners beside it.
    Course,
    /// The tool is turned otherwise than its line or circle turns it, outside the zones of the corners beside it.
    Turn,
    /// The tool is faster than the programmed velocity and the override allow.
    ToolSpeed,
    /// The tool is faster in a LIN force than the programmed velocity and the override allow.
    PressSpeed,
    /// The tool accelerates more than is programmed.
    ToolAcceleration,
    /// The tool's jerk is higher than the controller's.
    ToolJerk,
    /// A joint is faster point to point than the programmed share and the override allow.
    ShareOfSpeed,
    /// A joint accelerates more point to point than the programmed share allows.
    ShareOfAcceleration,
    /// `executed` fell, or ran ahead of what was accepted or commanded.
    Count,
    /// A motion counts as executed although the tool has not come to its zone, or did not pass or stop at its target.
    Executed,
    /// The arm stands where no motion ends.
    Stand,
    /// A skill is `Done` with motions missing or altered, or with the tool off the last target.
    Done,
    /// The state, or how the skill ended, contradicts what happened.
    State,
    /// A motion ended by an error in its middle: what was wrong was not found before the arm came there.
    LateError,
    /// Joints, pose, path speed or contact force of the feedback are not those of the arm.
    Feedback,
    /// The tool presses harder than asked for, or was done without pressing as asked for.
    Force,
    /// The skill does not go on.
    Stuck,
}

impl Class {
    /// All of them.
    pub const ALL: [Self; 22] = [
        Self::Finite,
        Self::Range,
        Self::JointSpeed,
        Self::JointAcceleration,
        Self::JointJerk,
        Self::Course,
        Self::Turn,
        Self::ToolSpeed,
        Self::PressSpeed,
        Self::ToolAcceleration,
        Self::ToolJerk,
        Self::ShareOfSpeed,
        Self::ShareOfAcceleration,
        Self::Count,
        Self::Executed,
        Self::Stand,
        Self::Done,
        Self::State,
        Self::LateError,
        Self::Feedback,
        Self::Force,
        Self::Stuck,
    ];

    /// Its name in tables and file names.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Finite => "finite",
            Self::Range => "range",
            Self::JointSpeed => "joint-speed",
            Self::JointAcceleration => "joint-acceleration",
            Self::JointJerk => "joint-jerk",
            Self::Course => "course",
            Self::Turn => "turn",
            Self::ToolSpeed => "tool-speed",
            Self::PressSpeed => "press-speed",
            Self::ToolAcceleration => "tool-acceleration",
            Self::ToolJerk => "tool-jerk",
            Self::ShareOfSpeed => "share-of-speed",
            Self::ShareOfAcceleration => "share-of-acceleration",
            Self::Count => "count",
            Self::Executed => "executed",
            Self::Stand => "stand",
            Self::Done => "done",
            Self::State => "state",
            Self::LateError => "late-error",
            Self::Feedback => "feedback",
            Self::Force => "force",
            Self::Stuck => "stuck",
        }
    }
}

/// A broken law, where it was and by how much.
#[derive(Clone, PartialEq, Debug)]
pub struct Violation {
    /// Which law.
    pub class: Class,
    /// The robot cycle, counted from the start of the case.
    pub cycle: u32,
    /// The command number of the skill.
    pub skill: u16,
    /// The motion that the arm is in, counted from 1; one more than there are after the last.
    pub motion: u32,
    /// What was found, with the limit.
    pub what: Broken,
}

/// What was found, in figures.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Broken {
    /// A joint, from 1, and a figure of it beside its limit, in a unit.
    Joint {
        /// Which joint, from 1.
        joint: u8,
        /// What was found.
        figure: f64,
        /// What it may be.
        limit: f64,
        /// Unit of both.
        unit: &'static str,
    },
    /// A figure of the tool or of a count, beside its limit.
    Figure {
        /// Which quantity.
        quantity: &'static str,
        /// What was found.
        figure: f64,
        /// What it may be.
        limit: f64,
        /// Unit of both.
        unit: &'static str,
    },
    /// A sentence says it all.
    Words(&'static str),
}

impl Broken {
    /// By how much of the limit, where that makes sense.
    #[must_use]
    pub fn ratio(&self) -> Option<f64> {
        match *self {
            Self::Joint { figure, limit, .. } | Self::Figure { figure, limit, .. } if limit > 0.0 => {
                Some(figure.abs() / limit)
            }
            _ => None,
        }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { class, cycle, skill, motion, what } = self;
        write!(f, "{}: ", class.name())?;
        match what {
            Broken::Joint { joint, figure, limit, unit } => {
                write!(f, "joint {joint} at {figure:.6} {unit}, allowed is {limit:.6}")?;
            }
            Broken::Figure { quantity, figure, limit, unit } => {
                write!(f, "{quantity} is {figure:.6} {unit}, allowed is {limit:.6}")?;
            }
            Broken::Words(words) => f.write_str(words)?,
        }
        if let Some(ratio) = what.ratio() {
            write!(f, " ({:.2} %)", 100.0 * ratio)?;
        }
        write!(f, "; robot cycle {cycle}, skill {skill}, motion {motion}")
    }
}
