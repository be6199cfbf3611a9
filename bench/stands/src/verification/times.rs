//! By how much the PLC's time of a repetition may exceed the robot's: the cycles between both, and what delayed them.

use std::time::Duration;

use planning::Stop;
use plc_node::ExecutionType;
use setup::Setup;
use virtual_time::Impairment;

use super::Difference;
use crate::reaction_limits::reaction_limits;
use records::conditions::{Interference, Measured};
use records::faults::{self, Fault};
use records::mode::Mode;

/// How much more than the robot the PLC may measure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Times {
    scan: Duration,
    robot_cycle: Duration,
    bus_cycle: Duration,
    /// The longest time of a call besides the robot's own: there and back, and the scans of the PLC.
    call: Duration,
    /// What the PLC waits at the stops of the plan, and scans in which it does so.
    waits: Duration,
    stops: u32,
    /// By how much the two clocks may differ in their speed, as a share.
    drift: f64,
}

impl Times {
    pub(super) fn new(setup: &Setup, stops: &[Stop], mode: Mode, faults: &[Fault]) -> Self {
        let micros = |value: u32| Duration::from_micros(value.into());
        let [scan, robot_cycle, bus_cycle] =
            [setup.plc.scan_cycle_us.value, setup.robot.cycle_us.value, setup.bus.cycle_us.value].map(micros);
        let hold =
            |link: Impairment| link.delay + link.jitter + link.reorder_by + link.frame_faults.longest_hold();
        let held: Duration = faults::links(faults, Impairment::default()).into_iter().map(hold).sum();
        let reaction = reaction_limits(setup).1;
        // The PLC's outputs leave at the end of a scan, and its next step begins with the next scan.
        let mut call = reaction + held + micros(setup.plc.scan_cost_us.value) + scan * 2;
        if mode == Mode::Real {
            // Each cycle on the way may run late by less than itself without being missed.
            call += reaction;
        }
        let switches = || stops.iter().filter_map(|stop| stop.then);
        Self {
            scan,
            robot_cycle,
            bus_cycle,
            call,
            waits: switches().map(|switch| switch.wait).sum(),
            stops: switches().count() as u32,
            drift: 2e-6 * f64::from(setup.bus.clock_drift_ppm.value),
        }
    }

    pub(super) fn check(&self, measured: &Measured, skills: u32) -> Result<(), Difference> {
        let execution = &measured.execution;
        let nanos = |time: Duration| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX);
        let signed = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
        let found_ns =
            signed(execution.execution_time_ns).saturating_sub(signed(execution.robot_execution_ns));
        let (waits, stops) = match execution.execution_type {
            ExecutionType::Rc => (Duration::ZERO, 0),
            ExecutionType::Sm | ExecutionType::Cm => (self.waits, self.stops),
        };
        let drift = nanos(Duration::from_nanos(execution.execution_time_ns).mul_f64(self.drift));
        // The robot counts from the grid point of the cycle that saw the command, even where the host ran it late.
        let least = nanos(waits) - nanos(self.robot_cycle * skills) - drift;
        let most =
            waits + self.call * skills + self.scan * (stops * 3) + self.delayed(&measured.interference);
        let allowed_ns = [least, nanos(most).saturating_add(drift)];
        match (allowed_ns[0]..=allowed_ns[1]).contains(&found_ns) {
            true => Ok(()),
            false => Err(Difference::Times { found_ns, allowed_ns }),
        }
    }

    /// Compares the robot's clock with the PLC's: the images at both ends of a run may be as old as one call takes.
    pub(super) fn check_clock(&self, measured: &Measured, clock_ns: u64) -> Result<(), Difference> {
        let nanos = |time: Duration| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX);
        let signed = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
        let plc_ns = measured.execution.execution_time_ns;
        let drift = Duration::from_nanos(plc_ns).mul_f64(self.drift);
        let allowed_ns = nanos(self.call + drift + self.delayed(&measured.interference));
        let (found_ns, plc_ns) = (signed(clock_ns), signed(plc_ns));
        match found_ns.abs_diff(plc_ns) <= allowed_ns.unsigned_abs() {
            true => Ok(()),
            false => Err(Difference::Clock { found_ns, plc_ns, allowed_ns }),
        }
    }

    /// Returns the largest delay of the nodes' images that host and bus can explain.
    fn delayed(&self, interference: &Interference) -> Duration {
        let times = |cycle: Duration, count: u64| cycle * u32::try_from(count).unwrap_or(u32::MAX);
        let Interference { missed, altered, skipped, lost, .. } = *interference;
        times(self.scan, missed[0] + altered[0])
            + times(self.robot_cycle, missed[1] + altered[1])
            + times(self.bus_cycle, skipped + lost)
    }
}
