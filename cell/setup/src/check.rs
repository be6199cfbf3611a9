//! Checks of well-formed values that make no sense: they are refused here, with their key, before anything starts.

use std::time::Duration;

use ethernet_ip::connection::TimeoutMultiplier;
use protocol::image::SLOTS;
use protocol::stations::ETHERNET_IP_ROBOT;

use crate::{BusKind, Cyclic, Frame, Kinematics, Opw, ProfinetDevice, Setup, Sourced};

/// A key and the error in its value.
#[derive(Debug)]
pub(crate) struct Problem {
    pub(crate) key: String,
    pub(crate) text: String,
}

type Check = Result<(), Problem>;

fn problem(key: impl Into<String>, text: impl Into<String>) -> Problem {
    Problem { key: key.into(), text: text.into() }
}

/// The version of the file format that this program reads.
const SCHEMA: u32 = 1;

/// Highest tool and base number: they have four bits each in the process image.
const MAX_FRAME: u8 = 15;

/// Highest path velocity, acceleration and approximation distance that the process image carries in 16 bits.
const MAX_VELOCITY_MM_S: f64 = 6_553.5;
const MAX_ACCELERATION_MM_S2: f64 = 65_535.0;
const MAX_APPROXIMATION_MM: f64 = 655.35;

/// Highest number of robot cycles before the first motion of a MoveContinuousSkill.
const MAX_START_CYCLES: u32 = 1_000;

/// IEC 61158-6-10: one step of the cycle counter, the unit of every PROFINET cycle time.
const PROFINET_UNIT_NS: u64 = 31_250;
/// IEC 61158-6-10: SendClockFactor up to 128 times ReductionRatio up to 512.
const PROFINET_MAX_UNITS: u64 = 128 * 512;
/// IEC 61158-6-10: data hold time of RT_CLASS_1.
const PROFINET_RT1_HOLD: Duration = Duration::from_millis(1_920);
/// IEC 61158-6-10: data hold time of RT_CLASS_UDP.
const PROFINET_UDP_HOLD: Duration = Duration::from_millis(61_440);
/// IEC 61158-6-10: DataHoldFactor.
const PROFINET_MAX_HOLD_FACTOR: u32 = 7_680;

pub(crate) fn check_setup(setup: &Setup) -> Check {
    schema(setup.schema)?;
    if let Some(paper) = &setup.paper {
        for (name, figure) in [("rc", paper.rc), ("sm", paper.sm), ("cm", paper.cm)] {
            above_zero(&format!("paper.{name}.aet_ms"), figure.aet_ms)?;
            not_negative(&format!("paper.{name}.mad_ms"), figure.mad_ms)?;
        }
    }
    plc(setup)?;
    bus(setup)?;
    robot(setup)?;
    let motions = &setup.motions;
    share("motions.velocity_percent", motions.velocity_percent.value)?;
    share("motions.acceleration_percent", motions.acceleration_percent.value)?;
    not_negative("motions.approximation_mm", motions.approximation_mm.value)?;
    at_most("motions.approximation_mm", motions.approximation_mm.value, MAX_APPROXIMATION_MM, "mm")
}

fn schema(found: u32) -> Check {
    if found == SCHEMA {
        return Ok(());
    }
    Err(problem(
        "schema",
        format!("this program reads version {SCHEMA} of the format, this is version {found}"),
    ))
}

fn plc(setup: &Setup) -> Check {
    let plc = &setup.plc;
    cycle("plc.scan_cycle_us", &plc.scan_cycle_us)?;
    if plc.scan_cost_us.value >= plc.scan_cycle_us.value {
        let text = format!(
            "a scan that costs {} µs does not fit into a cycle of {} µs",
            plc.scan_cost_us.value, plc.scan_cycle_us.value
        );
        return Err(problem("plc.scan_cost_us", text));
    }
    let (depth, slots) = (plc.slots_in_use(), SLOTS as u32);
    if !(1..=slots).contains(&depth) {
        let text =
            format!("{depth} motions do not fit: the process image has {slots} slots, so 1 to {slots}");
        return Err(problem("plc.queue_depth", text));
    }
    Ok(())
}

fn bus(setup: &Setup) -> Check {
    let bus = &setup.bus;
    cycle("bus.cycle_us", &bus.cycle_us)?;
    if bus.watchdog_cycles.value == 0 {
        return Err(problem(
            "bus.watchdog_cycles",
            "0 would give every connection up at once; at least 1, and 3 is usual",
        ));
    }
    if bus.clock_drift_ppm.value > 1_000 {
        let text = format!("{} ppm is no quartz; at most 1000", bus.clock_drift_ppm.value);
        return Err(problem("bus.clock_drift_ppm", text));
    }
    if bus.cable_delay_us.value > 100_000 {
        return Err(problem("bus.cable_delay_us", "more than 100 ms is no cable"));
    }
    if bus.plc_address == bus.robot_address {
        let text = format!("{} is the PLC's address as well", bus.robot_address);
        return Err(problem("bus.robot_address", text));
    }
    let mask = u32::from(bus.subnet_mask);
    if mask.leading_ones() + mask.trailing_zeros() != 32 {
        return Err(problem("bus.subnet_mask", format!("{} is not a subnet mask", bus.subnet_mask)));
    }
    if u32::from(bus.plc_address) & mask != u32::from(bus.robot_address) & mask {
        let text = format!("{} is not in the subnet of {}", bus.robot_address, bus.plc_address);
        return Err(problem("bus.robot_address", text));
    }
    match bus.kind {
        BusKind::Profinet => profinet(setup),
        BusKind::EthernetIp => ethernet_ip(setup),
        BusKind::Ethercat => Ok(()),
    }
}

fn ethernet_ip(setup: &Setup) -> Check {
    let bus = &setup.bus;
    let (shortest, longest) = (ETHERNET_IP_ROBOT.min_rpi_us, ETHERNET_IP_ROBOT.max_rpi_us);
    let adapter = bus.ethernet_ip.as_ref().and_then(|ethernet_ip| ethernet_ip.adapter.as_ref());
    // If a foreign adapter does not support the interval, it refuses the connection.
    if adapter.is_none() && !(shortest..=longest).contains(&bus.cycle_us.value) {
        let text = format!(
            "{} µs is not a packet interval that the robot serves: {shortest} to {longest} µs",
            bus.cycle_us.value
        );
        return Err(problem("bus.cycle_us", text));
    }
    let given = bus.ethernet_ip.as_ref().and_then(|ethernet_ip| ethernet_ip.timeout_multiplier.as_ref());
    let intervals = bus.timeout_intervals();
    let covering = TimeoutMultiplier::covering(intervals).map(TimeoutMultiplier::intervals);
    if given.is_some() && covering != Some(intervals) {
        let text =
            format!("{intervals} is not a multiplier of EtherNet/IP: 4, 8, 16, 32, 64, 128, 256 or 512");
        return Err(problem("bus.ethernet_ip.timeout_multiplier", text));
    }
    if adapter.is_some_and(|adapter| adapter.route.len() % 2 != 0) {
        let text = "a padded path has an even number of bytes";
        return Err(problem("bus.ethernet_ip.adapter.route", text));
    }
    if covering.is_none() {
        let text =
            format!("an EtherNet/IP connection waits for 512 packet intervals at most, not for {intervals}");
        return Err(problem("bus.watchdog_cycles", text));
    }
    Ok(())
}

fn profinet(setup: &Setup) -> Check {
    let bus = &setup.bus;
    let Some(profinet) = &bus.profinet else {
        return Err(problem("bus.profinet", "`kind = \"profinet\"` needs a section [bus.profinet]"));
    };
    let cycle_ns = u64::from(bus.cycle_us.value) * 1_000;
    let units = cycle_ns / PROFINET_UNIT_NS;
    if cycle_ns % PROFINET_UNIT_NS != 0 || !units.is_power_of_two() || units > PROFINET_MAX_UNITS {
        let text = format!(
            "{} µs is not a PROFINET cycle: 31.25 µs times a power of two, such as 250, 500, 1000, 2000, 4000",
            bus.cycle_us.value
        );
        return Err(problem("bus.cycle_us", text));
    }
    let hold = bus.watchdog();
    let (class, longest) = match profinet.cyclic {
        Cyclic::Udp => ("udp", PROFINET_UDP_HOLD),
        Cyclic::Rt1 => ("rt1", PROFINET_RT1_HOLD),
    };
    if hold > longest || bus.watchdog_cycles.value > PROFINET_MAX_HOLD_FACTOR {
        let most = (longest.as_nanos() / u128::from(cycle_ns)).min(u128::from(PROFINET_MAX_HOLD_FACTOR));
        let text = format!(
            "{} cycles of {} µs hold for {} ms; PROFINET allows {} ms over {class}, so at most {most} cycles",
            bus.watchdog_cycles.value,
            bus.cycle_us.value,
            hold.as_millis(),
            longest.as_millis(),
        );
        return Err(problem("bus.watchdog_cycles", text));
    }
    station_name("bus.profinet.plc_station_name", &profinet.plc_station_name)?;
    station_name("bus.profinet.robot_station_name", &profinet.robot_station_name)?;
    if profinet.plc_station_name == profinet.robot_station_name {
        return Err(problem("bus.profinet.robot_station_name", "the PLC has the same name"));
    }
    profinet.device.as_ref().map_or(Ok(()), profinet_device)
}

/// Checks that the description lists each slot and subslot once and in order, as a controller needs for its Connect.
fn profinet_device(device: &ProfinetDevice) -> Check {
    let key = "bus.profinet.device.modules";
    if !device.modules.is_sorted_by(|one, next| one.slot < next.slot) {
        return Err(problem(key, "list every slot once, the lowest first"));
    }
    for (index, module) in device.modules.iter().enumerate() {
        if module.submodules.is_empty()
            || !module.submodules.is_sorted_by(|one, next| one.subslot < next.subslot)
        {
            let text = "list every subslot once, the lowest first; a module has at least one";
            return Err(problem(format!("{key}[{index}].submodules"), text));
        }
    }
    let submodules = || device.modules.iter().flat_map(|module| &module.submodules);
    let inputs: u64 = submodules().map(|submodule| u64::from(submodule.input_bytes)).sum();
    let outputs: u64 = submodules().map(|submodule| u64::from(submodule.output_bytes)).sum();
    if inputs == 0 || outputs == 0 {
        let text = format!(
            "the modules have {inputs} bytes of input and {outputs} of output; the process image needs both"
        );
        return Err(problem(key, text));
    }
    Ok(())
}

/// Checks a name of station by IEC 61158-6-10: labels of letters, digits and hyphens, at most 63 characters each,
/// separated by dots.
fn station_name(key: &str, name: &str) -> Check {
    let label = |label: &str| {
        !label.is_empty()
            && label.len() <= 63
            && !label.starts_with('-')
            && !label.ends_with('-')
            && label.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-')
    };
    if name.len() <= 240 && name.split('.').all(label) {
        return Ok(());
    }
    let text = format!(
        "`{name}` is not a name of station: lower-case letters, digits and hyphens, in labels of 1 to 63 \
         characters with dots between them, 240 in all"
    );
    Err(problem(key, text))
}

fn robot(setup: &Setup) -> Check {
    let robot = &setup.robot;
    cycle("robot.cycle_us", &robot.cycle_us)?;
    for (key, value) in [
        ("robot.interpreter_quantum_us", Some(&robot.interpreter_quantum_us)),
        ("robot.start_quantum_us", robot.start_quantum_us.as_ref()),
        ("robot.skill_overhead_us", Some(&robot.skill_overhead_us)),
    ] {
        let Some(value) = value else { continue };
        if value.value > 10_000_000 {
            return Err(problem(key, format!("{} µs is above ten seconds", value.value)));
        }
    }
    if let Some(cycles) = &robot.continuous_start_cycles
        && cycles.value > MAX_START_CYCLES
    {
        let text = format!("{} robot cycles are above {MAX_START_CYCLES}", cycles.value);
        return Err(problem("robot.continuous_start_cycles", text));
    }
    above_zero("robot.path_velocity_mm_s", robot.path_velocity_mm_s.value)?;
    at_most("robot.path_velocity_mm_s", robot.path_velocity_mm_s.value, MAX_VELOCITY_MM_S, "mm/s")?;
    let acceleration = robot.path_acceleration_mm_s2.value;
    above_zero("robot.path_acceleration_mm_s2", acceleration)?;
    at_most("robot.path_acceleration_mm_s2", acceleration, MAX_ACCELERATION_MM_S2, "mm/s²")?;
    above_zero("robot.path_jerk_mm_s3", robot.path_jerk_mm_s3.value)?;
    if let Some(force) = &robot.force {
        for (key, value) in [
            ("robot.force.max_n", &force.max_n),
            ("robot.force.stiffest_n_per_mm", &force.stiffest_n_per_mm),
            ("robot.force.tolerance_n", &force.tolerance_n),
            ("robot.force.jerk_mm_s3", &force.jerk_mm_s3),
        ] {
            above_zero(key, value.value)?;
        }
        at_most("robot.force.settling_ms", f64::from(force.settling_ms.value), 60_000.0, "ms")?;
    }
    frames("robot.tools", &robot.tools)?;
    frames("robot.bases", &robot.bases)?;
    let joints = match &robot.kinematics {
        Kinematics::Scara(scara) => {
            above_zero("robot.kinematics.link_1_mm", scara.link_1_mm.value)?;
            above_zero("robot.kinematics.link_2_mm", scara.link_2_mm.value)?;
            finite("robot.kinematics.height_mm", &[scara.height_mm.value])?;
            4
        }
        Kinematics::Opw(opw) => {
            opw_numbers(opw)?;
            6
        }
    };
    axes(setup, joints)
}

fn opw_numbers(opw: &Opw) -> Check {
    let key = |name: &str| format!("robot.kinematics.{name}");
    for (name, length) in [
        ("a1_mm", &opw.a1_mm),
        ("a2_mm", &opw.a2_mm),
        ("b_mm", &opw.b_mm),
        ("c1_mm", &opw.c1_mm),
        ("c4_mm", &opw.c4_mm),
    ] {
        finite(&key(name), &[length.value])?;
    }
    above_zero(&key("c2_mm"), opw.c2_mm.value)?;
    above_zero(&key("c3_mm"), opw.c3_mm.value)?;
    finite(&key("offsets_deg"), &opw.offsets_deg.value)?;
    if let Some(offset) = opw.offsets_deg.value.iter().find(|offset| offset.abs() > 360.0) {
        return Err(problem(key("offsets_deg"), format!("{offset}° is more than a full turn")));
    }
    if let Some(sign) = opw.signs.value.iter().find(|sign| sign.abs() != 1) {
        let text = format!("{sign} is not the sense of a joint: 1, or -1 where it turns against the model");
        return Err(problem(key("signs"), text));
    }
    Ok(())
}

fn frames(key: &str, frames: &[Frame]) -> Check {
    for (index, frame) in frames.iter().enumerate() {
        let number = frame.number;
        if number == 0 || number > MAX_FRAME {
            let text = format!("{number} is not the number of a frame that can be listed: 1 to {MAX_FRAME}");
            return Err(problem(format!("{key}[{index}].number"), text));
        }
        if frames.iter().take(index).any(|earlier| earlier.number == number) {
            return Err(problem(format!("{key}[{index}].number"), format!("{number} is there twice")));
        }
        finite(&format!("{key}[{index}].mm_deg"), &frame.mm_deg.value)?;
    }
    Ok(())
}

fn axes(setup: &Setup, joints: usize) -> Check {
    let axes = &setup.robot.axes;
    for (name, values) in [
        ("lower_deg", &axes.lower_deg),
        ("upper_deg", &axes.upper_deg),
        ("speed_deg_s", &axes.speed_deg_s),
        ("acceleration_deg_s2", &axes.acceleration_deg_s2),
        ("jerk_deg_s3", &axes.jerk_deg_s3),
        ("home_deg", &axes.home_deg),
    ] {
        let key = format!("robot.axes.{name}");
        let found = values.value.len();
        if found != joints {
            return Err(problem(key, format!("{found} values for an arm of {joints} joints")));
        }
        finite(&key, &values.value)?;
        if name.contains("_s") {
            values.value.iter().try_for_each(|value| above_zero(&key, *value))?;
        }
    }
    let ranges = axes.lower_deg.value.iter().zip(&axes.upper_deg.value).zip(&axes.home_deg.value);
    for (joint, ((lower, upper), home)) in ranges.enumerate() {
        let joint = joint + 1;
        if lower >= upper {
            let text = format!("joint {joint}: the upper limit {upper} is not above the lower one {lower}");
            return Err(problem("robot.axes.upper_deg", text));
        }
        if !(lower..=upper).contains(&home) {
            let text = format!("joint {joint}: {home} is outside its range of {lower} to {upper}");
            return Err(problem("robot.axes.home_deg", text));
        }
    }
    Ok(())
}

fn cycle(key: &str, value: &Sourced<u32>) -> Check {
    match value.value {
        0 => Err(problem(key, "a cycle of 0 µs never ends; 1000 is one millisecond")),
        1..=10_000_000 => Ok(()),
        micros => Err(problem(key, format!("{micros} µs is above ten seconds"))),
    }
}

fn share(key: &str, percent: f64) -> Check {
    if percent > 0.0 && percent <= 100.0 {
        return Ok(());
    }
    Err(problem(key, format!("{percent} is not a share: above 0, at most 100 %")))
}

fn above_zero(key: &str, value: f64) -> Check {
    finite(key, &[value])?;
    if value > 0.0 { Ok(()) } else { Err(problem(key, format!("{value} is not above 0"))) }
}

fn not_negative(key: &str, value: f64) -> Check {
    finite(key, &[value])?;
    if value >= 0.0 { Ok(()) } else { Err(problem(key, format!("{value} is below 0"))) }
}

fn at_most(key: &str, value: f64, most: f64, unit: &str) -> Check {
    if value <= most {
        return Ok(());
    }
    Err(problem(key, format!("{value} {unit} is more than the process image carries, {most} {unit}")))
}

fn finite(key: &str, values: &[f64]) -> Check {
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(problem(key, format!("{value} is not a finite number"))),
        None => Ok(()),
    }
}
