//! The pages in a headless Chromium: laid out on every screen, readable, and the race moves. `scripts/dev.sh browser` runs
//! these tests with a Chromium.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

mod devtools;
mod live;
mod race;

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use devtools::{Browser, Graphics, Screen};
use records::results::{Results, Status};
use serde_json::json;

/// Script that returns what is wrong with the layout of a page.
const LAYOUT: &str = include_str!("layout.js");

fn bench(directory: &Path, arguments: &[&str]) {
    let ended = Command::cargo_bin("bench").unwrap().current_dir(directory).args(arguments).output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
}

/// Folds out every table of a figure.
const FOLD_OUT: &str = "document.querySelectorAll('details').forEach(part => { part.open = true; })";

/// A virtual run of a setup; returns the path of its report.
fn run(directory: &Path, setup: &str) -> PathBuf {
    bench(directory, &["--setup", setup, "--mode", "virtual", "--reps", "6", "--quiet", "--out", setup]);
    directory.join(setup).join("report.html")
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn a_report_is_laid_out_on_every_screen_with_all_of_its_sections() {
    let directory = tempfile::tempdir().unwrap();
    let mut browser = Browser::new(Graphics::None);
    for setup in ["A", "B"] {
        let page = run(directory.path(), setup);
        for screen in Screen::all() {
            browser.open(&page, "", screen);
            assert_eq!(browser.eval(LAYOUT), json!([]), "{setup} {screen:?}");
            // A4 has 1016 px between its margins: what is higher is torn between two pages.
            let highest = browser.eval(
                "Math.max(...[...document.querySelectorAll('figure, tr, dl div')].map(part => part.offsetHeight))",
            );
            assert!(!screen.is_print || highest.as_f64() <= Some(1016.0), "{setup}: {highest} px on paper");
            browser.eval(FOLD_OUT);
            assert_eq!(browser.eval(LAYOUT), json!([]), "{setup} {screen:?}, folded out");
            let seen = browser.eval(
                "[...document.querySelectorAll('section')].filter(e => e.offsetHeight > 0).map(e => e.id)",
            );
            for id in
                ["look", "table", "race", "speed", "samples", "path", "queue", "lateness", "numbers", "host"]
            {
                assert!(
                    seen.as_array().unwrap().contains(&json!(id)),
                    "{setup} {screen:?}: no {id} in {seen}"
                );
            }
            assert!(browser.console().is_empty(), "{:?}", browser.console());
        }
        let printed = browser.call("Page.printToPDF", json!({}));
        assert!(printed["data"].as_str().unwrap().starts_with("JVBERi"), "that is %PDF- in base64");
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_first_screen_of_a_report_shows_the_three_bars_in_their_ratios() {
    let directory = tempfile::tempdir().unwrap();
    let mut browser = Browser::new(Graphics::None);
    for setup in ["A", "B"] {
        let page = run(directory.path(), setup);
        let results = std::fs::read_to_string(page.with_file_name("results.json")).unwrap();
        let results: serde_json::Value = serde_json::from_str(&results).unwrap();
        let mean = |key: &str| {
            let samples = results["results"][key]["samples_ms"].as_array().unwrap();
            samples.iter().map(|sample| sample.as_f64().unwrap()).sum::<f64>() / samples.len() as f64
        };
        for screen in Screen::all() {
            browser.open(&page, "", screen);
            let of = |part: &str| {
                format!(
                    "['rc', 'sm', 'cm'].map(key => [...document.querySelectorAll(`#look g.${{key}}.ours rect`)]\
                     .map(bar => bar.getBoundingClientRect()).find(bar => bar.width > 0).{part})"
                )
            };
            let [lengths, ends] = ["width", "bottom"].map(|part| {
                let found = browser.eval(&of(part));
                [0, 1, 2].map(|index| found[index].as_f64().unwrap())
            });
            let [rc, sm, cm] = lengths;
            assert!(
                (rc / sm / (mean("rc") / mean("sm")) - 1.0).abs() < 0.01,
                "{setup} {screen:?}: {lengths:?}"
            );
            assert!(
                (cm / sm / (mean("cm") / mean("sm")) - 1.0).abs() < 0.01,
                "{setup} {screen:?}: {lengths:?}"
            );
            assert!(ends[2] < 700.0, "{setup} {screen:?}: the last bar ends {} px below the top", ends[2]);
            let tooltips =
                browser.eval("[...document.querySelectorAll('#look .wide title')].map(e => e.textContent)");
            assert!(tooltips.as_array().unwrap().len() >= 6, "{tooltips}");
        }
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_report_of_a_cell_is_laid_out_on_every_screen_with_all_of_its_sections() {
    let directory = tempfile::tempdir().unwrap();
    let mut browser = Browser::new(Graphics::None);
    for setup in ["E", "F"] {
        let page = run(directory.path(), setup);
        for screen in Screen::all() {
            browser.open(&page, "", screen);
            assert_eq!(browser.eval(LAYOUT), json!([]), "{setup} {screen:?}");
            browser.eval(FOLD_OUT);
            assert_eq!(browser.eval(LAYOUT), json!([]), "{setup} {screen:?}, folded out");
            let seen = browser.eval(
                "[...document.querySelectorAll('section')].filter(e => e.offsetHeight > 0).map(e => e.id)",
            );
            for id in ["table", "gain", "marks", "arms", "race"] {
                assert!(
                    seen.as_array().unwrap().contains(&json!(id)),
                    "{setup} {screen:?}: no {id} in {seen}"
                );
            }
            assert!(browser.console().is_empty(), "{:?}", browser.console());
        }
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn a_comparison_of_runs_is_laid_out_on_every_screen() {
    let directory = tempfile::tempdir().unwrap();
    for setup in ["A", "B"] {
        run(directory.path(), setup);
    }
    bench(directory.path(), &["compare", "A", "B", "--html", "compared.html"]);
    let mut browser = Browser::new(Graphics::None);
    for screen in Screen::all() {
        browser.open(&directory.path().join("compared.html"), "", screen);
        assert_eq!(browser.eval(LAYOUT), json!([]), "{screen:?}");
        browser.eval(FOLD_OUT);
        assert_eq!(browser.eval(LAYOUT), json!([]), "{screen:?}, folded out");
        assert_eq!(browser.eval("document.querySelectorAll('svg').length > 0"), true);
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_pages_of_studies_are_laid_out_on_every_screen() {
    let directory = tempfile::tempdir().unwrap();
    bench(directory.path(), &["sensitivity", "--reps", "1", "--quiet", "--out", "s"]);
    bench(directory.path(), &["sweep", "--depths", "1,5", "--reps", "1", "--quiet", "--out", "w"]);
    bench(directory.path(), &["explore", "--types", "rc,cm", "--every", "200", "--quiet", "--out", "e"]);
    let study = "[study]\nsetup = \"A\"\nreps = 1\nseeds = \"1..=8\"\n\
                 [[vary]]\nkey = \"robot.path_acceleration_mm_s2\"\nvalues = [2000.0, 2500.0]\n\
                 [[vary]]\nkey = \"robot.skill_overhead_us\"\nuniform = { min = 100000.0, max = 140000.0 }\n";
    std::fs::write(directory.path().join("study.toml"), study).unwrap();
    bench(directory.path(), &["study", "run", "study.toml", "--quiet", "--out", "rows"]);
    bench(directory.path(), &["study", "report", "rows"]);
    let mut browser = Browser::new(Graphics::None);
    for page in ["s/sensitivity.html", "w/sweep.html", "e/explore.html", "rows/report.html"] {
        for screen in Screen::all() {
            browser.open(&directory.path().join(page), "", screen);
            assert_eq!(browser.eval(LAYOUT), json!([]), "{page} {screen:?}");
            browser.eval(FOLD_OUT);
            assert_eq!(browser.eval(LAYOUT), json!([]), "{page} {screen:?}, folded out");
            assert!(browser.console().is_empty(), "{:?}", browser.console());
        }
    }
}

/// Makes each execution time of a run 60 ms longer, and interrupts it.
fn make_slower(run: &Path) {
    let (samples, path) = (run.join("samples.csv"), run.join("results.json"));
    let slower = |line: &str| {
        let mut fields: Vec<_> = line.split(',').map(str::to_owned).collect();
        if let Ok(millis) = fields[2].parse::<f64>() {
            fields[2] = (millis + 60.0).to_string();
        }
        fields.join(",") + "\n"
    };
    let text: String = std::fs::read_to_string(&samples).unwrap().lines().map(slower).collect();
    std::fs::write(samples, text).unwrap();
    let mut results: Results = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    let all = &mut results.results;
    for result in [&mut all.rc, &mut all.sm, &mut all.cm].into_iter().flatten() {
        result.samples_ms.iter_mut().for_each(|sample| *sample += 60.0);
    }
    results.derive_figures();
    results.status = Status::Interrupted;
    std::fs::write(path, results.to_json().unwrap()).unwrap();
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn a_history_is_laid_out_on_every_screen_marks_the_change_and_leads_to_the_reports() {
    let directory = tempfile::tempdir().unwrap();
    let virtual_run = |name: &str, arguments: &[&str]| {
        let out = format!("runs/{name}");
        bench(directory.path(), &[&["--mode", "virtual", "--quiet", "--out", &out], arguments].concat());
        directory.path().join(out)
    };
    for seed in ["1", "2", "3"] {
        virtual_run(&format!("A run with a long name {seed} & <b>"), &["--reps", "6", "--seed", seed]);
    }
    virtual_run("slow", &["--reps", "6", "--override", "50"]);
    let unreported = virtual_run("single", &["--reps", "1", "--setup", "B"]);
    std::fs::remove_file(unreported.join("report.html")).unwrap();
    let broken = virtual_run("broken", &["--reps", "1"]);
    std::fs::write(broken.join("results.json"), r#"{"schema_version": 0}"#).unwrap();
    make_slower(&directory.path().join("runs/A run with a long name 3 & <b>"));
    bench(directory.path(), &["history", "--html", "history.html"]);
    let page = directory.path().join("history.html");
    let mut browser = Browser::new(Graphics::None);
    for screen in Screen::all() {
        browser.open(&page, "", screen);
        assert_eq!(browser.eval(LAYOUT), json!([]), "{screen:?}");
        let highest = browser
            .eval("Math.max(...[...document.querySelectorAll('figure, tr')].map(part => part.offsetHeight))");
        assert!(!screen.is_print || highest.as_f64() <= Some(1016.0), "{highest} px on paper");
        // Three panels of the first section, each with the change beside its upright line.
        let labels = browser.eval(
            "[...document.querySelectorAll('#kind-1 svg text')].filter(e => e.checkVisibility() && /^[+−]\\d+\\.\\d$/.test(e.textContent.trim())).length",
        );
        assert_eq!(labels, 3, "{screen:?}");
        assert!(browser.console().is_empty(), "{:?}", browser.console());
    }
    let changed = browser.eval("[...document.querySelectorAll('#kind-1 tbody tr')].map(row => row.querySelectorAll('.change').length)");
    assert_eq!(changed, json!([0, 0, 3, 0]));
    assert!(browser.text("#kind-1 tbody tr:nth-child(4)").contains("override 50, before 100"));
    assert!(browser.text("#left-out").contains("schema version 0"));
    assert_eq!(browser.eval("document.querySelectorAll('#kind-2 a').length"), 0, "no report, no link");
    browser.open(&page, "", Screen::wide(1400));
    browser.forget();
    browser.click("#kind-1 tbody tr:nth-child(2) a", 0.5);
    browser.loaded();
    assert!(browser.text("body > header").contains("A run with a long name 2 & <b>"));
    let printed = browser.call("Page.printToPDF", json!({}));
    assert!(printed["data"].as_str().unwrap().starts_with("JVBERi"), "that is %PDF- in base64");
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_probe_finds_each_fault_of_a_page() {
    let directory = tempfile::tempdir().unwrap();
    let page = directory.path().join("bad.html");
    let bad = [
        ("outside", "<section style='width:3000px'>wide</section>"),
        ("clipped:", "<p style='width:40px; overflow:hidden; white-space:nowrap'>a long line of text</p>"),
        ("clipped label", "<svg width='50' height='20'><text x='30' y='15'>a label</text></svg>"),
        ("overlap", "<p>one</p><p style='margin-top:-2.2em'>another</p>"),
        ("contrast", "<p style='color:#aaa'>pale</p>"),
        ("small", "<p style='font-size:6px'>tiny</p>"),
    ];
    let mut browser = Browser::new(Graphics::None);
    for (fault, body) in bad {
        std::fs::write(&page, format!("<!doctype html><html lang='en'><body>{body}</body></html>")).unwrap();
        browser.open(&page, "", Screen::wide(390));
        let found = browser.eval(LAYOUT);
        let is_found = found.as_array().unwrap().iter().any(|line| line.as_str().unwrap().starts_with(fault));
        assert!(is_found, "{fault}: {found}");
    }
}
