//! `bench study` of a setup with several stations: the figures of a measured run, keys of a station, shards and interruptions.

use std::fs;

use crate::program::bench;
use crate::study_calls::{merged, place, read, study};

const CYCLES: &str = "[study]
setup = \"E\"
reps = 2
seeds = \"1..=2\"

[[vary]]
key = \"station.left.robot.cycle_us\"
values = [4000, 8000]

[[finding]]
figure = \"start_skew_us\"
above = 0.0
";

/// Columns of a row, by their place.
const COLUMNS: &str = "job,seed,type,repetition,execution_ns,robot_execution_ns,blends_suppressed,status,\
                       start_skew_us,mark_skew_us,relative_pose_mm";

#[test]
fn the_rows_of_a_cell_have_the_figures_of_a_measured_run_of_the_changed_setup() {
    let place = place(CYCLES);
    let place = place.path();
    let ran = study(place, "run study.toml --out rows --quiet");
    assert_eq!(ran.code, Some(0), "{}{}", ran.stdout, ran.stderr);
    assert!(ran.stdout.starts_with("4 jobs, 0 did not pass, 4 with a finding."), "{}", ran.stdout);
    let (rows, jobs) = (read(place, "rows/rows.csv"), read(place, "rows/jobs.csv"));
    assert_eq!(rows.lines().next(), Some(COLUMNS));
    let (left, right) = include_str!("../../../cell/setups/E.toml").split_once("[station.robot]").unwrap();
    let slower = right.replacen("cycle_us = { value = 4000", "cycle_us = { value = 8000", 1);
    fs::write(place.join("slower.toml"), format!("{left}[station.robot]{slower}")).unwrap();
    for (setup, cycle_us) in [("E", "4000"), ("slower.toml", "8000")] {
        let arguments = ["--mode", "virtual", "--reps", "2", "--without", "report,race", "--quiet"];
        let run = bench(
            place,
            ["--setup", setup, "--out", setup.trim_end_matches(".toml")].iter().chain(&arguments),
        );
        assert_eq!(run.code, Some(0), "{}{}", run.stdout, run.stderr);
        let results = read(place, &format!("{}/results.json", setup.trim_end_matches(".toml")));
        let results: serde_json::Value = serde_json::from_str(&results).unwrap();
        let job = |row: &str| {
            let is_of_job = |line: &&str| line.split(',').next() == row.split(',').next();
            jobs.lines().find(is_of_job).unwrap().split(',').nth(1).unwrap().to_owned()
        };
        let of_run = |row: &&str| row.split(',').nth(1) == Some("1") && job(row) == cycle_us;
        let mut compared = 0;
        for row in rows.lines().skip(1).filter(of_run) {
            let fields: Vec<&str> = row.split(',').collect();
            let (kind, repetition): (_, usize) = (fields[2], fields[3].parse().unwrap());
            let of_type = &results["results"][kind];
            let figure = |list: &serde_json::Value| list[repetition - 1].as_f64().unwrap();
            let marks = of_type["marks"].as_array().unwrap().iter();
            let mark_skew = marks.map(|mark| figure(&mark["skew_us"])).fold(0.0, f64::max);
            let stations = of_type["stations"].as_array().unwrap().iter();
            let longest = stations.map(|it| figure(&it["robot_samples_ms"])).fold(0.0, f64::max);
            let wanted = [
                (4, figure(&of_type["samples_ms"]) * 1e6),
                (5, longest * 1e6),
                (8, figure(&of_type["start_skew_us"])),
                (9, mark_skew),
                (10, figure(&of_type["relative_pose_mm"])),
            ];
            for (place, wanted) in wanted {
                let found: f64 = fields[place].parse().unwrap();
                assert!((found - wanted).abs() < 1e-5, "{setup} {row}: {wanted} in column {place}");
            }
            compared += 1;
        }
        assert_eq!(compared, 6, "{setup}");
    }
    let command = ran.stdout.split("bench study ").nth(1).unwrap().lines().next().unwrap();
    let rerun = study(place, &format!("{command} --out again"));
    assert_eq!(rerun.code, Some(0), "{}", rerun.stderr);
    let job = command.rsplit(' ').next().unwrap();
    let row = rows.lines().find(|row| row.starts_with(job) && row.contains(",rc,1,")).unwrap();
    let sample = read(place, "again/run/samples.csv");
    let ms: f64 = sample.lines().nth(1).unwrap().split(',').nth(3).unwrap().parse().unwrap();
    assert_eq!(
        (ms * 1e6).round().to_string(),
        row.split(',').nth(4).unwrap(),
        "the same time as in the study"
    );
}

#[test]
fn one_and_three_shards_of_a_cell_and_one_that_was_interrupted_give_one_digest() {
    let place = place(&CYCLES.replace("reps = 2", "reps = 1"));
    let place = place.path();
    assert_eq!(study(place, "run study.toml --out whole --quiet").code, Some(0));
    let whole = merged(place, "whole", "merged");
    for index in 0..3 {
        let ran = study(place, &format!("run study.toml --out parts/{index} --shard {index}/3 --quiet"));
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    }
    assert_eq!(merged(place, "parts", "merged-parts"), whole);
    // As a kill leaves it: the third job is written in part.
    fs::create_dir(place.join("cut")).unwrap();
    for file in fs::read_dir(place.join("whole")).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), place.join("cut").join(file.file_name())).unwrap();
    }
    let first = |name: &str, lines: usize| {
        read(place, &format!("whole/{name}")).split_inclusive('\n').take(lines).collect::<String>()
    };
    let (rows, jobs) = (first("rows.csv", 8), first("jobs.csv", 3));
    fs::write(place.join("cut/rows.csv"), &rows[..rows.len() - 9]).unwrap();
    fs::write(place.join("cut/jobs.csv"), &jobs).unwrap();
    let ran = study(place, "run study.toml --out cut --quiet");
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(read(place, "cut/jobs.csv").starts_with(&jobs), "the finished jobs stay");
    assert_eq!(merged(place, "cut", "merged-cut"), whole);
    assert_eq!(study(place, "report parts").code, Some(0));
    let report: serde_json::Value = serde_json::from_str(&read(place, "parts/report.json")).unwrap();
    let effect = &report["effects"][0];
    assert_eq!(effect["key"], "station.left.robot.cycle_us");
    let figures: Vec<_> =
        effect["figures"].as_array().unwrap().iter().map(|it| it["figure"].as_str()).collect();
    assert!(figures.contains(&Some("AET")) && figures.contains(&Some("start skew")), "{figures:?}");
}

#[test]
fn stations_and_keys_that_a_cell_does_not_have_are_refused_with_the_nearest_name() {
    for (setup, key, said) in [
        ("E", "station.lft.robot.cycle_us", "setup E has no station `lft`; did you mean `left`?"),
        ("E", "station.left.robot.cycl_us", "did you mean `station.left.robot.cycle_us`?"),
        ("E", "robot.cycle_us", "did you mean `station.left.robot.cycle_us`?"),
        ("A", "station.left.robot.cycle_us", "did you mean `robot.cycle_us`?"),
    ] {
        let place = place(
            &CYCLES.replace("\"E\"", &format!("\"{setup}\"")).replace("station.left.robot.cycle_us", key),
        );
        let ran = study(place.path(), "run study.toml --out rows --quiet");
        assert_eq!(ran.code, Some(2), "{}{}", ran.stdout, ran.stderr);
        assert!(ran.stderr.contains(said), "{}", ran.stderr);
        assert!(!place.path().join("rows").exists());
    }
}

#[test]
fn a_varied_application_and_faults_of_a_station_give_jobs_of_a_cell() {
    let text = "[study]\nsetup = \"E\"\ntypes = [\"cm\"]\nreps = 1\n\
                [[vary]]\nkey = \"application\"\nvalues = [\"mine.toml\", \"carry-plate\"]\n\
                [[vary]]\nkey = \"faults\"\nvalues = [\"\", \"left/cut-at=1s..9s\"]\n";
    let place = place(text);
    let place = place.path();
    fs::write(place.join("mine.toml"), include_str!("../../../cell/applications/hand-over.toml")).unwrap();
    let ran = study(place, "run study.toml --out rows --quiet");
    assert_eq!(ran.code, Some(4), "{}{}", ran.stdout, ran.stderr);
    let rows = read(place, "rows/rows.csv");
    let count = |status: &str| rows.lines().filter(|row| row.split(',').nth(7) == Some(status)).count();
    assert_eq!([count("passed"), count("failed"), count("refused")], [1, 1, 2], "{rows}");
    // Beside the rows, the application is found without its file.
    fs::remove_file(place.join("mine.toml")).unwrap();
    let job = rows.lines().find(|row| row.contains(",passed,")).unwrap().split(',').next().unwrap();
    let rerun = study(place, &format!("rerun rows {job}"));
    assert_eq!(rerun.code, Some(0), "{}", rerun.stderr);
}

#[test]
fn the_place_of_an_arm_and_its_own_application_are_varied_and_a_bad_one_is_refused_with_its_key() {
    // Each arm has work of its own, far from the other one.
    let setup =
        include_str!("../../../cell/setups/F.toml").replacen("application = \"carry-plate\"\n", "", 1);
    let setup = setup.replacen("application = \"left-edge\"", "application = \"own.toml\"", 1);
    let setup = setup.replacen("application = \"right-edge\"", "application = \"gluing\"", 1);
    let text = "[study]\nsetup = \"cell/cell.toml\"\ntypes = [\"cm\"]\nreps = 1\n\
                 [[vary]]\nkey = \"station.right.root_mm_deg.x\"\nvalues = [5000, 0]\n\
                 [[vary]]\nkey = \"station.right.application\"\nvalues = [\"gluing\", \"mine.toml\", \"none\"]\n\
                 [[vary]]\nkey = \"station.left.root_mm_deg\"\nvalues = [[0, 0, 0, 0, 0, 0], [10.5, 0, 0, 0, 0, 0]]\n";
    let place = place(text);
    let place = place.path();
    fs::create_dir(place.join("cell")).unwrap();
    fs::write(place.join("cell/cell.toml"), setup).unwrap();
    let gluing = include_str!("../../../cell/applications/gluing.toml");
    fs::write(place.join("cell/own.toml"), gluing).unwrap();
    fs::write(place.join("mine.toml"), gluing).unwrap();
    let ran = study(place, "run study.toml --out rows --quiet");
    assert_eq!(ran.code, Some(4), "{}{}", ran.stdout, ran.stderr);
    let jobs = read(place, "rows/jobs.csv");
    let reasons: Vec<&str> = jobs.lines().skip(1).map(|line| line.split_once(',').unwrap().1).collect();
    assert_eq!(reasons.len(), 12, "{jobs}");
    let with =
        |begin: &str| reasons.iter().filter(|line| line.starts_with(begin)).copied().collect::<Vec<_>>();
    for taken in ["5000,gluing,", "5000,mine.toml,"] {
        assert!(with(taken).len() == 2 && with(taken).iter().all(|line| line.ends_with("\",")), "{jobs}");
    }
    for (refused, key) in
        [("0,gluing,\"[0,", "station.right.root_mm_deg"), ("5000,none,", "station.right.application")]
    {
        assert!(with(refused).iter().all(|line| line.contains(key)) && !with(refused).is_empty(), "{jobs}");
    }
    // Beside the rows, all applications are found without their files.
    let whole = merged(place, "rows", "merged");
    fs::remove_file(place.join("mine.toml")).unwrap();
    fs::remove_dir_all(place.join("cell")).unwrap();
    let again = study(place, "run rows/study.toml --out again --quiet");
    assert_eq!(again.code, Some(4), "{}{}", again.stdout, again.stderr);
    assert_eq!(merged(place, "again", "merged-again"), whole);
}

#[test]
fn the_position_of_a_robot_in_its_line_and_its_arm_of_an_application_are_varied() {
    let text = "[study]\nsetup = \"line.toml\"\ntypes = [\"cm\"]\nreps = 1\n\
                 [[vary]]\nkey = \"station.left.position\"\nvalues = [1, 0, 7]\n\
                 [[vary]]\nkey = \"station.right.position\"\nvalues = [0, 1]\n\
                 [[vary]]\nkey = \"station.left.application\"\nvalues = [\"left-edge\", \"right-edge\"]\n";
    let place = place(text);
    let place = place.path();
    let line =
        include_str!("../../../cell/setups/F.toml").replacen("kind = \"profinet\"", "kind = \"ethercat\"", 1);
    fs::write(place.join("line.toml"), line).unwrap();
    let ran = study(place, "run study.toml --out rows --quiet");
    assert_eq!(ran.code, Some(4), "{}{}", ran.stdout, ran.stderr);
    let jobs = read(place, "rows/jobs.csv");
    let mut passed = 0;
    for line in jobs.lines().skip(1) {
        let fields: Vec<&str> = line.splitn(5, ',').collect();
        match (fields[1], fields[2], fields[3]) {
            ("1", "0", "left-edge") | ("0", "1", "left-edge") => {
                assert_eq!(fields[4], "", "{line}");
                passed += 1;
            }
            ("7", ..) | ("0", "0", _) | ("1", "1", _) => assert!(fields[4].contains(".position"), "{line}"),
            _ => assert!(fields[4].contains("station.right.application"), "{line}"),
        }
    }
    assert_eq!(passed, 2, "{jobs}");
    for (key, values) in [
        ("root_mm_deg", "[[0, 0, 0]]"),
        ("root_mm_deg", "[1.0]"),
        ("root_mm_deg.x", "[\"far\"]"),
        ("position", "[0.5]"),
        ("application", "[3]"),
    ] {
        let text =
            format!("[study]\nsetup = \"F\"\n[[vary]]\nkey = \"station.left.{key}\"\nvalues = {values}\n");
        fs::write(place.join("wrong.toml"), text).unwrap();
        let refused = study(place, "run wrong.toml --out wrong --quiet");
        assert_eq!(refused.code, Some(2), "{key}: {}", refused.stdout);
        assert!(refused.stderr.contains(&format!("`station.left.{key}` = ")), "{}", refused.stderr);
    }
}
