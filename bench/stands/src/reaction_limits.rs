//! How long the PLC waits for the robot's reaction, by the cycles on the way alone.

use std::time::Duration;

use setup::Setup;

/// Returns the shortest and the longest reaction that the cycles of a setup allow. At least the cable is passed there and
/// back. At most every task on the way was just missed: the bus there, the robot's cycle, the bus back, the PLC's scan.
#[must_use]
pub fn reaction_limits(setup: &Setup) -> (Duration, Duration) {
    let micros = |value: u32| Duration::from_micros(value.into());
    let transfer = micros(setup.bus.cable_delay_us.value) * 2;
    let load = micros(setup.bus.cycle_us.value) * 2
        + micros(setup.robot.cycle_us.value)
        + micros(setup.plc.scan_cycle_us.value);
    (transfer, transfer + load)
}
