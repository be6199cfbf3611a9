//! No verb replaces a file of the user's: neither by `--out` nor by a file that it is asked for.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::program::{Finished, bench};

fn call(place: &Path, arguments: &str) -> Finished {
    bench(place, arguments.split(' '))
}

/// Returns the content of every file below a directory.
fn contents(directory: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    found
}

/// Checks that every call is refused as a wrong command line with these words, and changes no file.
fn refused(place: &Path, calls: &[(&str, &str)]) {
    let before = contents(place);
    for (arguments, words) in calls {
        let Finished { code, stderr, .. } = call(place, arguments);
        assert_eq!(code, Some(2), "{arguments}: {stderr}");
        assert!(stderr.contains(words), "{arguments}: {stderr}");
        assert_eq!(contents(place), before, "{arguments}");
    }
}

#[test]
fn the_directory_of_a_cell_or_of_another_study_is_refused_and_left_as_it_is() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    assert_eq!(call(place, "new cell").code, Some(0));
    let explore = "explore --types cm --kinds lose --every 400 --quiet --out explored";
    let sweep = "sweep --depths 2 --cycles 1 --lengths 2 --motions 8 --reps 1 --quiet --out swept";
    for study in [explore, sweep] {
        assert_eq!(call(place, study).code, Some(0));
        let saved = contents(place);
        assert_eq!(call(place, study).code, Some(0), "the same study again");
        assert_eq!(contents(place), saved);
    }
    let holds_setup = "holds another setup.toml, which would be replaced; choose another directory by --out";
    refused(
        place,
        &[
            ("--mode virtual --out cell", holds_setup),
            ("--setup cell/setup.toml --mode virtual --out cell", holds_setup),
            ("sweep --setup cell/setup.toml --out cell", holds_setup),
            ("sensitivity --setup cell/setup.toml --out cell", holds_setup),
            ("explore --setup cell/setup.toml --out cell", holds_setup),
            ("--mode virtual --out explored", holds_setup),
            (&sweep.replace("swept", "explored"), "holds another setup.toml"),
            (&format!("{sweep} --setup B"), holds_setup),
            (
                &explore.replace("400", "300"),
                "has jobs of other options; use another --out, or these: --setup A --types cm",
            ),
        ],
    );
}

#[test]
fn the_setup_of_an_exploration_runs_what_was_explored() {
    let place = tempfile::tempdir().unwrap();
    let explore = "explore --types cm --kinds lose --every 900 --quiet --out explored";
    assert_eq!(call(place.path(), explore).code, Some(0));
    let ran = call(place.path(), "--setup explored/setup.toml --mode virtual --types cm --reps 1 --quiet");
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
}

#[test]
fn a_file_that_is_asked_for_replaces_neither_an_input_nor_a_file_of_a_run() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    let run = "--setup cell/setup.toml --mode virtual --types cm --reps 1 --quiet";
    for made in ["new cell", "long --motions 20 --write list.csv", &format!("{run} --out run")] {
        assert_eq!(call(place, made).code, Some(0), "{made}");
    }
    let of_run = "a file of the run there; name another file";
    refused(
        place,
        &[
            (&format!("{run} --export-json cell/setup.toml"), "--export-json would replace cell/setup.toml"),
            (
                &format!("{run} --export-csv cell/../cell/application.toml"),
                "application.toml, the application",
            ),
            (&format!("{run} --export-junit a --export-markdown ./a"), "two exports go to "),
            (&format!("{run} --out new --export-csv new/samples.csv"), "which is written there anyway"),
            (
                "sweep --setup cell/setup.toml --out new --export-csv cell/setup.toml",
                "the setup; name another",
            ),
            ("sweep --out new --export-json a --export-csv a", "two exports go to a"),
            ("sensitivity --out new --export-csv new/sensitivity.json", "which is written there anyway"),
            ("long --from list.csv --write list.csv", "the list of --from; name another file"),
            (
                "long --application cell/application.toml --motions 10 --write cell/application.toml",
                "would replace",
            ),
            ("report run --out run/samples.csv", of_run),
            ("compare run run --html run/results.json", of_run),
            ("history . --html run/race.html", of_run),
        ],
    );
    assert_eq!(call(place, "report run --out run/report.html").code, Some(0), "the report is the run's own");
}

#[test]
fn a_list_that_cannot_be_written_to_its_end_leaves_the_old_one() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    assert_eq!(call(place, "long --motions 20 --write list.csv").code, Some(0));
    let whole = fs::read_to_string(place.join("list.csv")).unwrap();
    let broken = whole.lines().take(12).map(|line| format!("{line}\n")).collect::<String>() + "no motion\n";
    fs::write(place.join("broken.csv"), broken).unwrap();
    refused(place, &[("long --from broken.csv --write list.csv", "broken.csv:13")]);
}
