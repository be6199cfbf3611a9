//! Differences of a repetition from the plan.

use std::fmt;

use protocol::image::Sum;
use robot_node::Account;

/// What differs in a repetition.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum Difference {
    /// The PLC sent other motions.
    #[error("the PLC sent other motions than the plan has: {found}, and the plan has {planned}")]
    Sent {
        /// What it sent.
        found: Sum,
        /// What it should send.
        planned: Sum,
    },
    /// The robot counted another number of motions.
    #[error("the robot executed {found} motions, and the plan has {planned}")]
    Count {
        /// What it counted.
        found: u64,
        /// What it should count.
        planned: u64,
    },
    /// The robot executed other motions, or in other skills.
    #[error(
        "the robot executed other motions than the plan has, or called them otherwise: {found}, and the plan has {planned}"
    )]
    Executed {
        /// What it executed.
        found: Executed,
        /// What it should execute.
        planned: Executed,
    },
    /// The robot followed another override.
    #[error(
        "the robot moved at an override of {} to {} %, and the PLC commanded {} to {} %",
        found[0], found[1], commanded[0], commanded[1]
    )]
    Override {
        /// Lowest and highest, in %.
        found: [u8; 2],
        /// Lowest and highest, in %.
        commanded: [u8; 2],
    },
    /// The robot followed another override than full speed under a master axis, which carries the override itself.
    #[error(
        "under the master axis the robot moved at an override of {} to {} %, and the PLC sent {} to {} %: check what the \
         robot does with bit 7, SYNC",
        found[0], found[1], sent[0], sent[1]
    )]
    LedOverride {
        /// Lowest and highest, in %.
        found: [u8; 2],
        /// Lowest and highest, in %.
        sent: [u8; 2],
    },
    /// The arm began elsewhere.
    #[error("the tool began {away_mm:.3} mm from the application's start")]
    Start {
        /// Distance of the tool, in mm.
        away_mm: f64,
    },
    /// The arm ended elsewhere.
    #[error("{seen_by}, joint {joint} ended at {found:.4}° (mm), and the plan ends at {planned:.4}")]
    End {
        /// By whose account.
        seen_by: &'static str,
        /// Its number, counted from 1.
        joint: usize,
        /// In degrees (mm).
        found: f64,
        /// In degrees (mm).
        planned: f64,
    },
    /// The tool ended elsewhere, as the robot reports its pose.
    #[error(
        "by the robot's image the tool ended at x {:.3}, y {:.3}, z {:.3} mm in its base, {away_mm:.3} mm from the plan's \
         {:.3}, {:.3}, {:.3}",
        found[0], found[1], found[2], planned[0], planned[1], planned[2]
    )]
    EndPose {
        /// Distance of both, in mm.
        away_mm: f64,
        /// Position of the tool in the base, in mm.
        found: [f64; 3],
        /// Where it should be, in mm.
        planned: [f64; 3],
    },
    /// The robot's clock runs at another speed.
    #[error(
        "by the robot's own clock the run took {:.3} ms, by the PLC's {:.3} ms, and the cycles between them explain {:.3} ms: \
         does the clock in its image count ns?",
        *found_ns as f64 / 1e6, *plc_ns as f64 / 1e6, *allowed_ns as f64 / 1e6
    )]
    Clock {
        /// By the robot's clock.
        found_ns: i64,
        /// By the PLC's.
        plc_ns: i64,
        /// Largest difference.
        allowed_ns: i64,
    },
    /// The path had another length.
    #[error("the tool's path was {found_mm:.3} mm long, and the plan's is {:.3} to {:.3} mm", planned_mm[0], planned_mm[1])]
    Length {
        /// Length of the path.
        found_mm: f64,
        /// Shortest and longest.
        planned_mm: [f64; 2],
    },
    /// The robot took another time.
    #[error(
        "the robot took {found_ms:.1} ms for its motions by its own clock, and {planned_ms:.1} ms in the rehearsal"
    )]
    RobotTime {
        /// Time by the robot's clock, in ms.
        found_ms: f64,
        /// Rehearsed time, in ms.
        planned_ms: f64,
    },
    /// The two clocks disagree.
    #[error(
        "the PLC measured {:.3} ms more than the robot, and the cycles between them take {:.3} to {:.3} ms",
        *found_ns as f64 / 1e6, allowed_ns[0] as f64 / 1e6, allowed_ns[1] as f64 / 1e6
    )]
    Times {
        /// The PLC's execution time minus the robot's.
        found_ns: i64,
        /// Least and most.
        allowed_ns: [i64; 2],
    },
}

/// Motions of an account, and how they were called.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Executed {
    motions: u64,
    skills: u32,
    digest: u64,
}

impl Executed {
    pub(super) const fn of(account: &Account) -> Self {
        Self { motions: account.motions, skills: account.skills, digest: account.digest }
    }
}

impl fmt::Display for Executed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { motions, skills, digest } = self;
        write!(f, "{digest:016x} over {motions} motions in {skills} skills")
    }
}
