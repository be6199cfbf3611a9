//! A bench that is attached to nodes whose robot's device comes from a file.

#[path = "../runs/foreign_devices.rs"]
mod foreign_devices;

use std::fs;

use crate::{BOTH, Cell, text};

pub(crate) fn a_bench_measures_on_nodes_of_the_same_device_file_and_refuses_those_of_another() {
    let place = tempfile::tempdir().unwrap();
    let path = |name: &str| place.path().join(name).to_str().unwrap().to_owned();
    let (built_in, choice) = foreign_devices::CHOICES[0];
    let (_, shipped) = setup::SETUPS.iter().find(|(name, _)| *name == built_in).unwrap();
    fs::write(path("device"), foreign_devices::file(built_in)).unwrap();
    fs::write(path("choice.toml"), choice).unwrap();
    fs::write(path("other.toml"), choice.replace("M64", "M300")).unwrap();
    for config in ["choice", "other"] {
        let lines = format!("device = \"device\"\nconfig = \"{config}.toml\"");
        fs::write(path(&format!("with-{config}.toml")), foreign_devices::with_lines(shipped, &lines))
            .unwrap();
    }
    let cell = Cell::start_of(&path("with-choice.toml"), &[]);
    let measure = |setup: &str| {
        let run = setup.rsplit('/').next().unwrap();
        let output = cell.measure(run, BOTH, &["--reps", "1", "--setup", setup]);
        (output.status.code(), text(&output.stderr))
    };
    let (code, error) = measure(&path("with-choice.toml"));
    assert_eq!(code, Some(0), "{error}");
    let (code, error) = measure(&path("with-other.toml"));
    assert_eq!(code, Some(2), "{error}");
    assert!(error.contains("runs another cell: in its setup, `bus."), "{error}");
    let (code, error) = measure(built_in);
    assert_eq!(code, Some(2), "{error}");
    assert!(error.contains("`bus.chosen_device` is a device"), "{error}");
}
