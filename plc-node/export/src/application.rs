//! The numbers of an application, for the code.

use protocol::image::{Motion, MotionKind};

/// A stop of the sequence, and what the PLC switches there.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct StopData {
    /// Motions before it.
    pub after: u32,
    /// Digital output, 0 to 15, whether it is set, and the wait afterwards in us.
    pub switch: Option<(u8, bool, u32)>,
}

/// What is exported.
#[derive(Clone, PartialEq, Debug)]
pub struct ExportedApplication {
    /// Motions of SM and CM.
    pub motions: Vec<Motion>,
    /// Motion to the start from anywhere. Without it a run begins where the arm stands.
    pub from_anywhere: Option<Motion>,
    /// Motions from the end to the start.
    pub from_end: Vec<Motion>,
    /// Ends of the continuous motions, in order.
    pub stops: Vec<StopData>,
    /// Scans in which the robot must echo a command.
    pub answer_scans: u32,
    /// Scans for which the robot's life counter may stand still.
    pub silent_scans: u32,
    /// Scans for which a robot that executes a skill may show no progress.
    pub progress_scans: u32,
    /// Motions that the PLC's memory holds.
    pub most_motions: usize,
    /// Time from one scan to the next in us.
    pub scan_us: u32,
    /// TRUE where the bus carries the most significant byte of a number first.
    pub big_endian: bool,
    /// Robot's cycle in us.
    pub robot_cycle_us: u32,
    /// Motions that CM writes ahead of the executed ones, 1 to 5.
    pub queue_depth: u32,
    /// Program of the robot that RC runs.
    pub program: u16,
    /// Whether images carry the check.
    pub with_check: bool,
}

/// Why an application is not exported.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Refused {
    /// The data exceed what a PLC holds.
    #[error(
        "{found} motions: the PLC's memory holds at most {most}; export a shorter application, or give its data memory in KiB by --memory"
    )]
    TooManyMotions {
        /// Motions found, with those to the start.
        found: usize,
        /// Most motions.
        most: usize,
    },
    /// A motion whose kind the image does not define.
    #[error("motion {index} has kind {kind:?}: must be one of the six kinds of the process image")]
    UnknownKind {
        /// Motion, from 0.
        index: usize,
        /// Its kind.
        kind: MotionKind,
    },
    /// The robot's cycle is too long for the life monitor's arithmetic.
    #[error("robot.cycle_us {found}: must be at most {most} for 32-bit arithmetic in the PLC")]
    LongCycle {
        /// Cycle found in us.
        found: u32,
        /// Longest cycle in us.
        most: u32,
    },
    /// The scan is too long for the adapter test's arithmetic.
    #[error("plc.scan_cycle_us {found}: must be at most {most} for 32-bit arithmetic in the PLC")]
    LongScan {
        /// Scan found in us.
        found: u32,
        /// Longest scan in us.
        most: u32,
    },
    /// A name that means something else to a maker's compiler.
    #[error("`{name}` is a word of {maker}'s language; rename it in the code's templates")]
    Word {
        /// The name.
        name: String,
        /// The maker.
        maker: &'static str,
    },
    /// Two names that a maker's compiler takes for one.
    #[error("`{name}` and `{other}` are one name in {maker}'s language; rename one in the code's templates")]
    SameName {
        /// The name.
        name: String,
        /// The name before it.
        other: String,
        /// The maker.
        maker: &'static str,
    },
    /// A name with more characters than a maker's target takes.
    #[error("`{name}`: {maker} takes at most {most} characters; shorten it in the code's templates")]
    LongName {
        /// The name.
        name: String,
        /// Most characters.
        most: usize,
        /// The maker.
        maker: &'static str,
    },
    /// The text could not be rewritten.
    #[error("the code cannot be rewritten for {maker}: {text}")]
    Rewrite {
        /// The maker.
        maker: &'static str,
        /// Description of the fault.
        text: String,
    },
    /// An output without a bit in the image.
    #[error("output {0}: the process image has outputs 0 to 15")]
    Output(u8),
}

/// Longest cycle of a robot, in us: 65,535 cycles are less than half the range of a DINT.
const LONGEST_CYCLE_US: u32 = 15_000;

/// Longest scan, in us: 400 of them fit a UDINT, and a PLC of a robot scans faster than ten times a second.
const LONGEST_SCAN_US: u32 = 100_000;

impl ExportedApplication {
    /// Returns all motions as the data hold them: those of the run, from anywhere to the start, from the end to the start.
    pub(crate) fn all_motions(&self) -> impl Iterator<Item = &Motion> + Clone {
        self.motions.iter().chain(&self.from_anywhere).chain(&self.from_end)
    }

    /// Checks what every dialect needs.
    ///
    /// # Errors
    /// What does not fit.
    pub fn check(&self) -> Result<(), Refused> {
        let (most, found) = (self.most_motions, self.all_motions().count());
        if found > most {
            return Err(Refused::TooManyMotions { found, most });
        }
        for (index, Motion { kind, .. }) in self.all_motions().enumerate() {
            if matches!(kind, MotionKind::None | MotionKind::Unknown(_)) {
                return Err(Refused::UnknownKind { index, kind: *kind });
            }
        }
        if self.robot_cycle_us > LONGEST_CYCLE_US {
            return Err(Refused::LongCycle { found: self.robot_cycle_us, most: LONGEST_CYCLE_US });
        }
        if self.scan_us > LONGEST_SCAN_US {
            return Err(Refused::LongScan { found: self.scan_us, most: LONGEST_SCAN_US });
        }
        let mut outputs = self.stops.iter().filter_map(|stop| stop.switch);
        match outputs.find(|(output, ..)| *output > 15) {
            Some((output, ..)) => Err(Refused::Output(output)),
            None => Ok(()),
        }
    }
}
