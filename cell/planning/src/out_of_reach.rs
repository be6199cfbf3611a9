//! Why the arm of a setup does not follow a plan.

use std::fmt;

use arm::Violation;

use crate::source::Source;

/// What of a plan the arm does not reach.
#[derive(Clone, PartialEq, Debug)]
pub enum OutOfReach {
    /// The setup describes no arm.
    Arm(arm::ConfigError),
    /// The arm cannot stand at the start.
    Start {
        /// Why not.
        violation: Violation,
        /// What decides where that is; none if the motion is not of the application.
        source: Option<Box<Source>>,
        /// Number of the base.
        base: u8,
    },
    /// The arm cannot follow a motion.
    Motion {
        /// Number of the motion in the plan, from 1; 0 of a motion that leads back to the start.
        number: usize,
        /// Its name.
        name: String,
        /// How much of its path the arm can follow, in mm, and how long that is; none of a target.
        way_mm: Option<(f64, f64)>,
        /// Why no farther.
        violation: Violation,
        /// What decides where that is; none if the motion is not of the application.
        source: Option<Box<Source>>,
        /// Number of the base.
        base: u8,
    },
    /// The joints of a frame are not those of its place.
    Joints {
        /// What goes there.
        what: String,
        /// Where these joints take the tool, in its base: x, y, z in mm and a, b, c in degrees.
        is: [f64; 6],
        /// How far that is from where the frame is, in mm and in degrees.
        off: [f64; 2],
    },
}

impl std::error::Error for OutOfReach {}

impl fmt::Display for OutOfReach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (violation, source, base) = match self {
            Self::Arm(error) => return error.fmt(f),
            Self::Joints { what, is, off: [off_mm, off_deg] } => {
                let is = is.map(|coordinate| format!("{:.1}", coordinate + 0.0)).join(", ");
                return write!(
                    f,
                    "{what}: the frame's joints_deg take the tool to [{is}] in its base, {off_mm:.1} mm and {off_deg:.1}° away \
                     from its mm_deg; correct one of the two"
                );
            }
            Self::Start { violation, source, base } => {
                write!(f, "the arm cannot stand at the start: {violation}")?;
                (violation, source, base)
            }
            Self::Motion { number, name, way_mm, violation, source, base } => {
                f.write_str(&motion_in_words(*number, name))?;
                match way_mm {
                    Some((way, length)) => write!(f, ", after {way:.1} of its {length:.1} mm: {violation}")?,
                    None => write!(f, ", its target: {violation}")?,
                }
                (violation, source, base)
            }
        };
        if matches!(violation, Violation::TurnTooFast { .. }) {
            // This violation already names its remedy.
            return Ok(());
        }
        match violation.missing() {
            Some(missing) => write!(f, "; {}: ", Missing(missing))?,
            None => f.write_str("; ")?,
        }
        match source {
            Some(source) => write!(f, "change {source}{}", OrBase(*base)),
            None => write!(f, "change its frame{}", OrBase(*base)),
        }
    }
}

/// A PTP whose joints take the tool nearer to an obstacle than the clearance.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
#[error(
    "{motion}: its joints take the tool to {nearest_mm:.1} mm from obstacle `{obstacle}`; clearance_mm = {clearance_mm} are \
     needed: lower ptp_radius_mm = {ptp_radius_mm}, or lead the tool over a frame between"
)]
pub struct SwingsTooNear {
    /// The motion's number in the plan, from 1, and its name.
    pub motion: String,
    /// The obstacle.
    pub obstacle: String,
    /// The least distance of the tool from the obstacle, in mm.
    pub nearest_mm: f64,
    /// The clearance of the application, in mm.
    pub clearance_mm: f64,
    /// The radius by which the application bounds how far a PTP leaves its chord, in mm.
    pub ptp_radius_mm: f64,
}

/// Names a motion by its number in the plan, from 1; 0 of one that leads back to the start.
pub(crate) fn motion_in_words(number: usize, name: &str) -> String {
    match number {
        0 => format!("`{name}`, the way back to the start"),
        _ => format!("motion {number} `{name}`"),
    }
}

/// What can be changed in place of a frame, in words: the base in which it stands. Base 0 is the robot's root, which no setup
/// moves.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OrBase(
    /// Its number.
    pub u8,
);

impl fmt::Display for OrBase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => Ok(()),
            base => write!(f, ", or base {base} in the setup"),
        }
    }
}

/// How much of the arm's reach or of a joint's range is missing, with its unit, in words.
pub(crate) struct Missing(pub(crate) (f64, &'static str));

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (missing, unit) = self.0;
        // More digits for a tiny shortfall.
        let digits = if missing < 0.1 { 6 } else { 1 };
        write!(f, "{missing:.digits$} {unit} are missing")
    }
}
