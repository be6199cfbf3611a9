#![expect(clippy::disallowed_methods, reason = "the files of an export are what is tested")]

use std::fs;

use plc_export::{ExportError, ExportedApplication, FILE, Maker, Refused, VECTORS, export, structured_text};

use crate::bed::{exported, exported_a};

#[test]
fn two_exports_are_equal_and_a_directory_with_something_in_it_is_left_alone() {
    let directory = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| directory.path().join(name));
    fs::create_dir(&other).unwrap(); // an empty one will do
    for path in [&one, &other] {
        export(&exported_a(), Maker::St, path).unwrap();
    }
    for file in [FILE, VECTORS] {
        assert_eq!(fs::read(one.join(file)).unwrap(), fs::read(other.join(file)).unwrap());
    }
    fs::write(one.join(FILE), "edited").unwrap();
    assert!(
        matches!(export(&exported_a(), Maker::St, &one), Err(ExportError::NotEmpty(path)) if path == one)
    );
    assert_eq!(fs::read_to_string(one.join(FILE)).unwrap(), "edited");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 2, "nothing half written is left");
}

#[test]
fn what_exceeds_a_plc_is_refused_with_the_size_that_fits() {
    let a = exported_a();
    let motions = a.motions.iter().copied().cycle().take(100_000).collect();
    let found = 100_000 + a.from_end.len() + usize::from(a.from_anywhere.is_some());
    let refused = structured_text(&ExportedApplication { motions, ..a.clone() }).unwrap_err();
    assert_eq!(refused, Refused::TooManyMotions { found, most: 100_000 });
    let refused = structured_text(&ExportedApplication { robot_cycle_us: 15_001, ..a }).unwrap_err();
    assert_eq!(refused, Refused::LongCycle { found: 15_001, most: 15_000 });
}

#[test]
fn vectors_run_each_execution_type_in_both_byte_orders() {
    let a = exported_a();
    let lines = plc_export::vectors(&structured_text(&a).unwrap(), &a).unwrap();
    assert!(
        lines.lines().all(|line| !line.contains("\"scan\":1000,")),
        "the runs of Setup A end by themselves"
    );
    has_each_type_in_both_byte_orders(&lines);
}

#[test]
fn vectors_of_a_long_application_have_each_execution_type_too() {
    let long = exported("A", Some("palletising"));
    has_each_type_in_both_byte_orders(&plc_export::vectors(&structured_text(&long).unwrap(), &long).unwrap());
}

fn has_each_type_in_both_byte_orders(lines: &str) {
    for (field, value) in [
        ("execution_type", "1"),
        ("execution_type", "2"),
        ("execution_type", "3"),
        ("bus_big_endian", "true"),
        ("bus_big_endian", "false"),
    ] {
        assert!(lines.lines().any(|line| line.contains(&format!("\"{field}\":{value},"))), "{field} {value}");
    }
}
