//! Random lists on the setups' arms and controllers and on others of their kind, and the lists that once broke a law.
//! `bench judge` runs as many as one asks for.
#![expect(clippy::unwrap_used, reason = "a test fails where there is nothing to unwrap")]

use std::collections::BTreeSet;
use std::fs;

use judge::{Case, Class, generator, hunt, run};
use protocol::image::MotionKind;
use setup::{Refill, Setup};

/// Lists for each setup.
const LISTS: u64 = 5_000;

/// Lists on the slower arm.
const LISTS_OF_D: u64 = 1_000;

#[track_caller]
fn no_list_breaks_a_law(setup: &str, seed: u64) {
    no_list_of(&setup::setup(setup).unwrap(), seed, LISTS);
}

#[track_caller]
fn no_list_of(setup: &Setup, seed: u64, lists: u64) {
    no_list_breaks_one_of(&Class::ALL, setup, seed, lists);
}

#[track_caller]
fn no_list_breaks_one_of(classes: &[Class], setup: &Setup, seed: u64, lists: u64) {
    let tally = hunt(generator::any_case, setup, seed, 0..lists, classes).unwrap();
    let words: Vec<String> =
        tally.found.iter().map(|(number, violation)| format!("list {number}: {violation}")).collect();
    assert!(words.is_empty(), "setup {}, seed {seed}:\n{}", setup.name, words.join("\n"));
    // A robot that refuses everything would break no law either.
    let [done, ..] = tally.ended;
    assert!(done > lists / 2 && tally.motions > lists, "{done} skills done, {} motions", tally.motions);
}

#[test]
fn the_generator_draws_every_standard_kind_of_motion() {
    let setup = setup::setup("B").unwrap();
    let cases = (0..500).map(|number| generator::any_case(&setup, 1, number));
    let motions = cases.flat_map(|case| case.runs).flat_map(|run| run.motions);
    let drawn: BTreeSet<u8> = motions.map(|motion| MotionKind::from(motion.kind).into()).collect();
    assert_eq!(drawn, MotionKind::standard().map(u8::from).collect());
}

#[test]
fn no_list_breaks_a_law_on_the_scara() {
    no_list_breaks_a_law("A", 1);
}

#[test]
fn no_list_breaks_a_law_on_the_six_axis_arm() {
    no_list_breaks_a_law("B", 1);
}

/// Lists on each robot with compact points.
const LISTS_OF_POINTS: u64 = 1_000;

#[test]
fn no_list_of_compact_points_breaks_a_law_that_deep_queues_keep() {
    for (name, refill) in [("A", Refill::Executed), ("A", Refill::Accepted), ("B", Refill::Accepted)] {
        let setup = setup::setup(name).unwrap().with_queue_motions(64).with_compact_points();
        let setup = setup.with_refill(refill);
        let runs = (0..100).flat_map(|number| generator::any_case(&setup, 7, number).runs);
        assert!(runs.filter(|run| run.points().is_some()).count() > 20);
        no_list_of(&setup, 7, LISTS_OF_POINTS);
    }
}

#[track_caller]
fn no_list_breaks_a_law_of(setup: &Setup, seed: u64, numbers: &[u64]) {
    for number in numbers {
        let found = hunt(generator::any_case, setup, seed, *number..number + 1, &Class::ALL).unwrap().found;
        assert!(found.is_empty(), "{}, list {number} of seed {seed}: {}", setup.name, found[0].1);
    }
}

#[test]
fn lists_of_compact_points_that_broke_a_law_of_the_tool_break_none_any_more() {
    let setup = setup::setup("A").unwrap().with_queue_motions(64).with_compact_points();
    for refill in [Refill::Executed, Refill::Accepted] {
        let setup = setup.clone().with_refill(refill);
        for (seed, number) in [(7, 1211), (11, 1177), (22, 2678)] {
            no_list_breaks_a_law_of(&setup, seed, &[number]);
        }
    }
}

#[test]
fn points_that_turn_back_do_not_hide_the_jerk_of_a_slow_joint_from_a_law_with_few_knots() {
    let setup = setup::setup("B").unwrap().with_queue_motions(64).with_compact_points();
    for refill in [Refill::Executed, Refill::Accepted] {
        no_list_breaks_a_law_of(&setup.clone().with_refill(refill), 24, &[1155]);
    }
}

#[test]
fn joints_keep_their_rated_speed_between_the_knots_of_a_law() {
    for (name, seed, number) in [("B", 4711, 4144), ("D", 4711, 19_441), ("B", 6101, 4281)] {
        no_list_breaks_a_law_of(&setup::setup(name).unwrap(), seed, &[number]);
    }
}

#[test]
fn no_list_breaks_a_law_on_an_arm_without_a_spherical_wrist() {
    no_list_of(&setup::setup("D").unwrap(), 1, LISTS_OF_D);
}

/// Velocity, acceleration and jerk of a path in mm and s: gentle, and as shipped.
const GENTLE: [f64; 3] = [2_000.0, 1_000.0, 20_000.0];
const SHIPPED: [f64; 3] = [2_000.0, 5_000.0, 500_000.0];

/// A shipped setup with another robot cycle and other limits of the path.
fn changed(name: &str, cycle_us: u32, [velocity, acceleration, jerk]: [f64; 3]) -> Setup {
    let mut setup = setup::setup(name).unwrap();
    setup.robot.cycle_us.value = cycle_us;
    setup.robot.path_velocity_mm_s.value = velocity;
    setup.robot.path_acceleration_mm_s2.value = acceleration;
    setup.robot.path_jerk_mm_s3.value = jerk;
    setup
}

#[test]
fn lists_that_broke_a_law_with_other_cycles_or_limits_break_none_any_more() {
    const SLOWER: [f64; 3] = [2_000.0, 800.0, 20_000.0];
    type Found = (&'static str, u32, [f64; 3], u64, &'static [u64]);
    let found: [Found; 5] = [
        // A ramp of the override ended within the cycle that had begun it, so that the arm slowed down late.
        ("A", 12_000, SHIPPED, 77, &[20, 38, 80, 1416, 1656, 2038]),
        ("B", 8_000, SHIPPED, 77, &[4, 12, 71, 2254]),
        // With no step shorter than the cycle, an arm that is stopped in a quicker corner could never go on.
        ("A", 12_000, GENTLE, 5, &[2059]),
        // A force began in the cycle after the one in which the path before it ended, with all of the path's jerk.
        ("A", 4_000, GENTLE, 77, &[422, 2043, 6428]),
        ("B", 4_000, SLOWER, 77, &[1684, 8954, 9444]),
    ];
    for (name, cycle_us, limits, seed, numbers) in found {
        let setup = changed(name, cycle_us, limits);
        for number in numbers {
            let found = hunt(generator::case, &setup, seed, *number..number + 1, &Class::ALL).unwrap().found;
            assert!(found.is_empty(), "{name}, {cycle_us} µs, list {number}: {}", found[0].1);
        }
    }
}

#[test]
fn a_case_runs_from_its_file_as_it_ran_from_its_seed() {
    let setup = setup::setup("B").unwrap();
    for number in 0..40 {
        let case = generator::any_case(&setup, 3, number);
        let again = Case::parse("case", &case.to_toml().unwrap()).unwrap();
        assert_eq!(again, case);
        assert_eq!(run(&again, &setup, &Class::ALL), run(&case, &setup, &Class::ALL), "list {number}");
    }
}

#[test]
fn lists_that_broke_a_law_once_break_none_any_more() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/cases");
    let mut cases = 0;
    for file in fs::read_dir(folder).unwrap() {
        let file = file.unwrap().path();
        let case = Case::parse("case", &fs::read_to_string(&file).unwrap()).unwrap();
        let setup = setup::setup(&case.setup).unwrap();
        let found = run(&case, &setup, &Class::ALL).unwrap().violation;
        assert!(found.is_none(), "{}: {}", file.display(), found.unwrap());
        cases += 1;
    }
    assert!(cases >= 8, "{cases} cases in {folder}");
}

/// Changes the list of numbers at `index`, counted through a document; returns its length before, and whether there is one.
fn change_list(
    value: &mut toml::Value,
    index: &mut usize,
    change: fn(&mut Vec<toml::Value>),
) -> Option<usize> {
    match value {
        toml::Value::Table(table) => {
            table.iter_mut().find_map(|(_, value)| change_list(value, index, change))
        }
        toml::Value::Array(list) if list.iter().all(|it| it.is_float() || it.is_integer()) => {
            if *index > 0 {
                *index -= 1;
                return None;
            }
            let length = list.len();
            change(list);
            Some(length)
        }
        toml::Value::Array(list) => list.iter_mut().find_map(|value| change_list(value, index, change)),
        _ => None,
    }
}

#[test]
fn one_number_more_or_less_is_refused_in_every_list_of_a_case() {
    for name in ["A", "B", "D"] {
        let setup = setup::setup(name).unwrap();
        for number in 0..8 {
            let text = generator::any_case(&setup, 5, number).to_toml().unwrap();
            let changed = |mut index: usize, change: fn(&mut Vec<toml::Value>)| {
                let mut document: toml::Value = toml::from_str(&text).unwrap();
                let length = change_list(&mut document, &mut index, change)?;
                let text = toml::to_string(&document).unwrap();
                Some((length, Case::parse("case", &text).unwrap_err().to_string()))
            };
            let mut lists = 0;
            while let Some((length, longer)) = changed(lists, |list| list.push(list[0].clone())) {
                let (_, shorter) = changed(lists, |list| drop(list.pop())).unwrap();
                for (found, said) in [(length + 1, longer), (length - 1, shorter)] {
                    assert!(said.contains(&format!("found {found} numbers, expected {length}")), "{said}");
                }
                lists += 1;
            }
            assert!(lists >= 7, "a case has the arm's lists and those of motions, not {lists}");
        }
    }
}
