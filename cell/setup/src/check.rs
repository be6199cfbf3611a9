//! Checks of well-formed values that make no sense: they are refused here, with their key, before anything starts.

mod bus;
mod cell;
mod servo;
mod shared_zone;
mod supply;

use protocol::image::SLOTS;

pub(crate) use cell::check_cell;

use crate::problem::{Check, Problem, problem};
use crate::{
    Drives, Figure, Frame, Kinematics, Opw, Paper, Setup, Sourced, ThreeParallel, control_character,
};

/// The version of the file format that this program reads.
const SCHEMA: u32 = 1;

/// Farthest place in a cell, and largest length there, in mm (degrees).
const FARTHEST_MM: f64 = 1e6;

/// Highest tool and base number: they have four bits each in the process image.
const MAX_FRAME: u8 = 15;

/// Highest path velocity, acceleration and approximation distance that the process image carries in 16 bits.
const MAX_VELOCITY_MM_S: f64 = 6_553.5;
const MAX_ACCELERATION_MM_S2: f64 = 65_535.0;
const MAX_APPROXIMATION_MM: f64 = 655.35;

/// Largest length of an arm's part, and distance of a frame, in mm.
const MAX_LENGTH_MM: f64 = 10_000.0;

/// Largest force in N, and stiffness in N/mm.
const MAX_FORCE: f64 = 1e6;

/// Speeds, accelerations and jerks of a joint or of the tool, in degrees or mm per s, s² and s³: far beyond those of every arm.
const RATES: std::ops::RangeInclusive<f64> = 1e-3..=1e9;

/// Highest number of robot cycles before the first motion of a MoveContinuousSkill.
const MAX_START_CYCLES: u32 = 1_000;

/// Cycles that drives on EtherCAT and their MainDevice keep.
const DRIVE_CYCLES_US: std::ops::RangeInclusive<u32> = 250..=20_000;

/// Longest name of a setup in characters. With date and mode it names a directory.
const MAX_NAME: usize = 64;

pub(crate) fn check_setup(setup: &Setup) -> Check {
    schema(setup.schema)?;
    head(&setup.name, &setup.title, setup.paper.as_ref())?;
    parts(setup)
}

/// Checks what stands on top of the file.
fn head(setup_name: &str, title: &str, paper: Option<&Paper>) -> Check {
    printable("name", setup_name)?;
    printable("title", title)?;
    name(setup_name)?;
    if let Some(paper) = paper {
        for (name, figure) in [("rc", paper.rc), ("sm", paper.sm), ("cm", paper.cm)] {
            above_zero(&format!("paper.{name}.aet_ms"), figure.aet_ms)?;
            not_negative(&format!("paper.{name}.mad_ms"), figure.mad_ms)?;
        }
    }
    Ok(())
}

/// Checks the PLC, the bus, the robot and its motions.
fn parts(setup: &Setup) -> Check {
    printable("robot.model", &setup.robot.model)?;
    plc(setup)?;
    bus::check(&setup.bus)?;
    robot(setup)?;
    let motions = &setup.motions;
    share("motions.velocity_percent", motions.velocity_percent.value)?;
    share("motions.acceleration_percent", motions.acceleration_percent.value)?;
    not_negative("motions.approximation_mm", motions.approximation_mm.value)?;
    at_most("motions.approximation_mm", motions.approximation_mm.value, MAX_APPROXIMATION_MM, "mm")
}

fn printable(key: &str, text: &str) -> Check {
    control_character(text).map_or(Ok(()), |found| Err(problem(key, found)))
}

fn name(name: &str) -> Check {
    let length = name.chars().count();
    if length <= MAX_NAME && name.chars().any(char::is_alphanumeric) {
        return Ok(());
    }
    let found = if length > MAX_NAME { format!("{length} characters") } else { format!("`{name}`") };
    Err(problem(
        "name",
        format!("{found}; give it up to {MAX_NAME} characters, of which one is a letter or a digit"),
    ))
}

fn schema(found: u32) -> Check {
    if found == SCHEMA {
        return Ok(());
    }
    Err(problem(
        "schema",
        format!(
            "found {found}; write {SCHEMA} for a setup of one robot, or {} for one with [[station]]",
            crate::cell::CELL_SCHEMA
        ),
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
    supply::check(setup)
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
    rate("robot.path_jerk_mm_s3", robot.path_jerk_mm_s3.value)?;
    if let Some(force) = &robot.force {
        for (key, value) in [
            ("robot.force.max_n", &force.max_n),
            ("robot.force.stiffest_n_per_mm", &force.stiffest_n_per_mm),
            ("robot.force.tolerance_n", &force.tolerance_n),
        ] {
            above_zero(key, value.value)?;
            if value.value > MAX_FORCE {
                let text = format!("{}: must be at most {MAX_FORCE}", Figure(value.value));
                return Err(problem(key, text));
            }
        }
        rate("robot.force.jerk_mm_s3", force.jerk_mm_s3.value)?;
        at_most("robot.force.settling_ms", f64::from(force.settling_ms.value), 60_000.0, "ms")?;
    }
    if let Some(radius) = &robot.link_radius_mm {
        link("robot.link_radius_mm", radius.value)?;
    }
    frames("robot.tools", &robot.tools)?;
    frames("robot.bases", &robot.bases)?;
    let joints = match &robot.kinematics {
        Kinematics::Scara(scara) => {
            link("robot.kinematics.link_1_mm", scara.link_1_mm.value)?;
            link("robot.kinematics.link_2_mm", scara.link_2_mm.value)?;
            length("robot.kinematics.height_mm", scara.height_mm.value)?;
            4
        }
        Kinematics::Opw(opw) => {
            opw_numbers(opw)?;
            6
        }
        Kinematics::ThreeParallel(arm) => {
            three_parallel_numbers(arm)?;
            6
        }
    };
    axes(setup, joints)?;
    drives(setup)?;
    setup.robot.servo.as_ref().map_or(Ok(()), servo::check)
}

/// Checks that drives of the robot can run at its cycle and count the ways of its joints.
fn drives(setup: &Setup) -> Check {
    if setup.robot.drives.is_none() {
        return Ok(());
    }
    let (shortest, longest) = DRIVE_CYCLES_US.into_inner();
    let cycle_us = setup.robot.cycle_us.value;
    if !DRIVE_CYCLES_US.contains(&cycle_us) {
        let text = format!(
            "{cycle_us} µs is not a cycle of drives over EtherCAT: {shortest} to {longest} µs, or leave out robot.drives"
        );
        return Err(problem("robot.cycle_us", text));
    }
    let most = f64::from(i32::MAX) / Drives::INCREMENTS;
    let axes = &setup.robot.axes;
    for (key, ends) in [("lower_deg", &axes.lower_deg.value), ("upper_deg", &axes.upper_deg.value)] {
        if let Some(joint) = ends.iter().position(|end| end.abs() > most) {
            let text = format!(
                "joint {}: {} is more than a drive counts: 32 bits of {} increments per degree (mm), so up to {most:.0}; \
                 or leave out robot.drives",
                joint + 1,
                Figure(ends[joint]),
                Drives::INCREMENTS
            );
            return Err(problem(format!("robot.axes.{key}"), text));
        }
    }
    Ok(())
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
        self::length(&key(name), length.value)?;
    }
    link(&key("c2_mm"), opw.c2_mm.value)?;
    link(&key("c3_mm"), opw.c3_mm.value)?;
    offsets_and_signs(&opw.offsets_deg.value, &opw.signs.value)
}

fn three_parallel_numbers(arm: &ThreeParallel) -> Check {
    let key = |name: &str| format!("robot.kinematics.{name}");
    for (name, length) in [
        ("d1_mm", &arm.d1_mm),
        ("a2_mm", &arm.a2_mm),
        ("a3_mm", &arm.a3_mm),
        ("d4_mm", &arm.d4_mm),
        ("d5_mm", &arm.d5_mm),
        ("d6_mm", &arm.d6_mm),
    ] {
        self::length(&key(name), length.value)?;
    }
    let (a2, a3) = (arm.a2_mm.value, arm.a3_mm.value);
    if a2 * a3 <= 0.0 {
        let (a2, a3) = (Figure(a2), Figure(a3));
        let text = format!("{a3} mm beside an a2_mm of {a2} mm: both links have a length, and the same sign");
        return Err(problem(key("a3_mm"), text));
    }
    offsets_and_signs(&arm.offsets_deg.value, &arm.signs.value)
}

fn offsets_and_signs(offsets: &[f64; 6], signs: &[i8; 6]) -> Check {
    finite("robot.kinematics.offsets_deg", offsets)?;
    if let Some(offset) = offsets.iter().find(|offset| offset.abs() > 360.0) {
        return Err(problem(
            "robot.kinematics.offsets_deg",
            format!("{}° is more than a full turn", Figure(*offset)),
        ));
    }
    if let Some(sign) = signs.iter().find(|sign| sign.abs() != 1) {
        let text = format!("{sign} is not the sense of a joint: 1, or -1 where it turns against the model");
        return Err(problem("robot.kinematics.signs", text));
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
        let (key, [x, y, z, ..]) = (format!("{key}[{index}].mm_deg"), frame.mm_deg.value);
        finite(&key, &frame.mm_deg.value)?;
        [x, y, z].iter().try_for_each(|value| length(&key, *value))?;
    }
    Ok(())
}

fn axes(setup: &Setup, joints: usize) -> Check {
    let axes = &setup.robot.axes;
    for (name, values) in [
        ("lower_deg", Some(&axes.lower_deg)),
        ("upper_deg", Some(&axes.upper_deg)),
        ("speed_deg_s", Some(&axes.speed_deg_s)),
        ("acceleration_deg_s2", Some(&axes.acceleration_deg_s2)),
        ("jerk_deg_s3", Some(&axes.jerk_deg_s3)),
        ("home_deg", axes.home_deg.as_ref()),
    ] {
        let Some(values) = values else { continue };
        let key = format!("robot.axes.{name}");
        let found = values.value.len();
        if found != joints {
            // With a decimal comma both parts are whole numbers.
            let may_have_comma = found > joints && values.value.iter().all(|value| value.fract() == 0.0);
            let advice = if may_have_comma { "; write decimals with a point, not a comma" } else { "" };
            let text = format!("found {found} numbers, expected {joints}, one for each joint{advice}");
            return Err(problem(key, text));
        }
        finite(&key, &values.value)?;
        if name.contains("_s") {
            values.value.iter().try_for_each(|value| rate(&key, *value))?;
        }
    }
    let home = axes.home_deg.as_ref().map(|home| home.value.as_slice()).unwrap_or_default();
    let ranges = axes.lower_deg.value.iter().zip(&axes.upper_deg.value);
    for (joint, (lower, upper)) in ranges.enumerate() {
        let number = joint + 1;
        if lower >= upper {
            let (upper, lower) = (Figure(*upper), Figure(*lower));
            let text = format!("joint {number}: the upper limit {upper} is not above the lower one {lower}");
            return Err(problem("robot.axes.upper_deg", text));
        }
        if let Some(home) = home.get(joint).filter(|home| !(lower..=upper).contains(home)) {
            let (home, lower, upper) = (Figure(*home), Figure(*lower), Figure(*upper));
            let text = format!("joint {number}: {home} is outside its range of {lower} to {upper}");
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
    Err(problem(key, format!("{} is not a share: above 0, at most 100 %", Figure(percent))))
}

fn above_zero(key: &str, value: f64) -> Check {
    finite(key, &[value])?;
    if value > 0.0 { Ok(()) } else { Err(problem(key, format!("{} is not above 0", Figure(value)))) }
}

/// Checks a speed, an acceleration or a jerk.
fn rate(key: &str, value: f64) -> Check {
    above_zero(key, value)?;
    if RATES.contains(&value) {
        return Ok(());
    }
    let (least, most) = (RATES.start(), RATES.end());
    Err(problem(key, format!("{}: must be {least} to {most}", Figure(value))))
}

/// Checks the length of a link.
fn link(key: &str, value: f64) -> Check {
    above_zero(key, value)?;
    length(key, value)
}

/// Checks a length that an arm or a frame of it can have.
fn length(key: &str, value: f64) -> Check {
    finite(key, &[value])?;
    if value.abs() <= MAX_LENGTH_MM {
        return Ok(());
    }
    Err(problem(key, format!("{} mm is more than an arm has: at most {MAX_LENGTH_MM} mm", Figure(value))))
}

fn not_negative(key: &str, value: f64) -> Check {
    finite(key, &[value])?;
    if value >= 0.0 { Ok(()) } else { Err(problem(key, format!("{} is below 0", Figure(value)))) }
}

fn at_most(key: &str, value: f64, most: f64, unit: &str) -> Check {
    if value <= most {
        return Ok(());
    }
    let value = Figure(value);
    Err(problem(key, format!("{value} {unit} is more than the process image carries, {most} {unit}")))
}

fn finite(key: &str, values: &[f64]) -> Check {
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(problem(key, format!("{value} is not a finite number"))),
        None => Ok(()),
    }
}
