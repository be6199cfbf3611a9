//! Numbers of a setup that were chosen to reproduce a figure of the paper, and which figure each of them reproduces.

use plc_node::ExecutionType;
use serde::{Deserialize, Serialize};
use setup::{Provenance, Setup, Sourced};

/// Key of the programmed speed, which is calibrated to RC's AET.
pub const VELOCITY: &str = "motions.velocity_percent";
/// Key of the cost of a skill call, which is calibrated to SM's AET.
pub const SKILL_OVERHEAD: &str = "robot.skill_overhead_us";
/// Key of the robot cycles before the first motion of a MoveContinuousSkill, which are calibrated to CM's AET minus RC's AET.
pub const START_CYCLES: &str = "robot.continuous_start_cycles";
/// Key of the controller's time quantum, which is calibrated to the MADs.
pub const QUANTUM: &str = "robot.interpreter_quantum_us";
/// Key of the spread of a program's start, which is calibrated to RC's MAD.
pub const START_QUANTUM: &str = "robot.start_quantum_us";

/// A number that was chosen to reproduce a published figure.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Calibrated {
    /// Its key in the setup.
    pub key: String,
    /// Its value, in the unit that the key names.
    pub value: f64,
    /// The figure that it was calibrated to, and how.
    pub note: String,
}

/// Returns the calibrated numbers of a setup.
#[must_use]
pub fn of(setup: &Setup) -> Vec<Calibrated> {
    fn entry<T: Copy + Into<f64>>(key: &str, number: &Sourced<T>) -> Option<Calibrated> {
        (number.from == Provenance::Calibrated).then(|| Calibrated {
            key: key.to_owned(),
            value: number.value.into(),
            note: number.note.clone(),
        })
    }
    let robot = &setup.robot;
    let numbers = [
        entry(VELOCITY, &setup.motions.velocity_percent),
        entry(SKILL_OVERHEAD, &robot.skill_overhead_us),
        robot.continuous_start_cycles.as_ref().and_then(|cycles| entry(START_CYCLES, cycles)),
        entry(QUANTUM, &robot.interpreter_quantum_us),
        robot.start_quantum_us.as_ref().and_then(|quantum| entry(START_QUANTUM, quantum)),
    ];
    numbers.into_iter().flatten().collect()
}

/// Returns the key of the number that is calibrated to the AET of a type.
#[must_use]
pub const fn of_aet(execution_type: ExecutionType) -> &'static str {
    match execution_type {
        ExecutionType::Rc => VELOCITY,
        ExecutionType::Sm => SKILL_OVERHEAD,
        ExecutionType::Cm => START_CYCLES,
    }
}

/// Returns the keys of the numbers that are calibrated to the MAD of a type.
#[must_use]
pub const fn of_mad(execution_type: ExecutionType) -> &'static [&'static str] {
    match execution_type {
        ExecutionType::Rc => &[QUANTUM, START_QUANTUM],
        ExecutionType::Sm => &[QUANTUM],
        ExecutionType::Cm => &[],
    }
}

/// Names the figure that a calibrated number reproduces. `all` are the calibrated numbers of the setup.
#[must_use]
pub fn figure(key: &str, all: &[Calibrated]) -> &'static str {
    let has_start = all.iter().any(|calibrated| calibrated.key == START_QUANTUM);
    match key {
        VELOCITY => "RC's AET",
        SKILL_OVERHEAD => "SM's AET",
        START_CYCLES => "CM's AET minus RC's AET",
        START_QUANTUM => "RC's MAD",
        _ if has_start => "SM's MAD",
        _ => "the MADs of RC and SM",
    }
}
