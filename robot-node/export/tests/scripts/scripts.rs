use protocol::image::{Command, Control, IMAGE_LEN, Order, Skill};
use robot_export::execution::FormController;
use robot_export::layer::Flaw;

use crate::cell::{code, tested};
use crate::random::script;
use crate::rules::Rule;

/// Scripts of a test; the example `random_scripts` runs as many as it is asked for.
const SCRIPTS: u64 = 400;

/// Flaws of the layer, each with the rule that it breaks and the script from which on that is looked for: some are rare.
const FLAWS: [(Flaw, Rule, u64); 8] = [
    (Flaw::SingleRead, Rule::Sequence, 0),
    (Flaw::SlotBeforeWritten, Rule::Sequence, 0),
    (Flaw::CountAtBegin, Rule::CountedEarly, 0),
    (Flaw::CountWhenGiven, Rule::CountedUnbegun, 0),
    // The stop that is missed leaves the skill running: no halt is done in all the time that a robot has.
    (Flaw::GuardByEdgeOnly, Rule::Explained, 10_690),
    (Flaw::GrantUnseen, Rule::AfterHalt, 0),
    // The new number comes with the count of the command before.
    (Flaw::NumberBeforeFlags, Rule::CountedUnbegun, 0),
    (Flaw::LifeAfterControl, Rule::EchoAhead, 0),
];

#[test]
fn no_motion_is_lost_doubled_or_reordered_and_none_begins_after_a_halt() {
    for has_sign in [true, false] {
        let code = code(None, has_sign);
        for seed in 0..SCRIPTS {
            script(&code, seed).unwrap_or_else(|broken| panic!("script {seed}: {broken}"));
        }
    }
}

#[test]
fn each_flaw_of_the_layer_breaks_the_rule_that_it_violates() {
    for (flaw, rule, first) in FLAWS {
        let code = code(Some(flaw), true);
        let found = (first..first + 4_000).find_map(|seed| {
            let broken = script(&code, seed).err()?;
            (broken.rule == rule).then_some((seed, broken))
        });
        let (seed, broken) = found.unwrap_or_else(|| panic!("{flaw:?} does not break {rule:?}"));
        println!("{flaw:?}: script {seed}: {broken}");
    }
}

/// Withdraws a command after the robot has read it, and gives the next one between two reads of the cyclic task. Returns whether the
/// first one starts.
fn starts_after_its_withdrawal(flaw: Option<Flaw>) -> bool {
    let code = code(flaw, true);
    let mut robot = tested(&code, Order::LittleEndian, 1, |_| protocol::image::ErrorNumber::None);
    let image = |number, more: Control| {
        let control = Control::ENABLE | more;
        let mut image = [0; IMAGE_LEN];
        let skill = Skill::RunProgram;
        let command = Command {
            control,
            life: 1,
            number,
            skill,
            program: 1,
            override_percent: 100,
            ..Command::default()
        };
        Order::LittleEndian.emit_command(&command, &mut image);
        image
    };
    let until =
        |robot: &mut FormController<'_>, name, wanted, step: &mut dyn FnMut(&mut FormController<'_>)| {
            for _ in 0..2_000 {
                if robot.value(name) == Some(wanted) {
                    return;
                }
                step(robot);
            }
            panic!("{name} does not become {wanted}")
        };
    let mut first = image(0, Control::default());
    first[0..2].copy_from_slice(&[0, 0]);
    (0..200).for_each(|_| robot.step_cyclic(&first));
    until(&mut robot, "state", 1, &mut |robot| robot.step_cyclic(&image(0, Control::RESET)));
    (0..400).for_each(|_| robot.step_cyclic(&image(0, Control::default())));
    let executed = image(1, Control::EXECUTE);
    until(&mut robot, "seen_link", 1, &mut |robot| robot.step_motion(&image(0, Control::default())));
    until(&mut robot, "request", 1, &mut |robot| robot.step_motion(&executed));
    until(&mut robot, "seen_number", 1, &mut |robot| robot.step_cyclic(&image(1, Control::default())));
    let next = image(2, Control::EXECUTE);
    (0..400).any(|_| {
        robot.step_cyclic(&next);
        robot.value("state") == Some(2)
    })
}

#[test]
fn a_withdrawn_command_does_not_start_by_the_control_bits_of_the_next_one() {
    assert!(!starts_after_its_withdrawal(None));
    assert!(starts_after_its_withdrawal(Some(Flaw::ControlOfNext)));
}
