//! The numbers of a setup that a calibration finds, and the figures that each one is found from.

use plc_node::ExecutionType;
use setup::{Provenance, Setup};

use super::metric::Metric;
use records::calibrated::{QUANTUM, SKILL_OVERHEAD, START_CYCLES, START_QUANTUM, VELOCITY};

/// A number that only the paper's figures can fix.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Parameter {
    /// The controller's time quantum, in µs.
    Quantum,
    /// What the start of a program takes beyond it, in µs.
    StartQuantum,
    /// The programmed speed, in %.
    Velocity,
    /// The cost of a skill call, in µs.
    Overhead,
    /// Robot cycles before the first motion of a MoveContinuousSkill.
    StartCycles,
}

impl Parameter {
    /// All numbers, in the order in which they are found.
    pub const ALL: [Self; 5] =
        [Self::Quantum, Self::StartQuantum, Self::Velocity, Self::Overhead, Self::StartCycles];

    /// Returns its key in the setup.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::Quantum => QUANTUM,
            Self::StartQuantum => START_QUANTUM,
            Self::Velocity => VELOCITY,
            Self::Overhead => SKILL_OVERHEAD,
            Self::StartCycles => START_CYCLES,
        }
    }

    /// Returns its value and provenance; `None` if the setup does not have it.
    #[must_use]
    pub fn of(self, setup: &Setup) -> Option<(f64, Provenance)> {
        let whole = |number: &setup::Sourced<u32>| (f64::from(number.value), number.from);
        let robot = &setup.robot;
        match self {
            Self::Quantum => Some(whole(&robot.interpreter_quantum_us)),
            Self::StartQuantum => robot.start_quantum_us.as_ref().map(whole),
            Self::Velocity => {
                let velocity = &setup.motions.velocity_percent;
                Some((velocity.value, velocity.from))
            }
            Self::Overhead => Some(whole(&robot.skill_overhead_us)),
            Self::StartCycles => robot.continuous_start_cycles.as_ref().map(whole),
        }
    }

    /// Returns the setup with another value of this number, which the setup has.
    #[must_use]
    pub fn put(self, value: f64, mut setup: Setup) -> Setup {
        let whole = value.round().max(0.0) as u32;
        let robot = &mut setup.robot;
        match self {
            Self::Quantum => robot.interpreter_quantum_us.value = whole,
            Self::StartQuantum => robot.start_quantum_us.iter_mut().for_each(|number| number.value = whole),
            Self::Velocity => setup.motions.velocity_percent.value = value,
            Self::Overhead => robot.skill_overhead_us.value = whole,
            Self::StartCycles => {
                robot.continuous_start_cycles.iter_mut().for_each(|number| number.value = whole);
            }
        }
        setup
    }

    /// Returns the figures that it is found from. A quantum of the start, if the setup has one, affects RC alone, because
    /// SM's motions are not starts; then each of the two is found from a MAD of its own.
    #[must_use]
    pub const fn figures(self, setup: &Setup) -> &'static [Metric] {
        match self {
            Self::Quantum if setup.robot.start_quantum_us.is_some() => &[Metric::Mad(ExecutionType::Sm)],
            Self::Quantum => &[Metric::Mad(ExecutionType::Rc), Metric::Mad(ExecutionType::Sm)],
            Self::StartQuantum => &[Metric::Mad(ExecutionType::Rc)],
            Self::Velocity => &[Metric::Aet(ExecutionType::Rc)],
            Self::Overhead => &[Metric::Aet(ExecutionType::Sm)],
            Self::StartCycles => &[Metric::CmMinusRc],
        }
    }

    /// Returns whether its figure goes up in steps with it.
    #[must_use]
    pub const fn has_steps(self) -> bool {
        matches!(self, Self::Velocity | Self::Overhead)
    }

    /// Returns the lowest and highest value, and the least distance of two values.
    #[must_use]
    pub const fn range(self) -> (f64, f64, f64) {
        match self {
            Self::Velocity => (0.5, 100.0, 1e-3),
            Self::Quantum | Self::StartQuantum | Self::Overhead => (0.0, 10e6, 1.0),
            Self::StartCycles => (0.0, 1e3, 1.0),
        }
    }
}
