//! The configuration of a PLC node.

use machine::Duration;
use planning::{PROGRAM, Plan, PlannedStation, Stop, ToStart, WaitAt};
use protocol::image;
use setup::{Refill, Setup};

use crate::motion_source::motion_source;
use crate::{DescribedArm, MotionList, MotionSource, StationConfig, StationWork, WaitLimits};

/// Time that a working robot may take to accept a command, in addition to the time in its setup. Assumed, since no source
/// states it: long enough for any controller, short enough for a person who waits.
const ANSWER_MARGIN: Duration = Duration::from_secs(1);

/// Robot cycles in which a working robot may leave its life counter unchanged. Assumed.
const SILENT_ROBOT_CYCLES: u32 = 10;

/// The configuration of a PLC node.
#[derive(Debug)]
pub struct PlcConfig {
    /// Time from one scan to the next.
    pub scan_cycle: Duration,
    /// Time from reading the inputs to writing the outputs. Zero where the scan runs on a real clock, since there it
    /// takes what it takes.
    pub scan_cost: Duration,
    /// How long the robot may take to take up a command.
    pub answer_timeout: Duration,
    /// How long the robot's life counter may stand still.
    pub silent_timeout: Duration,
    /// The robot's cycle, in which it counts its life counter up.
    pub robot_cycle: Duration,
    /// How many motions MoveContinuous writes ahead of those that are executed, 1..=5.
    pub queue_depth: u32,
    /// The count of the robot by which it refills slots.
    pub refill: Refill,
    /// The program in the robot controller that RC runs.
    pub program: u16,
    /// The motions that SM and CM run.
    pub motions: Box<dyn MotionSource>,
    /// The arm that the robot should be; `None` if that is not known.
    pub arm: Option<DescribedArm>,
    /// How the arm moves to where they begin. Without a motion, a run begins where the arm stands.
    pub to_start: ToStart<image::Motion>,
    /// Where their continuous motions end, in order, and what the PLC switches there. Without any, CM runs all motions
    /// as one.
    pub stops: Vec<Stop>,
}

impl PlcConfig {
    /// Creates the configuration of a setup's PLC, with the motions for SM and CM and the program for RC.
    ///
    /// The scan has its modelled cost; in real mode set [`scan_cost`](Self::scan_cost) to zero.
    #[must_use]
    pub fn from_setup(setup: &Setup, motions: Vec<image::Motion>, program: u16) -> Self {
        let micros = |value: u32| Duration::from_micros(u64::from(value));
        let robot_cycles = micros(setup.robot.cycle_us.value).saturating_mul(SILENT_ROBOT_CYCLES);
        Self {
            scan_cycle: micros(setup.plc.scan_cycle_us.value),
            scan_cost: micros(setup.plc.scan_cost_us.value),
            answer_timeout: ANSWER_MARGIN
                + micros(setup.robot.interpreter_quantum_us.value)
                + micros(setup.robot.start_quantum_us.as_ref().map_or(0, |quantum| quantum.value))
                + micros(setup.robot.skill_overhead_us.value),
            silent_timeout: setup.bus.watchdog().max(robot_cycles),
            robot_cycle: micros(setup.robot.cycle_us.value),
            queue_depth: setup.plc.slots_in_use(),
            refill: setup.plc.refills_by(),
            program,
            motions: Box::new(MotionList::from(motions)),
            arm: DescribedArm::from_setup(setup),
            to_start: ToStart::default(),
            stops: Vec::new(),
        }
    }

    /// Creates the configuration of a PLC that serves this station of a cell, with its motions and its program.
    #[must_use]
    pub fn of_station(planned: &PlannedStation) -> Self {
        Self::of_plan(&planned.setup, &planned.plan)
    }

    /// Creates the configuration of a PLC that executes this plan, with the program [`PROGRAM`] for RC.
    #[must_use]
    pub fn of_plan(setup: &Setup, plan: &Plan) -> Self {
        // What has no compact form was refused when it was planned.
        let points = plan.wire_points(setup).unwrap_or_default();
        Self {
            to_start: plan.wire_to_start(setup),
            stops: plan.stops(),
            motions: motion_source(plan.wire_motions(setup), points),
            ..Self::from_setup(setup, Vec::new(), PROGRAM)
        }
    }

    /// Returns what the PLC knows of the station, which has this name in messages, and what it runs there with these waits for other
    /// arms.
    #[must_use]
    pub fn into_station(self, name: &str, waits: &[WaitAt]) -> (StationConfig, StationWork) {
        let wait_limits = self.wait_limits();
        let Self { answer_timeout, robot_cycle, arm, to_start, .. } = self;
        let Self { program, queue_depth, refill, motions, stops, .. } = self;
        let longest_stop = StationConfig::longest_of(&stops);
        let name = name.to_owned();
        let config =
            StationConfig { name, wait_limits, answer_timeout, robot_cycle, arm, to_start, longest_stop };
        let (waits, visits) = (waits.to_vec(), Vec::new());
        (config, StationWork { program, queue_depth, refill, motions, stops, waits, visits, zones: None })
    }

    /// Returns the timeouts in scans, the unit in which the program counts. The echo of a life counter of 16 bits tells its
    /// age only within that range, so no timeout is longer than half of it.
    pub(crate) fn wait_limits(&self) -> WaitLimits {
        let scans = |timeout: Duration| {
            let scans = timeout.as_nanos().div_ceil(self.scan_cycle.as_nanos().max(1));
            u32::try_from(scans).unwrap_or(u32::MAX).max(1)
        };
        let answer_scans = scans(self.answer_timeout).min(0x7FFF);
        WaitLimits { answer_scans, silent_scans: scans(self.silent_timeout) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn setup_a_gives_the_cycles_of_the_paper_and_its_timeouts_in_scans() {
        let (setup, application) = planning::setup_with_application("A").unwrap();
        let motions = application.plan(&setup).unwrap().wire_motions(&setup);
        let config = PlcConfig::from_setup(&setup, motions, 1);
        assert_eq!(
            (config.scan_cycle, config.scan_cost),
            (Duration::from_millis(1), Duration::from_micros(150))
        );
        assert_eq!(config.motions.total(), 13);
        // 1 s, the interpreter's quantum and the call's overhead; a watchdog of 500 bus cycles of 1 ms.
        let robot = &setup.robot;
        let of_robot = (robot.interpreter_quantum_us.value + robot.skill_overhead_us.value).div_ceil(1_000);
        assert_eq!(config.wait_limits(), WaitLimits { answer_scans: 1_000 + of_robot, silent_scans: 500 });
    }

    #[test]
    fn a_timeout_of_whatever_length_stays_within_half_the_life_counter() {
        let setup = setup::setup("A").unwrap();
        let mut config = PlcConfig::from_setup(&setup, Vec::new(), 1);
        (config.answer_timeout, config.silent_timeout) = (Duration::MAX, Duration::ZERO);
        assert_eq!(config.wait_limits(), WaitLimits { answer_scans: 0x7FFF, silent_scans: 1 });
    }
}
