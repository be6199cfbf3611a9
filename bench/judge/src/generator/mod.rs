//! Random cases: an arm, motions of every kind and disturbances, from a seed.
//!
//! Motions are drawn as short phrases that belong together (a chain along one line, a spline, a turn of the wrist and
//! the lines after it), because corners between different kinds of motions and rows of similar ones are where planners
//! fail. Targets are drawn as joints, so that most are reached. A line between two targets may still leave a joint's
//! range or pass a singular position: the robot has to refuse it properly.

mod arm;
mod controller;
mod dice;
mod phrase;

use setup::Setup;

use crate::case::{Arm, Case, Event, Execution, Intervention, OtherController, Run, SCHEMA};
use dice::Dice;
use phrase::Walk;

/// The share of cases with an arm of other links and limits than the setup's.
const OTHER_ARM: f64 = 0.35;

/// The lowest override that moves the arm, in percent: with less, most lists would take longer than the judge waits.
const LEAST_OVERRIDE_PERCENT: u8 = 8;

/// The share of lists of compact points on a robot that takes them.
const TRAJECTORY: f64 = 0.4;

/// The share of cases with another robot controller than the setup's.
const OTHER_CONTROLLER: f64 = 0.35;

/// Returns the case of this number among the cases of a seed, on the setup's controller and with overrides above 0 %.
#[must_use]
pub fn case(setup: &Setup, seed: u64, number: u64) -> Case {
    draw(&mut dice(seed, number), setup, None, LEAST_OVERRIDE_PERCENT)
}

/// Returns a case that may also have another controller than the setup's, and overrides of 0 %: the arm stops on its path,
/// and goes on with the next override.
#[must_use]
pub fn any_case(setup: &Setup, seed: u64, number: u64) -> Case {
    let mut dice = dice(!seed, number);
    let other = dice.chance(OTHER_CONTROLLER).then(|| controller::another(&mut dice, setup));
    draw(&mut dice, setup, other, 0)
}

fn dice(seed: u64, number: u64) -> Dice {
    // Any two numbers give unrelated streams: the generator mixes its seed.
    Dice::new(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(number))
}

fn draw(dice: &mut Dice, setup: &Setup, controller: Option<OtherController>, least_override: u8) -> Case {
    let setup = &controller.map_or_else(|| setup.clone(), |other| other.of(setup));
    let mut arm = Arm::of(setup);
    if dice.chance(OTHER_ARM) {
        arm = arm::another(dice, &arm);
    }
    let home = arm::anywhere(dice, &arm);
    arm.home_deg = home.iter().take(arm.links.axes()).copied().collect();
    let mut case = Case {
        schema: SCHEMA,
        found: String::new(),
        setup: setup.name.clone(),
        seed: dice.bits() >> 1,
        skill_overhead_ms: if dice.chance(0.15) { dice.below(40) as u32 } else { 0 },
        tools: arm::tools(dice, &arm),
        bases: arm::bases(dice, &arm),
        arm,
        controller,
        surfaces: Vec::new(),
        runs: Vec::new(),
    };
    let runs = if dice.chance(0.15) { 2 } else { 1 };
    for _ in 0..runs {
        let run = run(dice, &mut case, setup, least_override);
        case.runs.push(run);
    }
    case
}

fn run(dice: &mut Dice, case: &mut Case, setup: &Setup, least_override: u8) -> Run {
    let execution = dice.pick(&[(Execution::Continuous, 8), (Execution::Program, 1), (Execution::Single, 1)]);
    let count = match dice.below(20) {
        0 => 12 + dice.below(24),
        1..4 => 6 + dice.below(6),
        _ => 1 + dice.below(6),
    };
    // Without compact points the dice fall as they always did.
    let is_trajectory = setup.robot.takes_compact_points() && dice.chance(TRAJECTORY);
    let execution = if is_trajectory { Some(Execution::Trajectory) } else { execution };
    let mut walk = Walk::new(case, setup);
    let mut motions = Vec::with_capacity(count + 8);
    if is_trajectory {
        walk.points(dice, &mut motions, 4 * count);
    }
    while motions.len() < count {
        walk.phrase(dice, &mut motions, count);
    }
    let surface = walk.surface();
    case.surfaces.extend(surface);
    if dice.chance(0.25) {
        phrase::soften(dice, &mut motions, setup);
        if is_trajectory {
            phrase::soften_as_the_first(&mut motions);
        }
    }
    if dice.chance(0.02) {
        phrase::spoil(dice, &mut motions);
    }
    if dice.chance(0.25) {
        let mut cycle = 0;
        for motion in &mut motions {
            if dice.chance(0.4) {
                cycle += dice.scale(1.0, 200.0) as u32;
            }
            motion.written_in_cycle = cycle;
        }
    }
    Run {
        execution: execution.unwrap_or(Execution::Continuous),
        events: events(dice, least_override),
        motions,
    }
}

/// Draws the events: none as a rule, or some changes of the override, suspends, and at most one end.
fn events(dice: &mut Dice, least_override: u8) -> Vec<Event> {
    let mut events = Vec::new();
    let mut cycle = 0;
    let mut at = |dice: &mut Dice, what: Intervention| {
        cycle += dice.scale(1.0, 150.0) as u32;
        events.push(Event { cycle, what });
    };
    if dice.chance(0.3) {
        for _ in 0..=dice.below(5) {
            let percent = override_percent(dice, least_override);
            at(dice, Intervention::Override(percent));
        }
        if least_override == 0 {
            at(dice, Intervention::Override(100));
        }
    }
    if dice.chance(0.2) {
        for _ in 0..=dice.below(3) {
            at(dice, Intervention::Suspend);
            at(dice, Intervention::Resume);
        }
    }
    if dice.chance(0.15) {
        for _ in 0..=dice.below(4) {
            let percent = dice.below(121) as u8;
            at(dice, Intervention::Lead(percent));
            if dice.chance(0.4) {
                let millis = dice.scale(1.0, 5_000.0) as i32;
                let is_back = dice.chance(0.5);
                at(dice, Intervention::Jump(if is_back { -millis } else { millis }));
            }
            if dice.chance(0.2) {
                let cycles = dice.scale(1.0, 200.0) as u16;
                at(dice, Intervention::Starve(cycles));
            }
            if dice.chance(0.3) {
                at(dice, Intervention::Free);
            }
        }
        at(dice, Intervention::Free);
    }
    if dice.chance(0.12) {
        let end =
            dice.pick(&[(Intervention::Halt, 4), (Intervention::Disable, 1), (Intervention::Disconnect, 1)]);
        at(dice, end.unwrap_or(Intervention::Halt));
    }
    events
}

fn override_percent(dice: &mut Dice, least: u8) -> u8 {
    if least == 0 && dice.chance(0.3) {
        return 0;
    }
    (dice.scale(LEAST_OVERRIDE_PERCENT.into(), 101.0) as u8).min(100)
}
