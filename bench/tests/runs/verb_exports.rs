//! Verbs that print figures write them for other programs, too: JSON and CSV have the same names and numbers.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::program::bench;

fn ran(directory: &Path, arguments: &str) -> String {
    let finished = bench(directory, arguments.split(' '));
    assert_eq!(finished.code, Some(0), "{arguments}: {}", finished.stderr);
    finished.stdout
}

/// Runs a verb with both exports and returns them: JSON, and the rows of the CSV by column.
fn exports(directory: &Path, verb: &str) -> (Value, Vec<Vec<(String, String)>>) {
    ran(directory, &format!("{verb} --export-json figures.json --export-csv figures.csv"));
    let json = serde_json::from_str(&fs::read_to_string(directory.join("figures.json")).unwrap()).unwrap();
    let text = fs::read_to_string(directory.join("figures.csv")).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        assert_eq!(fields.len(), header.len(), "{verb}: {line}");
        header.iter().zip(fields).map(|(name, field)| ((*name).to_owned(), field.to_owned())).collect()
    };
    (json, lines.map(row).collect())
}

/// Checks that each object has the figures of its row, to the digits of the CSV.
fn agree(objects: &[Value], rows: &[Vec<(String, String)>], renamed: &[(&str, &str)]) {
    assert_eq!(objects.len(), rows.len());
    for (object, row) in objects.iter().zip(rows) {
        for (name, field) in row.iter().filter(|(_, field)| !field.is_empty()) {
            let name =
                renamed.iter().find(|(column, _)| column == name).map_or(name.as_str(), |(_, key)| key);
            let value = &object[name];
            match value.as_f64() {
                Some(number) => {
                    let written: f64 = field.parse().unwrap();
                    assert!((number - written).abs() < 0.006, "{name}: {number} and {field}");
                }
                None => assert_eq!(value.to_string().trim_matches('"'), field, "{name} of {object}"),
            }
        }
    }
}

#[test]
fn buses_gate_and_compare_write_their_figures_as_json_and_csv() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    let (buses, rows) = exports(place, "buses --reps 1 --seed 5 --quiet");
    assert_eq!((&buses["setup"], &buses["seed"], &buses["planned"]), (&"A".into(), &5.into(), &4.into()));
    let each = buses["buses"].as_array().unwrap();
    agree(each, &rows, &[]);
    let [low, high] = [0, 1].map(|index| buses["reaction_limits_ms"][index].as_f64().unwrap());
    for bus in each {
        let [min, mean, max] = ["reaction_min_ms", "reaction_mean_ms", "reaction_max_ms"]
            .map(|name| bus[name].as_f64().unwrap());
        assert!(low <= min && min < mean && mean < max && max < high + 0.01, "{bus}");
    }

    let (gate, rows) = exports(place, "gate --setup D");
    assert_eq!(gate["schema_version"], 1);
    let figures = gate["figures"].as_array().unwrap();
    assert!(figures.len() > 5 && figures.iter().all(|figure| figure["is_within"] == true), "{gate}");
    agree(figures, &rows, &[]);

    for (seed, out) in [("3", "one"), ("4", "two")] {
        ran(
            place,
            &format!(
                "--mode virtual --reps 2 --seed {seed} --quiet --without report,race,traces --out {out}"
            ),
        );
    }
    let (compared, rows) = exports(place, "compare one two");
    assert_eq!(compared["schema_version"], 1);
    agree(compared["figures"].as_array().unwrap(), &rows, &[]);
    assert_eq!(rows.len(), 6, "three types of two runs");
}

#[test]
fn a_calibration_writes_its_numbers_with_their_ranges_and_each_figure_beside_the_papers() {
    let place = tempfile::tempdir().unwrap();
    let (json, rows) = exports(place.path(), "calibrate --seeds 2 --reps 2 --seed 9");
    let numbers = json["numbers"].as_array().unwrap();
    let (of_numbers, of_figures) = rows.split_at(numbers.len());
    agree(numbers, of_numbers, &[("name", "key")]);
    for number in numbers {
        let [low, best, high] = ["low", "best", "high"].map(|name| number[name].as_f64().unwrap());
        assert!(low <= best && best <= high, "{number}");
    }
    assert!(
        numbers.iter().any(|number| number["key"] == "motions.velocity_percent" && number["unit"] == "%")
    );
    let renamed = [
        ("name", "figure"),
        ("value", "ms"),
        ("error", "error_ms"),
        ("paper", "paper_ms"),
        ("paper_error", "paper_error_ms"),
        ("difference", "difference_ms"),
    ];
    let of_figures: Vec<_> = of_figures
        .iter()
        .map(|row| row.iter().filter(|(name, _)| name != "unit").cloned().collect::<Vec<_>>())
        .collect();
    agree(json["figures"].as_array().unwrap(), &of_figures, &renamed);
    assert_eq!(of_figures.len(), 7);
}

#[test]
fn an_export_replaces_neither_the_setup_nor_the_baseline_and_is_checked_before_the_verb_runs() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    ran(place, "new cell");
    for (arguments, refusal) in [
        ("buses --setup cell/setup.toml --export-csv cell/setup.toml", "the setup; name another file"),
        ("calibrate --setup A --export-json .", "is a directory; name a file"),
        (
            "gate --setup cell/setup.toml --export-json cell/application.toml",
            "the application; name another file",
        ),
        ("gate --export-csv bench/baselines/A.json", "the baseline; name another file"),
        ("gate --update --export-csv a.csv", "cannot be used with"),
        ("trajectory missing.csv --export-svg nowhere/a.svg", "cannot write to nowhere"),
    ] {
        let finished = bench(place, arguments.split(' '));
        assert_ne!(finished.code, Some(0), "{arguments}");
        assert!(finished.stderr.contains(refusal), "{arguments}: {}", finished.stderr);
        assert_eq!(finished.stdout, "", "{arguments}: nothing ran");
    }
}
