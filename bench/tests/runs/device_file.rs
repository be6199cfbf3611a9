//! Setups that take the robot's device from its file: our own files change no byte on the wire, and a run exchanges the image with
//! foreign devices in any layout.

use std::fs;
use std::path::Path;

use stands::capture::{PLC_FILE, ROBOT_FILE};
use stands::virtual_run::VirtualRun;

use crate::captures::{SeenFrame, read};
use crate::foreign_devices::{self, CHOICES, EDS, ESI, GSDML, with_lines};
use crate::program::{Finished, bench};
use crate::study_calls::study;

/// Writes a built-in setup with these lines in its section of the bus.
fn write_setup(place: &Path, name: &str, lines: &str) {
    let (_, text) = setup::SETUPS.iter().find(|(known, _)| *known == name).unwrap();
    fs::write(place.join("my.toml"), with_lines(text, lines)).unwrap();
}

fn run(place: &Path, setup: &str, out: &str) -> Finished {
    let options = ["--mode", "virtual", "--reps", "1", "--seed", "7", "--quiet", "--capture", "always"];
    bench(place, [&["--setup", setup, "--out", out], &options[..]].concat())
}

#[test]
fn through_their_own_files_a_to_d_send_the_same_frames_at_the_same_times() {
    for (name, file) in [("A", GSDML), ("B", EDS), ("C", ESI), ("D", GSDML)] {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("device"), file).unwrap();
        for (lines, out) in [("", "without"), ("device = \"device\"", "with")] {
            write_setup(place.path(), name, lines);
            let finished = run(place.path(), "my.toml", out);
            assert_eq!(finished.code, Some(0), "{name}: {}", finished.stderr);
        }
        for end in [PLC_FILE, ROBOT_FILE] {
            let [without, with] = ["without", "with"].map(|out| read(&place.path().join(out), end));
            assert!(without.len() > 10_000, "RC, SM and CM of {name}: {}", without.len());
            assert_eq!(without.len(), with.len(), "{name}");
            let different = without.iter().zip(&with).position(|(one, other)| one != other);
            let shown = |packets: &[SeenFrame]| different.and_then(|at| packets.get(at).cloned());
            assert_eq!(shown(&without), shown(&with), "{name}: frame {different:?} at {end}");
        }
    }
}

/// Returns whether a packet of a capture contains these bytes.
fn is_sent(place: &Path, bytes: &[u8]) -> bool {
    read(place, PLC_FILE).iter().any(|seen| seen.data.windows(bytes.len()).any(|window| window == bytes))
}

#[test]
fn a_foreign_device_of_a_file_carries_the_image_in_its_layout_and_the_saved_setup_runs_again_without_the_file()
 {
    // Padding, index and length of a Write; a data segment of one word; the second object of sync manager 2.
    let record = [0, 0, 0, 7, 0, 0, 0, 2];
    let configuration = [0x80, 1, 7, 0];
    let assignment = [0x12, 0x1C, 2, 0x01, 0x16];
    let started: [&[u8]; 3] = [&record, &configuration, &assignment];
    for ((name, config), started) in CHOICES.into_iter().zip(started) {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("device"), foreign_devices::file(name)).unwrap();
        fs::write(place.path().join("choice.toml"), config).unwrap();
        write_setup(place.path(), name, "device = \"device\"\nconfig = \"choice.toml\"");
        let finished = run(place.path(), "my.toml", "run");
        assert_eq!(finished.code, Some(0), "{name}: {}", finished.stderr);
        assert!(is_sent(&place.path().join("run"), started), "{name}: start-up of the file");
        for gone in ["device", "choice.toml"] {
            fs::remove_file(place.path().join(gone)).unwrap();
        }
        let again = run(place.path(), "run/setup.toml", "again");
        assert_eq!(again.code, Some(0), "{name}: {}", again.stderr);
        let [first, second] = ["run", "again"].map(|out| read(&place.path().join(out), ROBOT_FILE));
        assert_eq!(first.len(), second.len(), "{name}");
        assert!(first == second, "{name}: the copy of the setup makes the same run");
    }
}

#[test]
fn a_robot_goes_on_whose_process_data_are_assigned_in_any_phase_of_its_cycle() {
    let place = tempfile::tempdir().unwrap();
    let (name, config) = CHOICES[2];
    fs::write(place.path().join("device"), foreign_devices::file(name)).unwrap();
    fs::write(place.path().join("choice.toml"), config).unwrap();
    write_setup(place.path(), name, "device = \"device\"\nconfig = \"choice.toml\"");
    let path = place.path().join("my.toml");
    let (setup, found) = planning::setup_with_application(path.to_str().unwrap()).unwrap();
    for seed in 0..48 {
        VirtualRun::start(&setup, &found.application, seed).unwrap();
    }
}

/// One row.
const STUDY: &str = "[study]
setup = \"my.toml\"
types = [\"cm\"]
reps = 1
seeds = \"1..=1\"

[[vary]]
key = \"motions.approximation_mm\"
values = [10.0]
";

#[test]
fn a_study_whose_device_file_changed_has_other_jobs_and_does_not_take_over_the_rows_of_the_former_one() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    fs::write(place.join("study.toml"), STUDY).unwrap();
    fs::write(place.join("device"), EDS).unwrap();
    write_setup(place, "B", "device = \"device\"");
    let run = || study(place, "run study.toml --out rows --quiet");
    let first = run();
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    assert_eq!(run().code, Some(0), "the same study goes on");
    // A comment changes no device, and another product does.
    fs::write(place.join("device"), format!("$ copied\n{EDS}")).unwrap();
    assert_eq!(run().code, Some(0));
    fs::write(place.join("device"), EDS.replace("ProdCode = 1;", "ProdCode = 2;")).unwrap();
    let other = run();
    assert_eq!(other.code, Some(2), "{}", other.stderr);
    assert!(other.stderr.contains("has rows of another study"), "{}", other.stderr);
}
