//! `race.html`: it opens from a file, moves as the recording does, and says what it cannot draw.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::devtools::{Browser, Graphics, Screen};
use crate::{LAYOUT, bench, run};

const CALM: Screen = Screen { is_calm: true, ..Screen::wide(1400) };

/// Rows of a recording: the columns by name.
struct Table {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    fn read(page: &Path, name: &str) -> Self {
        let text = std::fs::read_to_string(page.with_file_name(name)).unwrap();
        let cells = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
        let mut lines = text.lines();
        Self { names: cells(lines.next().unwrap()), rows: lines.map(cells).collect() }
    }

    fn number(&self, row: &[String], name: &str) -> f64 {
        row[self.names.iter().position(|found| found == name).unwrap()].parse().unwrap()
    }

    fn of<'a>(&'a self, execution_type: &'a str) -> impl Iterator<Item = &'a Vec<String>> {
        self.rows.iter().filter(move |row| row[0] == execution_type)
    }

    /// Time of the last row of a type, in s.
    fn end_s(&self, execution_type: &str) -> f64 {
        self.number(self.of(execution_type).last().unwrap(), "t_ms") / 1e3
    }
}

fn seconds(browser: &mut Browser) -> f64 {
    browser.text("#time").trim_end_matches(" s").parse().unwrap()
}

fn state(browser: &mut Browser, execution_type: &str) -> String {
    browser.text(&format!(".lane.{execution_type} .clock span"))
}

/// A run whose page is opened.
fn opened(directory: &Path, setup: &str, screen: Screen) -> (Browser, PathBuf) {
    let page = run(directory, setup).with_file_name("race.html");
    let mut browser = Browser::new(Graphics::Software);
    browser.open(&page, "", screen);
    (browser, page)
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_race_of_a_cell_has_all_arms_of_a_type_in_one_scene_where_their_tools_meet() {
    let directory = tempfile::tempdir().unwrap();
    let mut browser = Browser::new(Graphics::Software);
    let page = run(directory.path(), "F").with_file_name("race.html");
    for screen in Screen::all() {
        browser.open(&page, "#t=2.5", screen);
        assert_eq!(browser.eval(LAYOUT), json!([]), "{screen:?}");
        assert!(browser.console().is_empty(), "{:?}", browser.console());
        for key in ["rc", "sm", "cm"] {
            let panels = format!("document.querySelectorAll('.lane.{key} .arm').length");
            assert_eq!(browser.eval(&panels), 2, "{screen:?} {key}");
            let tools = format!("document.querySelector('.lane.{key}').dataset.tool");
            let tools = browser.eval(&tools);
            let at: Vec<f64> =
                tools.as_str().unwrap().split(' ').map(|value| value.parse().unwrap()).collect();
            let squared = |axis: usize| (at[axis] - at[axis + 3]) * (at[axis] - at[axis + 3]);
            let apart = (0..3).map(squared).sum::<f64>().sqrt();
            assert!((apart - 400.0).abs() < 1.5, "{screen:?} {key}: the plate is 400 mm wide, {apart}");
        }
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_race_is_laid_out_on_every_screen_and_draws_each_arm() {
    let directory = tempfile::tempdir().unwrap();
    let mut browser = Browser::new(Graphics::Software);
    for setup in ["A", "B"] {
        let page = run(directory.path(), setup).with_file_name("race.html");
        for screen in Screen::all() {
            browser.open(&page, "#t=2", screen);
            let faults = browser.eval(LAYOUT);
            assert_eq!(faults, serde_json::json!([]), "{setup} {screen:?}");
            let loaded = browser.eval("performance.getEntriesByType('resource').map(entry => entry.name)");
            assert_eq!(loaded, serde_json::json!([]), "{setup}: one file has all");
            // Many shades in each lane: an arm in the light.
            let shades = browser.eval(
                "(() => { const canvas = document.querySelector('#stage canvas'); const whole = canvas.getBoundingClientRect();
                 return [...document.querySelectorAll('.view')].map(view => { const box = view.getBoundingClientRect();
                   const copy = document.createElement('canvas'); [copy.width, copy.height] = [box.width, box.height];
                   const context = copy.getContext('2d'); const scale = canvas.width / whole.width;
                   context.drawImage(canvas, (box.left - whole.left) * scale, (box.top - whole.top) * scale,
                     box.width * scale, box.height * scale, 0, 0, copy.width, copy.height);
                   const colours = new Set(new Uint32Array(context.getImageData(0, 0, copy.width, copy.height).data.buffer));
                   return colours.size; }); })()",
            );
            let shades = shades.as_array().unwrap();
            assert!(
                shades.len() == 3 && shades.iter().all(|count| count.as_u64() > Some(100)),
                "{setup} {screen:?}: {shades:?}"
            );
            assert!(browser.console().is_empty(), "{setup} {screen:?}: {:?}", browser.console());
        }
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_arms_slots_and_states_are_those_of_the_recording() {
    // Longer than a screen, because opening a page takes seconds: all is read from one.
    let directory = tempfile::tempdir().unwrap();
    for setup in ["A", "B"] {
        let (mut browser, page) = opened(directory.path(), setup, CALM);
        let (robot, plc) = (Table::read(&page, "trace-robot.csv"), Table::read(&page, "trace-plc.csv"));
        for execution_type in ["rc", "sm", "cm"] {
            // The page has the tool in the root's frame and the recording in the base's: distances are the same in both.
            let ticks: Vec<_> = robot
                .of(execution_type)
                .skip_while(|row| robot.number(row, "path_speed_mm_s") == 0.0)
                .collect();
            let mut before: Option<([f64; 3], [f64; 3])> = None;
            for row in ticks.iter().step_by(ticks.len() / 9) {
                let at_s = robot.number(row, "t_ms") / 1e3;
                browser.eval(&format!("document.querySelector('#scrub').value = {at_s}; document.querySelector('#scrub').dispatchEvent(new Event('input'))"));
                let shown =
                    browser.eval(&format!("document.querySelector('.lane.{execution_type}').dataset.tool"));
                let shown: Vec<f64> =
                    shown.as_str().unwrap().split(' ').map(|mm| mm.parse().unwrap()).collect();
                let shown = [shown[0], shown[1], shown[2]];
                let recorded = ["x_mm", "y_mm", "z_mm"].map(|name| robot.number(row, name));
                if let Some((from_shown, from_recorded)) = before.replace((shown, recorded)) {
                    let distance = |one: [f64; 3], other: [f64; 3]| {
                        one.iter()
                            .zip(other)
                            .map(|(one, other)| (one - other) * (one - other))
                            .sum::<f64>()
                            .sqrt()
                    };
                    let (found, expected) = (distance(from_shown, shown), distance(from_recorded, recorded));
                    assert!(
                        (found - expected).abs() < 0.5,
                        "{setup} {execution_type} at {at_s}: {found} mm, not {expected}"
                    );
                }
                let scan = plc
                    .of(execution_type)
                    .take_while(|scan| plc.number(scan, "t_ms") <= at_s * 1e3)
                    .last()
                    .unwrap();
                let full = browser.eval(&format!(
                    "document.querySelectorAll('.lane.{execution_type} .slots .full').length"
                ));
                assert_eq!(
                    full.as_f64(),
                    Some(plc.number(scan, "in_slots")),
                    "{setup} {execution_type} at {at_s}"
                );
            }
        }
        let [rc, sm, cm] = ["rc", "sm", "cm"].map(|execution_type| plc.end_s(execution_type));
        let later = rc.max(cm) + 0.01;
        assert!(later < sm, "{setup}: RC and CM are done before SM");
        browser.open(&page, &format!("#t={later}"), CALM);
        assert_eq!(["rc", "cm"].map(|key| state(&mut browser, key)), ["done", "done"]);
        assert_ne!(state(&mut browser, "sm"), "done");
        browser.press("End");
        assert_eq!(state(&mut browser, "sm"), "done");
        let still = browser.eval("[...document.querySelectorAll('#result tbody tr')].map(row => parseInt(row.cells[3].textContent))");
        let motions = browser.eval("[...document.querySelectorAll('#result tbody tr')].map(row => parseInt(row.cells[2].textContent))");
        assert_eq!(
            still[1].as_u64().map(|count| count + 1),
            motions[1].as_u64(),
            "{setup}: SM stops after each motion but the last"
        );
        assert_eq!((still[0].as_u64(), still[2].as_u64()), (Some(0), Some(0)), "{setup}");
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_race_is_played_paused_slowed_down_and_scrubbed_by_keys_and_mouse() {
    const FRAMES: &str = "new Promise(done => { let left = 12; const next = () => (left-- ? requestAnimationFrame(next) : done()); next(); })";
    let directory = tempfile::tempdir().unwrap();
    let (mut browser, page) = opened(directory.path(), "A", CALM);
    assert_eq!(browser.text("#play"), "Play", "a reader who asked for less motion starts it");
    browser.press("Home");
    assert_eq!(seconds(&mut browser), 0.0);
    let cycle_s = browser.eval("run.cycle_ms").as_f64().unwrap() / 1e3;
    ["ArrowRight", "ArrowRight", "ArrowRight", "ArrowLeft"].iter().for_each(|key| browser.press(key));
    assert!((seconds(&mut browser) - 2.0 * cycle_s).abs() < 1e-9);
    browser.press(" ");
    browser.eval(FRAMES);
    assert_eq!(browser.text("#play"), "Pause");
    let playing = seconds(&mut browser);
    assert!(playing > 2.0 * cycle_s, "it does not move");
    browser.press(" ");
    let paused = seconds(&mut browser);
    browser.eval(FRAMES);
    assert_eq!((browser.text("#play"), seconds(&mut browser)), ("Play".to_owned(), paused));
    // Slow motion: at most 0.1 s passes in a frame, so these frames advance 12 · 0.1 / 50 s at most.
    [",", ",", ",", ",", " "].iter().for_each(|key| browser.press(key));
    browser.eval(FRAMES);
    browser.press(" ");
    let passed = seconds(&mut browser) - paused;
    assert!(passed > 0.0 && passed < 0.1, "{passed} s in slow motion");
    browser.click(".curve.sm .u-over", 0.5);
    let middle = seconds(&mut browser);
    let longest = browser.eval("longest").as_f64().unwrap();
    assert!((middle / longest - 0.5).abs() < 0.02, "{middle} of {longest}");
    browser.press("End");
    assert!((seconds(&mut browser) - longest).abs() < 1e-3);
    browser.press("v");
    assert_eq!(browser.eval("document.querySelector('#view').value"), "side");
    // Without that wish it plays at once, and stops at the end.
    browser.open(&page, "", Screen { is_calm: false, ..CALM });
    assert_eq!(browser.text("#play"), "Pause");
    browser.press("End");
    browser.eval(FRAMES);
    assert_eq!(browser.text("#play"), "Play");
    assert!(browser.console().is_empty(), "{:?}", browser.console());
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn without_webgl_the_race_says_so_and_shows_curves_and_slots() {
    let directory = tempfile::tempdir().unwrap();
    let page = run(directory.path(), "A").with_file_name("race.html");
    let mut browser = Browser::new(Graphics::None);
    for screen in [Screen::wide(390), Screen::wide(1400)] {
        browser.open(&page, "#t=1", screen);
        assert_eq!(browser.eval("document.querySelector('#flat').offsetHeight > 0"), true);
        assert!(browser.text("#flat").contains("no WebGL"));
        assert_eq!(browser.eval("document.querySelectorAll('.curve canvas').length"), 3);
        assert_eq!(browser.eval(LAYOUT), serde_json::json!([]), "{screen:?}");
        browser.press("End");
        assert_eq!(state(&mut browser, "sm"), "done");
        assert!(browser.console().is_empty(), "{:?}", browser.console());
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_reports_picture_opens_the_race_and_a_run_without_a_recording_says_what_would_do() {
    let directory = tempfile::tempdir().unwrap();
    let report = run(directory.path(), "A");
    let mut browser = Browser::new(Graphics::Software);
    browser.open(&report, "", Screen::wide(1400));
    browser.forget();
    browser.click("#race .still svg", 0.5);
    browser.loaded();
    assert!(browser.eval("location.href").as_str().unwrap().ends_with("race.html"));
    std::fs::remove_file(report.with_file_name("trace-robot.csv")).unwrap();
    bench(directory.path(), &["report", "A"]);
    browser.open(&report.with_file_name("race.html"), "", Screen::wide(390));
    let said = browser.text(".absent");
    assert!(
        said.contains("Not recorded") && said.contains("bench --mode virtual --setup A/setup.toml"),
        "{said}"
    );
    assert_eq!(browser.eval("document.querySelectorAll('canvas, script').length"), 0);
    assert_eq!(browser.eval(LAYOUT), serde_json::json!([]));
}
