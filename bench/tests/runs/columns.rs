//! `docs/columns.md` lists every column of the tables of runs and of verbs: names and order from the files and the code, meaning and unit
//! from here.

use std::fmt::Write as _;
use std::fs;

use bench::verbs::gate;
use report::pages::COMPARED_CSV_HEADER;
use studies::{buses, calibrate, sensitivity, sweep, trajectory};

use crate::program::bench;

const HEAD: &str = "\
# Columns of tables

Made from the files of runs and from the code: `INSTA_UPDATE=always cargo test -p bench --test runs columns`. A number has a point as
decimal separator; an empty field has no value. Times of the traces count from the start edge of the repetition. The unit 1 is that of
counts and ratios. `--export-json` of the same verb has the same names; runs have schemas: [results](../bench/schemas/results.schema.json), [cell results](../bench/schemas/cell-results.schema.json),
[control port](../node/schemas/control.schema.json).
";

/// A column: its unit and its meaning. A name means the same in each table, unless the table is named.
const MEANINGS: &[(&str, &str, &str)] = &[
    ("setup", "", "name of the setup"),
    ("application", "", "name of the application"),
    ("mode", "", "`real` or `virtual`"),
    ("seed", "", "seed of pauses, and in virtual mode of clocks and phases"),
    ("override", "%", "override, and when it changes: `80,0@2s,100@3s`"),
    ("type", "", "`rc`, `sm` or `cm`"),
    ("station", "", "name of the station"),
    ("runs", "1", "repetitions that ended as wanted"),
    ("failed", "1", "repetitions that failed"),
    ("repetition", "1", "number among the repetitions of the type, from 1"),
    (
        "execution_ms",
        "ms",
        "execution time on the PLC: from the scan with the start edge to the scan that sees the end",
    ),
    ("robot_execution_ms", "ms", "execution time that the robot measured; for SM the sum over its skills"),
    ("aet_ms", "ms", "mean execution time"),
    ("mad_ms", "ms", "mean absolute deviation of the execution times from their mean"),
    ("min_ms", "ms", "shortest execution time"),
    ("max_ms", "ms", "longest execution time"),
    ("robot_aet_ms", "ms", "mean of the times that the robot measured"),
    ("paper_aet_ms", "ms", "the paper's AET"),
    ("paper_mad_ms", "ms", "the paper's MAD"),
    ("aet_minus_paper_ms", "ms", "AET minus the paper's"),
    ("aet_calibrated", "", "`true` if a number of the setup was calibrated on the paper's AET"),
    ("mad_calibrated", "", "`true` if a number of the setup was calibrated on the paper's MAD"),
    ("h0_aet_ms", "ms", "AET of the run in which a skill call costs nothing"),
    ("h0_mad_ms", "ms", "MAD of that run"),
    ("aeti", "share of 1", "(AET of SM − AET of CM) / AET of SM"),
    ("h0_aeti", "share of 1", "the same of the run in which a skill call costs nothing"),
    ("blends_suppressed", "1", "motions that ended in a stop because the next one was not there in time"),
    ("plc_missed", "1", "scans of the PLC that were left out"),
    ("robot_missed", "1", "cycles of the robot that were left out"),
    ("waiting_ms", "ms", "time at marks, waiting for another arm"),
    ("zone_waiting_ms", "ms", "time before shared zones, until they were granted"),
    ("start_skew_us", "µs", "time between the first motions of the arms"),
    ("mark_skew_us", "µs", "longest time between the arms' motions after a mark"),
    ("relative_pose_mm", "mm", "largest deviation of the relative pose of arms that move together"),
    ("error", "", "why the repetition failed"),
    ("t_ms", "ms", "time of the row since the start edge"),
    (
        "true_ns",
        "ns",
        "time of the row on a clock that all nodes share: true time in virtual mode, the monotonic clock of the host in real mode",
    ),
    ("scan", "1", "scans since the node started"),
    ("command", "1", "number of the last command"),
    ("total", "1", "motions of the skill"),
    ("written", "1", "motions of the skill written into the slots so far"),
    ("in_slots", "1", "motions in the slots that the robot has not executed, 0 to 5"),
    ("altered", "1", "images refused so far because a byte was altered"),
    ("marks_come", "1", "marks that the arm has come to"),
    ("marks_passed", "1", "marks that the arm has passed"),
    ("state", "", "`Halted`, `Ready`, `Running` or `Suspended`"),
    ("executed", "1", "motions of the skill that are executed"),
    ("accepted", "1", "motions of the skill that the robot accepted"),
    ("queued", "1", "motions that wait in the robot or are being executed"),
    ("path_speed_mm_s", "mm/s", "speed of the tool along its path"),
    ("x_mm", "mm", "position of the tool in the base, x"),
    ("y_mm", "mm", "position of the tool in the base, y"),
    ("z_mm", "mm", "position of the tool in the base, z"),
    ("a_deg", "°", "orientation of the tool about z"),
    ("b_deg", "°", "orientation of the tool about y'"),
    ("c_deg", "°", "orientation of the tool about x''"),
    ("joint_1", "° or mm", "joint 1; mm for a linear axis"),
    ("joint_2", "° or mm", "joint 2"),
    ("joint_3", "° or mm", "joint 3"),
    ("joint_4", "° or mm", "joint 4"),
    ("joint_5", "° or mm", "joint 5; 0 where the arm has none"),
    ("joint_6", "° or mm", "joint 6; 0 where the arm has none"),
    ("positions", "", "source of joints, pose and speed: `set-points` or `drives`"),
    ("progress", "µs", "law time of the skill that the arm has driven"),
    ("run", "1", "number of the run in the order of the command line, from 1"),
    ("name", "", "name of the run's directory"),
    ("repetitions", "1", "repetitions that ended as wanted"),
    ("difference_ms", "ms", "AET minus that of run 1"),
    ("difference_low_ms", "ms", "lower end of the 95 % interval of this difference"),
    ("difference_high_ms", "ms", "upper end of this interval"),
    ("difference_percent", "%", "the difference as a share of run 1's AET"),
    ("other_conditions", "", "conditions that differ from those of run 1"),
    ("figure", "", "name of the figure"),
    ("unit", "", "unit of the row's numbers; none for counts"),
    ("baseline", "unit of the row", "value in the baseline"),
    ("now", "unit of the row", "value of this run"),
    ("difference", "unit of the row", "value of this run minus that of the baseline"),
    ("tolerance", "unit of the row", "largest difference that passes"),
    ("is_within", "", "`true` if the difference passes"),
    ("ratio", "", "the two types whose AETs are divided"),
    ("low", "unit of the row", "lower end of the range in which the figures stay within their errors"),
    ("high", "unit of the row", "upper end of this range"),
    ("at_most", "1", "ratio above which the gate fails"),
    ("verdict", "", "`within`, `beyond` or `inconclusive`"),
    ("bus", "", "the bus"),
    ("rc_ms", "ms", "AET of RC"),
    ("sm_ms", "ms", "AET of SM"),
    ("cm_ms", "ms", "AET of CM"),
    (
        "reaction_min_ms",
        "ms",
        "shortest reaction: from the scan that writes a number to the scan that reads it back from the robot",
    ),
    ("reaction_mean_ms", "ms", "mean reaction"),
    ("reaction_max_ms", "ms", "longest reaction"),
    ("value", "unit of the row", "value of the setup's number, or of the figure with the calibrated setup"),
    ("best", "unit of the row", "value with which the figures are met best, before it is rounded"),
    ("from", "", "source of the number in the setup; only a `calibrated` one is changed"),
    ("paper", "unit of the row", "the paper's figure"),
    ("paper_error", "unit of the row", "its standard error"),
    ("distance", "1", "difference in standard errors of both"),
    ("queue_depth", "1", "slots of the image in use"),
    ("bus_cycle_ms", "ms", "bus cycle"),
    ("length_mm", "mm", "length of every motion"),
    ("loss_percent", "%", "CM's time minus RC's, as a share of RC's"),
    ("round_trip_ms", "ms", "longest time from a free slot to the next motion in it"),
    ("predicted", "", "`keeps-up`, `starves`, or `open` where only the run decides"),
    ("varied", "", "the varied number; `none` for the unchanged setup"),
    ("times", "1", "its multiplier; for motions the number of pieces"),
    ("rc_ms_h0", "ms", "AET of RC if a skill call costs no time besides its motion"),
    ("sm_ms_h0", "ms", "AET of SM in that case"),
    ("cm_ms_h0", "ms", "AET of CM in that case"),
    ("aeti_h0", "share of 1", "AETi in that case"),
    ("rc_ms_uncalibrated", "ms", "AET of RC without any calibrated number"),
    ("sm_ms_uncalibrated", "ms", "AET of SM in that case"),
    ("cm_ms_uncalibrated", "ms", "AET of CM in that case"),
    ("aeti_uncalibrated", "share of 1", "AETi in that case"),
    ("refused", "", "why the case cannot be run"),
    ("job", "", "address of the job: the first 64 bits of the SHA-256 of all that decides about it"),
    ("execution_ns", "ns", "execution time on the PLC"),
    ("robot_execution_ns", "ns", "execution time that the robot measured; with several stations the longest"),
    ("status", "", "`passed`, `failed`, `not-run` or `refused`"),
    (
        "frames_lost",
        "1",
        "cyclic frames that one node sent and the other did not accept; where `[record]` names it, as those that follow",
    ),
    ("images_altered", "1", "images that a node refused because a byte was altered"),
    ("path_length_mm", "mm", "length of the tool's path"),
    ("path_deviation_mm", "mm", "largest distance of the tool from the programmed curves"),
    ("joint_speed", "share of 1", "highest speed of a joint as a share of its rated speed"),
    (
        "joint_acceleration",
        "share of 1",
        "highest acceleration of a joint as a share of its rated acceleration",
    ),
    ("joint_jerk", "share of 1", "highest jerk of a joint as a share of its rated jerk"),
    (
        VARIED_KEY,
        "unit of the key",
        "value of this varied key, an example: a column for each key of `[[vary]]`, with its path",
    ),
    ("reason", "", "why the job did not pass"),
    ("life", "1", "number of the life, from 0"),
    ("plant_ns", "ns", "time of the plant that the life lasted"),
    ("passed", "1", "repetitions that ended as wanted"),
];

/// The varied key of the study that shows the columns.
const VARIED_KEY: &str = "plc.scan_cycle_us";

/// A study with each figure that rows may have.
const STUDY: &str = "[study]
setup = \"A\"
types = [\"cm\"]
reps = 1
seeds = \"1\"

[record]
figures = [\"frames_lost\", \"images_altered\", \"path_length_mm\", \"path_deviation_mm\", \"joint_speed\", \"joint_acceleration\", \"joint_jerk\"]

[[vary]]
key = \"plc.scan_cycle_us\"
values = [1000]
";

/// Columns that mean something else in the table of a verb.
const EXCEPTIONS: &[(&str, &str, &str, &str)] = &[
    ("bench gate --run", "unit", "", "unit of the next five columns; empty for a ratio"),
    ("bench gate --run", "baseline", "unit of the row", "value in the baseline"),
    ("bench gate --run", "now", "unit of the row", "value of this run; the median of a skew"),
    (
        "bench gate --run",
        "low",
        "unit of the row",
        "lower end of the 95 % interval of the value; 0 where the run has fewer than five samples of a skew or pose",
    ),
    ("bench gate --run", "high", "unit of the row", "upper end of this interval"),
    ("bench calibrate", "name", "", "key of a number of the setup, or name of a figure"),
    ("bench calibrate", "difference", "unit of the row", "the figure minus the paper's"),
    ("bench calibrate", "error", "unit of the row", "standard error of the figure over the seeds"),
    ("bench sensitivity", "value", "unit of the row", "the resulting value of the varied number"),
    ("bench trajectory", "t_ms", "ms", "time of the robot cycle since the start edge"),
    ("bench soak", "seed", "", "seed of the life"),
    ("bench soak", "refused", "1", "repetitions that failed with a reason"),
    ("bench soak", "altered", "1", "repetitions that ended, but differ from the plan"),
    ("bench soak", "reason", "", "seed and reason of the first that was refused"),
    ("bench soak", "difference", "", "seed and difference of the first that differs"),
];

/// Returns the verbs that write figures for other programs, with the columns of their CSV.
fn tables_of_verbs() -> [(&'static str, String); 8] {
    [
        ("bench compare", COMPARED_CSV_HEADER.to_owned()),
        ("bench gate", gate::CSV_HEADER.to_owned()),
        ("bench gate --run", gate::RATIO_CSV_HEADER.to_owned()),
        ("bench buses", buses::CSV_HEADER.to_owned()),
        ("bench sweep", sweep::CSV_HEADER.to_owned()),
        ("bench sensitivity", sensitivity::csv_header()),
        ("bench calibrate", calibrate::CSV_HEADER.to_owned()),
        ("bench trajectory", trajectory::CSV_HEADER.to_owned()),
    ]
}

/// Names the tables in the directory of the runs.
const TABLES: &[(&str, &str)] = &[
    ("`samples.csv`: a row for each repetition", "one/samples.csv"),
    ("`samples.csv` of several stations: a row for each repetition and station", "cell/samples.csv"),
    ("`trace-plc.csv`: a row for each scan of the first repetition of each type", "one/trace-plc.csv"),
    (
        "`trace-robot.csv`: a row for each robot cycle of the first repetition of each type",
        "one/trace-robot.csv",
    ),
    ("`rows.csv` of studies: a row for each repetition", "study/rows.csv"),
    ("`rows.csv` of studies of several stations: a row for each repetition", "rows-cell/rows.csv"),
    ("`jobs.csv` of studies: a row for each job, in the order in which they ended", "study/jobs.csv"),
    ("`lives.csv` of `bench soak`: a row for each life", "soaked/lives.csv"),
    ("`--export-csv`: a row for each type", "one.csv"),
    ("`--export-csv` of several stations: a row for each type and station", "cell.csv"),
];

#[test]
fn every_column_of_every_table_of_a_run_is_explained_with_its_unit() {
    let place = tempfile::tempdir().unwrap();
    for (setup, name) in [("A", "one"), ("G", "cell")] {
        let export = format!("{name}.csv");
        let virtual_run = ["--setup", setup, "--mode", "virtual", "--reps", "1", "--quiet"];
        let files = ["--without", "report,race", "--out", name, "--export-csv", &export];
        let finished = bench(place.path(), [&virtual_run[..], &files].concat());
        assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    }
    fs::write(place.path().join("study.toml"), STUDY).unwrap();
    fs::write(place.path().join("cell.toml"), "[study]\nsetup = \"G\"\nreps = 1\n").unwrap();
    for arguments in [
        "study run study.toml --out study --quiet",
        "study run cell.toml --out rows-cell --quiet",
        "soak --hours 0.01 --out soaked --quiet",
    ] {
        let finished = bench(place.path(), arguments.split(' '));
        assert_eq!(finished.code, Some(0), "{arguments}: {}", finished.stderr);
    }
    let of_runs = TABLES.iter().map(|(title, file)| {
        let text = fs::read_to_string(place.path().join(file)).unwrap();
        let verb = if file.starts_with("soaked/") { "bench soak" } else { "" };
        (verb, (*title).to_owned(), text.lines().next().unwrap().to_owned())
    });
    let of_verbs = tables_of_verbs()
        .into_iter()
        .map(|(verb, header)| (verb, format!("`{verb}`: `--export-csv`"), header));
    let mut page = HEAD.to_owned();
    let mut known: Vec<&str> = Vec::new();
    for (verb, title, header) in of_runs.chain(of_verbs) {
        write!(page, "\n## {title}\n\n| column | unit | meaning |\n|---|---|---|\n").unwrap();
        for column in header.split(',') {
            let exception = EXCEPTIONS.iter().find(|(of, name, ..)| *of == verb && *name == column);
            let exception = exception.map(|(_, name, unit, meaning)| (name, unit, meaning));
            let usual = MEANINGS.iter().find(|(name, ..)| *name == column);
            let found = exception.or(usual.map(|(name, unit, meaning)| (name, unit, meaning)));
            let (name, unit, meaning) =
                found.unwrap_or_else(|| panic!("{title}: explain the column {column}"));
            known.push(name);
            writeln!(page, "| `{name}` | {unit} | {meaning} |").unwrap();
        }
    }
    for (name, ..) in MEANINGS {
        assert!(known.contains(name), "no table has the column {name} any more");
        let meanings = MEANINGS.iter().filter(|(other, ..)| other == name).count();
        assert_eq!(meanings, 1, "{name}: give the other meaning among the exceptions");
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/columns.md");
    if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
        fs::write(path, &page).unwrap();
    }
    let committed = fs::read_to_string(path).unwrap_or_default();
    assert!(
        committed == page,
        "columns changed: INSTA_UPDATE=always cargo test -p bench --test runs columns"
    );
}
