//! Checks of the drives' limits and of their monitoring.

use super::{Check, above_zero, problem};
use crate::{Drives, Figure, Servo};

/// Highest speed and torque of a motor in %: object 0x6072 of CiA 402 has 16 bits of ‰.
const MAX_PERCENT: f64 = 1_000.0;

/// Largest following error: a turn.
const MAX_WINDOW_DEG: f64 = 360.0;

/// Longest time-out: object 0x6066 of CiA 402 has 16 bits of ms.
const MAX_MS: u32 = 60_000;

/// Longest time to switch the drives on, in ms.
const MAX_SWITCH_ON_MS: u32 = 600_000;

/// Torque that a motor needs, as a share of that for the rated acceleration: within half a robot cycle it takes up the
/// change of speed of a whole one.
const TORQUE_RESERVE: f64 = 2.0;

pub(super) fn check(servo: &Servo) -> Check {
    let (speed, torque) = (servo.speed_percent.value, servo.torque_percent.value);
    let (window, in_position) = (servo.following_error_deg.value, servo.in_position_deg.value);
    let resolution = 1.0 / Drives::INCREMENTS;
    between("speed_percent", speed, [100.0, MAX_PERCENT], "%: the joint's rated speed")?;
    let torque_is = "%: twice the rated acceleration, since a drive takes up a robot cycle's change of speed in half of it";
    between("torque_percent", torque, [100.0 * TORQUE_RESERVE, MAX_PERCENT], torque_is)?;
    between("following_error_deg", window, [resolution, MAX_WINDOW_DEG], "degrees (mm): an increment")?;
    let to_window = "degrees (mm): an increment to the following error";
    between("in_position_deg", in_position, [resolution, window], to_window)?;
    for (key, value, most) in [
        ("following_error_ms", servo.following_error_ms.value, MAX_MS),
        ("settling_ms", servo.settling_ms.value, MAX_MS),
        ("switch_on_ms", servo.switch_on_ms.value, MAX_SWITCH_ON_MS),
    ] {
        between(key, value.into(), [1.0, most.into()], "ms")?;
    }
    Ok(())
}

fn between(key: &str, value: f64, [least, most]: [f64; 2], unit: &str) -> Check {
    let key = format!("robot.servo.{key}");
    above_zero(&key, value)?;
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(problem(key, format!("{}: must be {least} to {most} {unit}", Figure(value))))
}
