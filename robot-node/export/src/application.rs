//! An export's contents: the robot of a setup and the stored programs of a plan, and what a language cannot say of them.

use std::collections::BTreeMap;

use planning::{PROGRAM, Plan, Stop, Switch};
use protocol::image::{Motion, MotionKind};
use setup::{BusKind, Setup};

use crate::layer::{ProgramPart, ServedSkills};

/// The head of each file, without the marks of a comment.
pub(crate) const HEAD: &str = "\
skillbench: the second layer of a robot, written by `robot-node export`.
Written from documents, not tried on the maker's controller.
Checked: the logic was executed against the PLC's function blocks over random scripts, each statement an instant of its own.
Not checked: the adapter to the controller, the timing, the mapping of the signals.
Not served: suspend, start time, LIN force, the check of the image (0 is sent), the clock and the execution time.
";

/// Whose robot the code is written for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Maker {
    /// KUKA: KRL.
    Kuka,
    /// ABB: RAPID.
    Abb,
}

impl Maker {
    /// Returns the name of the language.
    pub(crate) const fn language(self) -> &'static str {
        match self {
            Self::Kuka => "KRL",
            Self::Abb => "RAPID",
        }
    }
}

/// A motion of the plan that the language lacks.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("motion {index} of program {program}: {language} has no {found}; {remedy}")]
pub struct Refused {
    /// Number of the program.
    pub program: u16,
    /// Index of the motion in its program, from 0.
    pub index: usize,
    /// The language.
    pub language: &'static str,
    /// The missing feature.
    pub found: &'static str,
    /// The remedy.
    pub remedy: &'static str,
}

/// A stored program.
#[derive(Clone, PartialEq, Debug)]
pub struct StoredProgram {
    /// Its number.
    pub number: u16,
    /// Its motions.
    pub motions: Vec<Motion>,
    /// Its stops that switch outputs.
    pub stops: Vec<Stop>,
}

/// The robot and its programs.
#[derive(Clone, PartialEq, Debug)]
pub struct RobotApplication {
    /// The bus carries the most significant byte first.
    pub big_endian: bool,
    /// Cycle of the robot in µs, in which it counts its life counter up.
    pub robot_cycle_us: u32,
    /// Highest path velocity in 0.1 mm/s.
    pub velocity: u16,
    /// Highest path acceleration in mm/s².
    pub acceleration: u16,
    /// Tools by number: x, y, z in mm; a, b, c in degrees. Number 0 is the flange.
    pub tools: BTreeMap<u8, [f64; 6]>,
    /// Bases by number. Number 0 is the robot's root.
    pub bases: BTreeMap<u8, [f64; 6]>,
    /// Programs by number.
    pub programs: Vec<StoredProgram>,
}

/// Returns the numbers of tools and bases that the image has.
pub(crate) fn frame_numbers() -> impl Iterator<Item = u8> {
    0..16
}

impl RobotApplication {
    /// Takes the robot of a setup and the programs of a plan: one for each section between two rests, at marks and before shared
    /// zones, since an exported program meets no other arm.
    #[must_use]
    pub fn of_plan(setup: &Setup, plan: &Plan) -> Self {
        let robot = &setup.robot;
        let frames = |listed: &[setup::Frame]| {
            let listed = listed.iter().map(|frame| (frame.number, frame.mm_deg.value));
            listed.chain([(0, [0.0; 6])]).collect()
        };
        let motions = plan.wire_motions(setup);
        let sections = plan.sections_between_rests();
        let programs = (PROGRAM..).zip(&sections).map(|(number, section)| StoredProgram {
            number,
            motions: motions.get(section.motions.clone()).unwrap_or_default().to_vec(),
            stops: section.stops.iter().filter(|stop| stop.then.is_some()).copied().collect(),
        });
        Self {
            big_endian: matches!(setup.bus.kind, BusKind::Profinet(..)),
            robot_cycle_us: robot.cycle_us.value,
            velocity: (robot.path_velocity_mm_s.value * 10.0) as u16,
            acceleration: robot.path_acceleration_mm_s2.value as u16,
            tools: frames(&robot.tools),
            bases: frames(&robot.bases),
            programs: programs.collect(),
        }
    }

    /// Returns what a maker's robot serves, with the programs in the parts of its language.
    ///
    /// # Errors
    /// The first motion that the language lacks.
    pub fn served(&self, maker: Maker) -> Result<ServedSkills, Refused> {
        let programs = self.programs.iter().map(|program| Ok((program.number, parts(program, maker)?)));
        Ok(ServedSkills {
            splines: maker == Maker::Kuka,
            configurations: maker == Maker::Kuka,
            decelerations: maker == Maker::Abb,
            velocity: self.velocity,
            acceleration: self.acceleration,
            tools: self.tools.keys().copied().collect(),
            bases: self.bases.keys().copied().collect(),
            programs: programs.collect::<Result<_, _>>()?,
        })
    }
}

/// Returns what a language lacks of a motion, and what helps.
fn lack(motion: &Motion, maker: Maker) -> Option<(&'static str, &'static str)> {
    let is_spline = motion.kind == MotionKind::Spline;
    let has_options = !motion.kind.has_auxiliary();
    let is_slower = motion.deceleration != 0 && motion.deceleration != motion.acceleration;
    Some(match maker {
        _ if motion.kind == MotionKind::LinForceCartesian => ("LIN force", "leave the force step out"),
        _ if motion.kind.traits().is_none() => ("motion of this kind", "plan LIN, PTP or CIRC"),
        Maker::Abb if is_spline => ("SPLINE", "plan lines and circles in its place, or export for kuka"),
        _ if has_options && motion.jerk != 0 => ("jerk of a motion", "leave `jerk` out"),
        Maker::Kuka if has_options && is_slower => {
            ("deceleration other than the acceleration", "leave `deceleration` out, or export for abb")
        }
        Maker::Abb if motion.configuration.is_some() => {
            ("configuration by status and turn", "leave it out, or export for kuka")
        }
        Maker::Kuka if motion.configuration.is_some_and(|configuration| configuration.turn.is_none()) => {
            ("configuration without a turn", "give the turn too")
        }
        Maker::Kuka if motion.configuration.is_some() && motion.kind != MotionKind::PtpCartesian => {
            ("configuration of a path", "give it to the PTP before")
        }
        _ => return None,
    })
}

/// Divides a program into what the language gives as one.
fn parts(program: &StoredProgram, maker: Maker) -> Result<Vec<ProgramPart>, Refused> {
    let mut parts: Vec<ProgramPart> = Vec::new();
    let mut stops = program.stops.iter().peekable();
    for (index, motion) in program.motions.iter().enumerate() {
        if let Some((found, remedy)) = lack(motion, maker) {
            let (program, language) = (program.number, maker.language());
            return Err(Refused { program, index, language, found, remedy });
        }
        let stop = stops.next_if(|stop| usize::try_from(stop.after).is_ok_and(|after| after == index + 1));
        let mut motion = *motion;
        if stop.is_some() {
            // The arm stops there, whatever its corner would be.
            motion.approximation = 0;
        }
        match parts.last_mut() {
            Some(ProgramPart::Motions(curve))
                if motion.kind == MotionKind::Spline
                    && curve.last().is_some_and(|last| last.kind == MotionKind::Spline) =>
            {
                curve.push(motion);
            }
            _ => parts.push(ProgramPart::Motions(vec![motion])),
        }
        if let Some(Switch { output, set, wait }) = stop.and_then(|stop| stop.then) {
            let wait_ms = u32::try_from(wait.as_millis()).unwrap_or(u32::MAX);
            parts.push(ProgramPart::Switch { mask: 1 << (output % 16), on: set, wait_ms });
        }
    }
    Ok(parts)
}
