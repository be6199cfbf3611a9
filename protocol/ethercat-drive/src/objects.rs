//! Exchange between a drive and its SubDevice: process data as the controller has mapped them, and settings by SDO.

use ethercat_subdevice::{DeviceId, Segment};
use machine::Duration;

use crate::description::{
    CONTROL_WORD, ERROR_CODE, ERROR_REGISTER, FOLLOWING_ERROR, INTERPOLATION_PERIOD, MAX_TORQUE, MODE,
    MODE_DISPLAY, POSITION, POSITION_DEMAND, QUICK_STOP_DECELERATION, QUICK_STOP_OPTION, STATUS_WORD,
    TARGET_POSITION, TORQUE, VELOCITY, WINDOW, WINDOW_TIME,
};
use crate::drive::{Drive, Parameters, QuickStop};
use crate::process_data::Outputs;

/// Powers of ten in which 0x60C2 may count, with the nanoseconds that each is.
const POWERS_NS: [(i8, u64); 7] = [
    (-6, 1_000),
    (-5, 10_000),
    (-4, 100_000),
    (-3, 1_000_000),
    (-2, 10_000_000),
    (-1, 100_000_000),
    (0, 1_000_000_000),
];

/// Reads the outputs; `None` while there are none. Where a controller has mapped other ones than the described, each comes from
/// wherever its object is; a target that is not mapped holds the motor where it is.
pub(crate) fn outputs(segment: &Segment, id: DeviceId, drive: &Drive) -> Option<Outputs> {
    let data = segment.outputs(id)?;
    if segment.is_mapped_as_described(id) {
        return Outputs::parse(data);
    }
    let number = |index| segment.number(id, index, 0).unwrap_or(0);
    let is_mapped = |index| segment.object(id, index, 0).is_none();
    let target = number(TARGET_POSITION) as u32;
    Some(Outputs {
        control_word: number(CONTROL_WORD) as u16,
        target: if is_mapped(TARGET_POSITION) { target.cast_signed() } else { drive.position() },
        mode: (number(MODE) as u8).cast_signed(),
    })
}

/// Passes the inputs of a drive to its SubDevice, wherever the controller has mapped them.
pub(crate) fn set_inputs(segment: &mut Segment, id: DeviceId, drive: &Drive) {
    let inputs = drive.inputs();
    // The device exists, and its objects have these lengths.
    let mut set = |index, number: i64| {
        let _ = segment.set_number(id, index, 0, number.cast_unsigned());
    };
    set(POSITION_DEMAND, drive.position_demand().into());
    set(VELOCITY, drive.velocity().into());
    set(TORQUE, drive.torque().into());
    set(ERROR_REGISTER, inputs.error.register().into());
    if segment.is_mapped_as_described(id) {
        let _ = segment.set_inputs(id, &inputs.bytes());
        return;
    }
    let mut set = |index, number: i64| {
        let _ = segment.set_number(id, index, 0, number.cast_unsigned());
    };
    set(STATUS_WORD, inputs.status_word.0.into());
    set(POSITION, inputs.position.into());
    set(FOLLOWING_ERROR, inputs.following_error.into());
    set(ERROR_CODE, inputs.error.0.into());
    set(MODE_DISPLAY, inputs.mode.into());
}

/// Reads the settings that the controller wrote by SDO.
pub(crate) fn parameters(segment: &Segment, id: DeviceId) -> Parameters {
    let u32 = |index| {
        segment.object(id, index, 0).and_then(|value| value.first_chunk()).copied().map(u32::from_le_bytes)
    };
    let u16 = |index| {
        segment.object(id, index, 0).and_then(|value| value.first_chunk()).copied().map(u16::from_le_bytes)
    };
    Parameters {
        window: u32(WINDOW).filter(|window| *window != u32::MAX),
        window_time: Duration::from_millis(u16(WINDOW_TIME).unwrap_or(0).into()),
        quick_stop: QuickStop::of(u16(QUICK_STOP_OPTION).unwrap_or(0).cast_signed()),
        deceleration: f64::from(u32(QUICK_STOP_DECELERATION).unwrap_or(0).max(1)),
        torque: f64::from(u16(MAX_TORQUE).unwrap_or(0).max(1)) / 1e3,
    }
}

/// Reads the interpolation time period that the controller wrote.
pub(crate) fn period(segment: &Segment, id: DeviceId) -> Option<Duration> {
    let number = segment.number(id, INTERPOLATION_PERIOD, 1)?;
    let power = (segment.number(id, INTERPOLATION_PERIOD, 2)? as u8).cast_signed();
    let (_, ns) = POWERS_NS.into_iter().find(|(known, _)| *known == power)?;
    Some(Duration::from_nanos(number * ns))
}

/// Shows an interpolation time period, in the coarsest unit that has it, or the nearest shorter one in microseconds.
pub(crate) fn show_period(segment: &mut Segment, id: DeviceId, period: Duration) {
    let period_ns = u64::try_from(period.as_nanos()).unwrap_or(u64::MAX);
    let exact = POWERS_NS.into_iter().rev().find(|(_, ns)| period_ns % ns == 0 && period_ns / ns <= 255);
    let rounded = || POWERS_NS.into_iter().find(|(_, ns)| period_ns / ns <= 255);
    let Some((power, ns)) = exact.filter(|_| period_ns > 0).or_else(rounded) else { return };
    // The entries exist.
    let _ = segment.set_number(id, INTERPOLATION_PERIOD, 1, (period_ns / ns).max(1));
    let _ = segment.set_number(id, INTERPOLATION_PERIOD, 2, i64::from(power).cast_unsigned());
}
