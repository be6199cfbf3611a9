//! Random lists on both setups' arms and on others of their kind, and the lists that once broke a law. `bench judge` runs as
//! many as one asks for.
#![expect(clippy::unwrap_used, reason = "a test fails where there is nothing to unwrap")]

use std::fs;

use judge::{Case, Class, generator, hunt, run};

/// Lists for each setup.
const LISTS: u64 = 3_000;

#[track_caller]
fn no_list_breaks_a_law(setup: &str, seed: u64) {
    let setup = setup::setup(setup).unwrap();
    let tally = hunt(&setup, seed, 0..LISTS, &Class::ALL).unwrap();
    let words: Vec<String> =
        tally.found.iter().map(|(number, violation)| format!("list {number}: {violation}")).collect();
    assert!(words.is_empty(), "setup {}, seed {seed}:\n{}", setup.name, words.join("\n"));
    // A robot that refuses everything would break no law either.
    let [done, ..] = tally.ended;
    assert!(done > LISTS / 2 && tally.motions > 2 * LISTS, "{done} skills done, {} motions", tally.motions);
}

#[test]
fn no_list_breaks_a_law_on_the_scara() {
    no_list_breaks_a_law("A", 1);
}

#[test]
fn no_list_breaks_a_law_on_the_six_axis_arm() {
    no_list_breaks_a_law("B", 1);
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

#[test]
fn lists_that_broke_a_law_once_break_none_any_more() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/cases");
    let mut cases = 0;
    for file in fs::read_dir(folder).unwrap() {
        let file = file.unwrap().path();
        let case = Case::parse(&fs::read_to_string(&file).unwrap()).unwrap();
        let setup = setup::setup(&case.setup).unwrap();
        let found = run(&case, &setup, &Class::ALL).unwrap().violation;
        assert!(found.is_none(), "{}: {}", file.display(), found.unwrap());
        cases += 1;
    }
    assert!(cases >= 8, "{cases} cases in {folder}");
}
