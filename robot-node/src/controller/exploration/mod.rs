//! Robot and PLC together in every order of commands, losses of connection and faults, until no new state is found.
//!
//! A step is one scan of the PLC's function blocks (two of a skill where one waits for the other), and one robot cycle on
//! the image that they wrote. Before each, one thing may change: `Execute` of a block rises, and falls when the block has
//! ended; the override, to 0, to 100 % or to one that is none; a master; `enable`; the connection; or the robot gets an old image
//! again, which is the effect of a lost frame. With compact points also one that is older than that, and PLC or robot restarts. From every state all of them are tried. (The blocks' own exploration tries
//! all orders of `Execute` alone.)
//!
//! States count as one when they differ in running numbers, or by less than [`Skills::place_mm`] in place and not in whether
//! the arm rests: with that the exploration closes. So it is exhaustive over the discrete states and their order, not
//! over places.

mod cell;
mod points;
mod rules;

use std::collections::HashSet;
use std::sync::OnceLock;

use core::time::Duration;

use plc_node::function_blocks::{BufferMode, Outputs};
use plc_node::{MotionList, MotionSource, PointList};
use protocol::image::{Motion, MotionKind};

use cell::Explored;
use points::PlantedFault;

use super::execution::Phase;
use super::*;
use crate::ForceControl;
use crate::arm::Surface;
use setup::Refill;

/// Scans that the PLC waits for an answer.
const PATIENCE: u32 = 4;

/// The blocks, and the index of each.
const BLOCKS: usize = 7;
const MOVE: usize = 0;
const STOP: usize = 1;
const RESET: usize = 2;
const INTERRUPT: usize = 3;
const CONTINUE: usize = 4;
const HALT: usize = 5;
/// A second block of a skill.
const SECOND: usize = 6;

/// What changes before a step.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Change {
    Nothing,
    /// `Execute` of a block rises.
    Execute(usize),
    /// The velocity factor of the override.
    Override(Velocity),
    /// The master that the arm follows.
    Master(Lead),
    Enable,
    Connection,
    LostFrame,
    /// The robot gets the image before the last one that it had.
    OldFrame,
    /// The PLC forgets all.
    RestartPlc,
    /// The robot forgets all and is where it was.
    RestartRobot,
}

/// What the PLC wants of the override.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Velocity {
    Full,
    Stop,
    /// Above 100 %: a PLC writes it past its function block.
    Wrong,
}

/// What the PLC's master does.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Lead {
    /// There is none.
    Free,
    /// It stands at the skill's start.
    Stands,
    /// It is far ahead of the arm.
    Ahead,
}

const CHANGES: [Change; 20] = [
    Change::Nothing,
    Change::Execute(MOVE),
    Change::Execute(STOP),
    Change::Execute(RESET),
    Change::Execute(INTERRUPT),
    Change::Execute(CONTINUE),
    Change::Execute(HALT),
    Change::Execute(SECOND),
    Change::Override(Velocity::Full),
    Change::Override(Velocity::Stop),
    Change::Override(Velocity::Wrong),
    Change::Master(Lead::Free),
    Change::Master(Lead::Stands),
    Change::Master(Lead::Ahead),
    Change::Enable,
    Change::Connection,
    Change::LostFrame,
    Change::OldFrame,
    Change::RestartPlc,
    Change::RestartRobot,
];

/// What MoveContinuous runs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Skills {
    /// Three motions.
    Good,
    /// Six motions, the last one out of reach: it comes when the run is under way.
    Bad,
    /// A motion, a LIN force, a motion.
    Pressing,
    /// Three motions that follow a master.
    Led,
    /// Two motions, by two blocks in one buffer mode.
    Two(BufferMode),
    /// Compact points, more than an image holds, from a PLC with a fault or without one.
    Points(Refill, Option<PlantedFault>),
}

/// Joint 3 at power-on, in mm.
const HOME: f64 = 175.0;

impl Skills {
    /// Returns the values of joint 3 at the ends of the motions, in mm; of a LIN force, where its line ends.
    fn targets(self) -> &'static [f64] {
        match self {
            Self::Good | Self::Led => &[HOME - 0.1, HOME - 0.2, HOME - 0.05],
            Self::Bad => &[HOME - 0.06, HOME - 0.12, HOME - 0.06, HOME - 0.12, HOME - 0.06, HOME + 100.0],
            Self::Pressing => &[HOME - 0.1, HOME - 1.0, HOME - 0.05],
            Self::Two(_) => &[HOME - 0.1, HOME - 0.2],
            Self::Points(..) => &points::TARGETS,
        }
    }

    fn source(self) -> Box<dyn MotionSource> {
        match self {
            Self::Points(..) => Box::new(PointList::from(points::path())),
            _ => Box::new(MotionList::from(self.motions())),
        }
    }

    fn config(self) -> RobotConfig {
        match self {
            Self::Points(..) => RobotConfig { queue_motions: 30, compact_points: true, ..config() },
            _ => config(),
        }
    }

    fn motions(self) -> Vec<Motion> {
        let config = config();
        let to = |joint_3: f64| {
            let mut target = config.home.map(|joint| joint as f32);
            target[2] = joint_3 as f32;
            let kind = MotionKind::PtpJoint;
            Motion { kind, target, velocity: 10_000, acceleration: 10_000, ..Motion::EMPTY }
        };
        let mut motions: Vec<Motion> = self.targets().iter().copied().map(to).collect();
        if self == Self::Pressing {
            let mut joints = config.home;
            joints[2] = self.targets()[1];
            let target = config.arm.forward(&joints).to_mm_deg().map(|coordinate| coordinate as f32);
            let (kind, auxiliary) = (MotionKind::LinForceCartesian, [0.0, 0.0, -25.0]);
            motions[1] =
                Motion { kind, target, auxiliary, velocity: 100, acceleration: 5_000, ..Motion::EMPTY };
        }
        motions
    }

    /// Returns the distance below which two places count as one. A force is approached slowly, so that there are many
    /// places.
    const fn place_mm(self) -> f64 {
        match self {
            Self::Good | Self::Bad | Self::Led | Self::Two(_) => 0.02,
            // How many of them are executed says where the arm is.
            Self::Points(..) => 1.0,
            Self::Pressing => 0.15,
        }
    }

    /// Returns for which share of the states, one in so many, the way back to `Ready` is tried. With a deep queue it takes long.
    const fn steps_between_ways_back(self) -> usize {
        match self {
            Self::Points(..) => 8,
            _ => 1,
        }
    }

    /// Returns whether the change is tried on this skill: the effect of an override does not depend on a second block,
    /// and that of a wrong override not on the motion.
    fn meets(self, change: Change) -> bool {
        match (self, change) {
            // What overrides, masters, suspends and cancels do does not depend on the form of the motions.
            (Self::Points(..), Change::Execute(block)) => matches!(block, MOVE | STOP | RESET),
            (Self::Points(..), Change::Override(_) | Change::Master(_) | Change::Enable) => false,
            (Self::Points(..), _) => true,
            (_, Change::OldFrame | Change::RestartPlc | Change::RestartRobot) => false,
            (Self::Led, Change::Master(_)) => true,
            (_, Change::Master(_)) | (Self::Led | Self::Two(_), Change::Override(_)) => false,
            (Self::Two(_), _) | (Self::Good, Change::Override(_)) => true,
            (_, change) => !matches!(change, Change::Override(Velocity::Wrong) | Change::Execute(SECOND)),
        }
    }

    /// Returns the buffer mode of a block that is called while the other one's skill is under way.
    fn mode(self) -> BufferMode {
        match self {
            Self::Two(mode) => mode,
            _ => BufferMode::default(),
        }
    }

    /// Returns whether motion `index` ends where it meets the surface, and not at its target.
    fn presses(self, index: usize) -> bool {
        self == Self::Pressing && index == 1
    }
}

/// Returns the robot of Setup A, which is read once: a restart in each state would read it as often.
fn config() -> RobotConfig {
    static CONFIG: OnceLock<RobotConfig> = OnceLock::new();
    CONFIG.get_or_init(read_config).clone()
}

fn read_config() -> RobotConfig {
    let setup = setup::setup("A").unwrap();
    let mut config = RobotConfig {
        interpreter_quantum: Duration::ZERO,
        skill_overhead: Duration::ZERO,
        ..RobotConfig::from_setup(&setup).unwrap()
    };
    let [x, y, z] = config.arm.forward(&config.home).position;
    config.surfaces = vec![Surface {
        point: [x, y, z - 0.3],
        normal: [0.0, 0.0, 1.0],
        radius_mm: f64::INFINITY,
        stiffness_n_per_mm: 50.0,
    }];
    // As short as can be: how far it has settled is no state of its own here.
    config.force = config.force.map(|force| ForceControl { settling: Duration::from_millis(4), ..force });
    config
}

/// What an exploration turned up.
#[derive(Default)]
struct Found {
    /// Different states of robot and PLC.
    count: usize,
    /// What MoveContinuous showed.
    ends: HashSet<Outputs>,
    /// States of the robot.
    states: HashSet<u8>,
    /// Steps in which a block started that had waited for the other one.
    turns: usize,
}

/// Explores everything that can happen.
fn explore(skills: Skills) -> Found {
    let mut source = skills.source();
    let source = source.as_mut();
    let start = Explored::new(skills);
    let mut known = HashSet::from([start.key()]);
    let mut found = Found::default();
    let mut open = vec![start];
    while let Some(state) = open.pop() {
        if known.len() % skills.steps_between_ways_back() == 0 {
            state.leads_back_to_ready(source);
        }
        for change in CHANGES.into_iter().filter(|change| skills.meets(*change)) {
            let next = state.step(change, source);
            found.ends.insert(next.outputs[MOVE]);
            found.states.insert(u8::from(next.controller.state));
            found.turns +=
                [MOVE, SECOND].into_iter().filter(|block| next.takes_its_turn(&state, *block)).count();
            if known.insert(next.key()) {
                open.push(next);
            }
        }
        assert!(known.len() < 2_000_000, "the exploration must end, and {} states are open", open.len());
    }
    found.count = known.len();
    println!("{} states", found.count);
    found
}

#[test]
fn a_skill_of_good_motions_keeps_all_rules_in_every_order_of_commands_losses_and_faults() {
    let Found { ends, states, .. } = explore(Skills::Good);
    assert!(ends.iter().any(|end| end.done) && ends.iter().any(|end| end.command_aborted));
    assert!(ends.iter().any(|end| end.error) && ends.iter().any(|end| end.command_interrupted));
    assert_eq!(states.len(), 4, "Halted, Ready, Running and Suspended all turn up");
}

#[test]
fn so_does_a_stream_with_a_bad_motion_which_never_ends_as_done() {
    let Found { ends, .. } = explore(Skills::Bad);
    assert!(!ends.iter().any(|end| end.done));
    assert!(ends.iter().any(|end| end.error_id == u16::from(ErrorNumber::AxisLimit)));
}

#[test]
fn so_does_a_skill_that_presses_and_nothing_but_a_skill_that_runs_moves_the_arm() {
    let Found { ends, states, .. } = explore(Skills::Pressing);
    assert!(ends.iter().any(|end| end.done) && ends.iter().any(|end| end.command_aborted));
    assert_eq!(states.len(), 4);
}

#[test]
fn so_does_a_skill_that_follows_a_master_which_comes_stands_and_goes() {
    let Found { ends, states, .. } = explore(Skills::Led);
    assert!(ends.iter().any(|end| end.done) && ends.iter().any(|end| end.command_aborted));
    assert_eq!(states.len(), 4);
}

#[test]
fn so_do_two_skills_of_which_one_waits_for_the_other_or_cancels_it() {
    for mode in [BufferMode::Buffered, BufferMode::Aborting] {
        let Found { ends, states, turns, .. } = explore(Skills::Two(mode));
        assert!(ends.iter().any(|end| end.done) && ends.iter().any(|end| end.command_aborted));
        assert_eq!(states.len(), 4);
        assert!(turns > 100, "{mode:?}: a block that waited started {turns} times");
    }
}
