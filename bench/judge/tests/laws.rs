//! Random lists on both setups' arms and on others of their kind: the laws that hold today. `bench judge` looks for all of
//! them, and for as many lists as one asks for.
#![expect(clippy::unwrap_used, reason = "a test fails where there is nothing to unwrap")]

use judge::{Case, Class, generator, hunt, run};

/// Lists for each setup.
const LISTS: u64 = 1_500;

/// The laws that no list is known to break.
const HELD: [Class; 9] = [
    Class::Finite,
    Class::Range,
    Class::Turn,
    Class::ToolSpeed,
    Class::ShareOfAcceleration,
    Class::Done,
    Class::State,
    Class::Feedback,
    Class::Force,
];

#[track_caller]
fn no_list_breaks_a_held_law(setup: &str, seed: u64) {
    let setup = setup::setup(setup).unwrap();
    let tally = hunt(&setup, seed, 0..LISTS, &HELD).unwrap();
    let words: Vec<String> =
        tally.found.iter().map(|(number, violation)| format!("list {number}: {violation}")).collect();
    assert!(words.is_empty(), "setup {}, seed {seed}:\n{}", setup.name, words.join("\n"));
    // A robot that refuses everything would break no law either.
    let [done, ..] = tally.ended;
    assert!(done > LISTS / 2 && tally.motions > 2 * LISTS, "{done} skills done, {} motions", tally.motions);
}

#[test]
fn no_list_breaks_a_held_law_on_the_scara() {
    no_list_breaks_a_held_law("A", 1);
}

#[test]
fn no_list_breaks_a_held_law_on_the_six_axis_arm() {
    no_list_breaks_a_held_law("B", 1);
}

#[test]
fn a_case_runs_from_its_file_as_it_ran_from_its_seed() {
    let setup = setup::setup("B").unwrap();
    for number in 0..40 {
        let case = generator::case(&setup, 3, number);
        let again = Case::parse(&case.to_toml().unwrap()).unwrap();
        assert_eq!(again, case);
        assert_eq!(run(&again, &setup, &Class::ALL), run(&case, &setup, &Class::ALL), "list {number}");
    }
}
