//! The report: it has every section whatever happened to the run, loads nothing from elsewhere, and names what cannot
//! be drawn.

use std::fmt::Write as _;
use std::path::Path;

use plc_node::ExecutionType;
use records::disturbances::MissedCycles;
use records::faults::FaultReport;
use records::lateness::CycleLateness;
use records::results::{Results, Status, TypeResult};

use crate::program::bench;

const SECTIONS: [&str; 12] = [
    "look", "table", "claims", "quality", "race", "speed", "samples", "path", "queue", "lateness", "numbers",
    "host",
];

/// Executes a virtual run in `run`.
fn a_run() -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    let finished = bench(directory.path(), ["--mode", "virtual", "--reps", "3", "--out", "run", "--quiet"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    directory
}

fn report(directory: &Path) -> String {
    std::fs::read_to_string(directory.join("run/report.html")).unwrap()
}

/// Changes the results of the run and draws its report again.
fn redrawn(directory: &Path, change: impl FnOnce(&mut Results)) -> String {
    let path = directory.join("run/results.json");
    let mut results: Results = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    change(&mut results);
    store(&directory.join("run"), results);
    let finished = bench(directory, ["report", "run"]);
    assert_eq!((finished.code, finished.stdout.trim()), (Some(0), "run/report.html"), "{}", finished.stderr);
    report(directory)
}

/// Stores results in a run directory as a run that had measured them would.
fn store(run: &Path, mut results: Results) {
    let mut samples =
        "type,repetition,execution_ms,robot_execution_ms,blends_suppressed,plc_missed,robot_missed,error\n"
            .to_owned();
    for execution_type in ExecutionType::ALL {
        let Some(result) = results.results.entry(execution_type) else { continue };
        let count = result.samples_ms.len();
        result.robot_samples_ms.resize(count, 0.0);
        result.blends_suppressed.resize(count, 0);
        result.missed_cycles.resize(count, MissedCycles::default());
        for (index, sample) in result.samples_ms.iter().enumerate() {
            let (robot, blends) = (result.robot_samples_ms[index], result.blends_suppressed[index]);
            let MissedCycles { plc, robot: missed, .. } = result.missed_cycles[index];
            writeln!(samples, "{execution_type},{},{sample},{robot},{blends},{plc},{missed},", index + 1)
                .unwrap();
        }
        for failed in &result.failed {
            writeln!(samples, "{execution_type},{},,,,,,\"{}\"", failed.repetition, failed.error).unwrap();
        }
    }
    results.derive_figures();
    std::fs::write(run.join("samples.csv"), samples).unwrap();
    std::fs::write(run.join("results.json"), results.to_json().unwrap()).unwrap();
}

/// Returns a section's text.
fn section<'a>(html: &'a str, id: &str) -> &'a str {
    let start = html.find(&format!("<section id=\"{id}\">")).unwrap_or_else(|| panic!("no section {id}"));
    let rest = html.get(start..).unwrap();
    rest.get(..rest.find("</section>").unwrap()).unwrap()
}

#[test]
fn the_report_counts_the_skills_of_cm() {
    for (application, skills) in
        [("pick-and-place", "one MoveContinuousSkill"), ("gluing", "5 MoveContinuousSkills")]
    {
        let directory = tempfile::tempdir().unwrap();
        let arguments = ["--mode", "virtual", "--reps", "1", "--out", "run", "--quiet", "--application"];
        let finished = bench(directory.path(), arguments.into_iter().chain([application]));
        assert_eq!(finished.code, Some(0), "{}", finished.stderr);
        let html = report(directory.path());
        assert!(section(&html, "look").contains(&format!(">{skills}<")), "{application}");
        assert!(section(&html, "speed").contains(&format!("{skills}, fed by the PLC")), "{application}");
    }
}

#[test]
fn each_plus_minus_of_the_report_says_what_it_is() {
    let directory = a_run();
    let html = report(directory.path());
    let few = section(&html, "look");
    assert!(!few.contains("In this figure ±"), "three repetitions have no interval");
    let longer = bench(directory.path(), ["--mode", "virtual", "--reps", "5", "--out", "five", "--quiet"]);
    assert_eq!(longer.code, Some(0), "{}", longer.stderr);
    let html = std::fs::read_to_string(directory.path().join("five/report.html")).unwrap();
    assert!(section(&html, "look").contains("In this figure ± is half the 95 % interval"));
    assert!(section(&html, "distance").contains("In this table ± is one standard error"));
}

#[test]
fn a_run_leaves_a_report_with_every_section_and_its_figure_in_both_widths() {
    let directory = a_run();
    let html = report(directory.path());
    for id in SECTIONS {
        section(&html, id);
    }
    for id in ["look", "race", "speed", "samples", "path", "queue"] {
        assert_eq!(section(&html, id).matches("<svg").count(), 2, "{id}");
    }
    for id in ["look", "speed", "samples", "path", "queue"] {
        assert!(section(&html, id).contains("The figure as a table"), "{id}");
    }
    assert!(section(&html, "samples").contains("<title>SM, repetition 2: "));
    assert!(html.contains("3 repetitions of each type are too few for confidence intervals"));
    assert!(!html.contains("class=\"banner\""));
    let table = section(&html, "table");
    assert!(["3725", "6477", "3729", "42 %", "Calibrated", "h = 0"].iter().all(|text| table.contains(text)));
    assert!(table.contains("by construction"));
    assert!(!html.contains("<section id=\"distance\">"), "three repetitions are too few for errors");
    let claims = section(&html, "claims");
    assert!(claims.contains("Energy proxy of CM") && claims.contains("programmed motions B"));
    assert!(section(&html, "numbers").contains("robot.skill_overhead_us"));
    assert!(section(&html, "host").contains("kernel"));
    assert!(section(&html, "lateness").contains("In virtual time nothing is late"));
}

#[test]
fn with_enough_repetitions_each_figure_has_its_distance_from_the_papers() {
    let directory = a_run();
    let html = redrawn(directory.path(), |results| {
        results.reps = 9;
        for execution_type in ExecutionType::ALL {
            let samples = results.results.entry(execution_type).as_mut().unwrap();
            let all: Vec<f64> = samples.samples_ms.iter().copied().cycle().take(9).collect();
            samples.samples_ms = all;
        }
    });
    let look = section(&html, "look");
    assert!(
        look.contains("half the 95 % interval")
            && look.contains("CM − RC")
            && look.contains("paper 3725 ± 1.9 ms")
    );
    assert!(html.contains("less time than SM (95\u{a0}% interval "), "the summary has its interval");
    let distance = section(&html, "distance");
    for figure in ["RC AET", "SM AET", "CM AET", "RC MAD", "SM MAD", "CM MAD", "CM − RC"] {
        assert!(distance.contains(figure), "{figure}: {distance}");
    }
    assert!(distance.contains("3725.0 ± 0.9") && distance.contains("+4.0 ± 1.2"), "{distance}");
    let differences = distance.matches("<td data-label=\"difference\">").count();
    let empty = distance.matches("<td data-label=\"difference\"></td>").count();
    assert_eq!((differences, empty), (7, 0), "{distance}");
}

#[test]
fn a_run_of_a_copy_with_another_speed_has_no_paper_in_table_report_exports_and_comparison() {
    let directory = a_run();
    let text = setup::SETUPS[0].1.replace("velocity_percent = { value = 2", "velocity_percent = { value = 4");
    assert_ne!(text, setup::SETUPS[0].1);
    std::fs::write(directory.path().join("copy.toml"), text).unwrap();
    let finished = bench(
        directory.path(),
        ["--setup", "copy.toml", "--mode", "virtual", "--reps", "1", "--out", "copy"],
    );
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let is_told =
        |text: &str| text.contains("motions.velocity_percent is 4") && !text.contains("alibrated on");
    assert!(is_told(&finished.stdout) && !finished.stdout.contains("paper AET"), "{}", finished.stdout);
    let html = std::fs::read_to_string(directory.path().join("copy/report.html")).unwrap();
    assert!(is_told(section(&html, "table")) && !html.contains("paper AET"));
    assert!(["distance", "claims"].iter().all(|id| !html.contains(&format!("<section id=\"{id}\">"))));
    let finished = bench(directory.path(), ["compare", "run", "copy"]);
    let told = finished.stdout.replace("\n   ", "");
    assert!(told.contains("; not the paper's cell: motions.velocity_percent is 4"), "{}", finished.stdout);
}

#[test]
fn the_page_loads_nothing_from_elsewhere_and_needs_no_script() {
    let directory = a_run();
    let html = report(directory.path()).replace("http://www.w3.org/2000/svg", "");
    for from_elsewhere in
        ["http://", "https://", "src=", "<script", "<link rel=\"stylesheet", "@import", "url("]
    {
        assert!(!html.contains(from_elsewhere), "{from_elsewhere}");
    }
    // Every opened element is closed.
    for tag in ["section", "table", "tr", "td", "figure", "div", "svg", "text", "dl", "ul", "p"] {
        let opened = html.matches(&format!("<{tag}>")).count() + html.matches(&format!("<{tag} ")).count();
        assert_eq!(opened, html.matches(&format!("</{tag}>")).count(), "{tag}");
    }
}

#[test]
fn the_traces_have_a_row_for_each_tick_of_each_type() {
    let directory = a_run();
    let read = |name: &str| std::fs::read_to_string(directory.path().join("run").join(name)).unwrap();
    let (robot, plc) = (read("trace-robot.csv"), read("trace-plc.csv"));
    let results: Results = serde_json::from_str(&read("results.json")).unwrap();
    for execution_type in ExecutionType::ALL {
        let rows = |table: &str| {
            table.lines().filter(|line| line.starts_with(&format!("{execution_type},"))).count()
        };
        let took_ms = results.results.get(execution_type).unwrap().samples_ms[0];
        assert!(
            (rows(&robot) as f64 - took_ms / 4.0).abs() < 3.0,
            "{execution_type}: {} of 4 ms",
            rows(&robot)
        );
        assert!((rows(&plc) as f64 - took_ms).abs() < 3.0, "{execution_type}: {} of 1 ms", rows(&plc));
    }
}

#[test]
fn the_report_of_an_incomplete_run_says_so_and_shows_its_results() {
    let directory = a_run();
    let html = redrawn(directory.path(), |results| results.status = Status::Interrupted);
    assert!(html.contains("This run was interrupted.</strong> 9 of 9 runs are done"));
    let html = redrawn(directory.path(), |results| {
        results.record_failure(ExecutionType::Sm, 3, "the <robot> was lost".to_owned());
        results.status = Status::Failed;
    });
    assert!(html.contains("A repetition of this run failed."));
    assert!(section(&html, "failures").contains("the &lt;robot&gt; was lost"));
    let html = redrawn(directory.path(), |results| {
        results.status = Status::Running;
        (results.results.sm, results.results.cm) = (None, None);
    });
    assert!(html.contains("This run is not finished."));
    assert_eq!(section(&html, "samples").matches("<svg").count(), 2);
}

#[test]
fn a_first_repetition_that_failed_or_was_interrupted_is_not_shown_as_done() {
    let directory = a_run();
    let without_samples = |results: &mut Results, execution_type| {
        *results.results.entry(execution_type) = Some(TypeResult::default());
    };
    let html = redrawn(directory.path(), |results| {
        results.status = Status::Interrupted;
        [ExecutionType::Sm, ExecutionType::Cm].into_iter().for_each(|one| without_samples(results, one));
        results.record_failure(ExecutionType::Cm, 1, "the connection to the robot was lost".to_owned());
    });
    let race = section(&html, "race").replace('\u{a0}', " ");
    for told in ["RC takes 3.7", "SM was interrupted at 6.4", "CM failed at 3.7", ">done: 3.7"] {
        assert!(race.contains(told), "{told}: {race}");
    }
    assert!(race.contains("the moment at which the first arm is done"), "{race}");
    let speed = section(&html, "speed");
    assert!(speed.contains("interrupted at 6.4") && speed.contains("failed at 3.7"), "{speed}");
    let page = std::fs::read_to_string(directory.path().join("run/race.html")).unwrap();
    assert!(page.contains("SM was interrupted at") && page.contains("\"end\":\"failed\""));
    assert!(section(&html, "table").contains("Calibrated on"), "RC has figures");
    let html = redrawn(directory.path(), |results| without_samples(results, ExecutionType::Rc));
    assert!(!section(&html, "table").contains("Calibrated on"), "no figure has a mark");
    let race = section(&html, "race");
    assert!(race.contains("the moment at which the first recording ends"), "{race}");
    assert!(race.contains(">interrupted at 3.7"), "{race}");
}

#[test]
fn the_report_names_the_faults_that_were_put_in_and_those_that_never_came_to_pass() {
    let directory = a_run();
    assert!(!section(&report(directory.path()), "table").contains("Faults"));
    let html = redrawn(directory.path(), |results| {
        let asked = ["loss=0.1", "kill-robot-at=3000s"].map(str::to_owned);
        let never = vec!["kill-robot-at=3000s".to_owned()];
        results.faults = Some(FaultReport { asked: asked.into(), never, lost: 7, ..FaultReport::default() });
    });
    let table = section(&html, "table");
    assert!(table.contains("Faults put in (loss=0.1): 7 frames lost"), "{table}");
    assert!(
        table.contains("Never came to pass, because the run ended before: kill-robot-at=3000s."),
        "{table}"
    );
}

#[test]
fn a_run_whose_records_are_incomplete_says_so_in_its_report_on_its_race_and_beside_another() {
    let lacking = "The recording of CM lacks 5 scans of the PLC and 2 cycles of the robot.";
    let directory = a_run();
    let run = directory.path().join("run");
    let compared = || {
        let finished = bench(directory.path(), ["compare", "run", "run", "--html", "both.html"]).stdout;
        finished.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let page = || std::fs::read_to_string(directory.path().join("both.html")).unwrap();
    assert!(!report(directory.path()).contains("lacks"));
    assert!(!compared().contains("incomplete") && !page().contains("incomplete"));
    let html = redrawn(directory.path(), |results| results.incomplete.push(lacking.to_owned()));
    assert!(html.contains(lacking));
    assert!(std::fs::read_to_string(run.join("race.html")).unwrap().contains(lacking));
    assert_eq!(compared().matches(", records incomplete").count(), 2);
    assert_eq!(page().matches(", records incomplete").count(), 2);
}

#[test]
fn the_report_names_files_that_are_missing_in_the_run_directory() {
    let directory = a_run();
    let run = directory.path().join("run");
    for file in ["trace-robot.csv", "host.json", "setup.toml"] {
        std::fs::remove_file(run.join(file)).unwrap();
    }
    let html = redrawn(directory.path(), |_| {});
    for id in SECTIONS {
        section(&html, id);
    }
    assert!(section(&html, "speed").contains("Not recorded"));
    assert!(section(&html, "host").contains("cannot read run&#x2f;host.json"));
    std::fs::write(run.join("trace-robot.csv"), "t\n1\n").unwrap();
    assert!(redrawn(directory.path(), |_| {}).contains("does not have the columns of this version"));
}

#[test]
fn the_report_of_a_real_run_shows_the_lateness_of_its_cycles() {
    let directory = a_run();
    let html = redrawn(directory.path(), |results| {
        results.mode = "real".to_owned();
        let buckets = vec![(12.0, 100_000), (13.0, 50_000), (95.0, 400), (11_800.0, 1)];
        let late = CycleLateness { p50_us: 12.0, p99_us: 14.0, max_us: 11_734.0, missed: 10, buckets };
        (results.cycle.plc, results.cycle.robot) = (late.clone(), late);
    });
    let section = section(&html, "lateness").to_owned();
    assert_eq!(section.matches("<svg").count(), 2);
    assert!(section.contains("11734"));
    std::fs::remove_file(directory.path().join("run/trace-robot.csv")).unwrap();
    assert!(
        redrawn(directory.path(), |_| {}).contains("the nodes left no trace. bench --mode virtual --setup")
    );
}

#[test]
fn a_missing_run_and_one_of_another_version_are_refused_with_a_reason() {
    let directory = tempfile::tempdir().unwrap();
    let refused = || {
        let finished = bench(directory.path(), ["report", "run"]);
        assert_eq!((finished.code, finished.stdout.as_str()), (Some(2), ""), "{}", finished.stderr);
        finished.stderr
    };
    insta::assert_snapshot!(refused(), @"error: there is no run directory run; name one, such as one below runs/");
    let run = directory.path().join("run");
    std::fs::write(&run, "").unwrap();
    insta::assert_snapshot!(refused(), @"error: run is a file; name a run directory, such as one below runs/");
    std::fs::remove_file(&run).unwrap();
    std::fs::create_dir(&run).unwrap();
    insta::assert_snapshot!(refused(), @"error: run holds no run: results.json is missing; name a run directory, such as one below runs/");
    std::fs::write(run.join("samples.csv"), "").unwrap();
    insta::assert_snapshot!(refused(), @"error: the run in run ended before its first repetition did, so there is nothing to report");
    std::fs::write(run.join("results.json"), "{\"schema_version\": 0}").unwrap();
    insta::assert_snapshot!(refused(), @"error: run/results.json has schema version 0, and this program reads 1; use the version of skillbench that wrote it, or run again");
    std::fs::write(run.join("results.json"), "{\"schema_version\": 1").unwrap();
    insta::assert_snapshot!(refused(), @"error: run/results.json is not a results file: EOF while parsing an object at line 1 column 20");
}

#[test]
fn a_report_that_lacks_a_part_of_the_run_is_drawn_with_a_warning_of_it() {
    let directory = a_run();
    let trace = directory.path().join("run/trace-robot.csv");
    let text = std::fs::read_to_string(&trace).unwrap();
    let cut_off = text.lines().take(100).map(|line| format!("{line}\n")).collect::<String>() + "sm,4.0";
    std::fs::write(&trace, cut_off).unwrap();
    std::fs::remove_file(directory.path().join("run/host.json")).unwrap();
    for arguments in [&["report", "run"][..], &["report", "run", "--out", "elsewhere.html"]] {
        let finished = bench(directory.path(), arguments);
        assert_eq!(finished.code, Some(0), "{}", finished.stderr);
        insta::allow_duplicates!(insta::assert_snapshot!(finished.stderr, @"
        warning: the report is not complete: cannot read run/host.json: No such file or directory (os error 2)
        warning: the report is not complete: the curves over time are left out: trace-robot.csv:101 is not a row of the table
        "));
    }
}

#[test]
fn a_report_links_to_the_race_beside_it_and_names_it_from_elsewhere() {
    let directory = a_run();
    assert!(directory.path().join("run/race.html").is_file());
    assert!(section(&report(directory.path()), "race").contains("href=\"race.html\""));
    let finished = bench(directory.path(), ["report", "run", "--out", "elsewhere.html"]);
    assert_eq!((finished.code, finished.stdout.trim()), (Some(0), "elsewhere.html"), "{}", finished.stderr);
    let html = std::fs::read_to_string(directory.path().join("elsewhere.html")).unwrap();
    let race = section(&html, "race");
    assert!(race.contains("<svg") && !race.contains("href") && race.contains("in the run's directory"));
}

#[test]
fn a_report_that_cannot_be_written_keeps_the_old_one() {
    let directory = a_run();
    let before = report(directory.path());
    std::fs::write(directory.path().join("file"), "").unwrap();
    let finished = bench(directory.path(), ["report", "run", "--out", "file/report.html"]);
    assert_eq!(finished.code, Some(1));
    insta::assert_snapshot!(finished.stderr, @"error: the run is as it was; name a file that can be written by --out: cannot write file/report.html: Not a directory (os error 20)");
    assert_eq!(report(directory.path()), before);
}

#[test]
fn runs_are_compared_on_screen_and_as_a_page() {
    let directory = a_run();
    let finished = bench(
        directory.path(),
        ["--mode", "virtual", "--reps", "3", "--seed", "2", "--types", "rc,cm", "--out", "other", "--quiet"],
    );
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let finished = bench(directory.path(), ["compare", "run", "other", "--html", "both.html"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let row =
        |name: &str| finished.stdout.lines().find(|line| line.trim().starts_with(name)).unwrap_or_default();
    let told = finished.stdout.replace("\n    ", " ");
    let about = "run 2: other (setup A, pick-and-place, virtual mode, 3 repetitions, seed 2";
    assert!(told.lines().any(|line| line.starts_with(about) && line.ends_with(')')), "{told}");
    assert!(row("SM AET").ends_with('–') && row("CM AET − run 1").contains('.'), "{}", finished.stdout);
    let html = std::fs::read_to_string(directory.path().join("both.html")).unwrap();
    assert_eq!(html.matches("<svg").count(), 2 * 3);
    let one = bench(directory.path(), ["compare", "run"]);
    assert_eq!(one.code, Some(2), "one run is nothing to compare");
}
