//! The live view of a real run: open, run, reload, Ctrl-C.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;

use crate::LAYOUT;
use crate::devtools::{Browser, Graphics, Screen};

/// A real run with a live view.
struct Run {
    bench: Child,
    /// Address of the page.
    address: String,
}

impl Run {
    fn start(directory: &Path, arguments: &[&str]) -> Self {
        let arguments = [&["--setup", "A", "--live", "127.0.0.1:0", "--out", "run"], arguments];
        Self::start_with(directory, &arguments.concat())
    }

    fn start_with(directory: &Path, arguments: &[&str]) -> Self {
        let mut bench = Command::new(assert_cmd::cargo::cargo_bin!("bench"))
            .current_dir(directory)
            .args(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(bench.stderr.take().unwrap()).lines().map_while(Result::ok);
        let address =
            lines.by_ref().find_map(|line| Some(line.strip_prefix("Live at ")?.to_owned())).unwrap();
        // A full pipe would hold the bench up.
        std::thread::spawn(move || lines.for_each(drop));
        Self { bench, address }
    }

    /// Returns address and port of the page.
    fn host(&self) -> &str {
        self.address.trim_start_matches("http://").trim_end_matches('/')
    }

    fn interrupt(mut self) -> ExitStatus {
        kill_process(Pid::from_child(&self.bench), Signal::INT).unwrap();
        self.bench.wait().unwrap()
    }
}

/// Waits until an expression is true in the page.
fn wait(browser: &mut Browser, expression: &str) {
    let waited = format!(
        "new Promise(done => {{ const end = Date.now() + 30000; const look = () => {{ \
         if ({expression}) done(true); else if (Date.now() > end) done(document.body.innerText); else setTimeout(look, 30); }}; look(); }})"
    );
    let found = browser.eval(&waited);
    assert_eq!(found, true, "{expression} did not come");
}

fn tool(browser: &mut Browser) -> String {
    browser.eval("document.querySelector('.lane').dataset.tool || ''").as_str().unwrap().to_owned()
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn a_page_follows_a_real_run_through_reloads_until_ctrl_c() {
    let directory = tempfile::tempdir().unwrap();
    let run = Run::start(directory.path(), &["--reps", "20", "--types", "cm"]);
    let mut browser = Browser::new(Graphics::Software);
    browser.open_address(&run.address, Screen::wide(1400));
    wait(&mut browser, "/CM, repetition \\d+ of 20/.test(document.querySelector('#state').textContent)");
    wait(
        &mut browser,
        "document.querySelector('.lane').dataset.tool && document.querySelectorAll('.slots .full').length > 0",
    );
    let before = tool(&mut browser);
    wait(&mut browser, &format!("document.querySelector('.lane').dataset.tool !== '{before}'"));
    wait(
        &mut browser,
        "/^[1-9]\\d* of 20$/.test(document.querySelector('#table tr.cm').cells[1].textContent)",
    );
    wait(&mut browser, "document.querySelectorAll('.histogram tbody tr').length > 1");
    let sent = browser.eval("Number(document.querySelector('#counters tbody tr').cells[1].textContent)");
    assert!(sent.as_f64() > Some(1000.0), "{sent}");
    // A page that opens now has the state of one that was open: table, reports and the repetition so far.
    for screen in Screen::all() {
        browser.open_address(&run.address, screen);
        wait(&mut browser, "document.querySelector('#table tr.cm').cells[1].textContent.endsWith(' of 20')");
        wait(&mut browser, "document.querySelectorAll('#counters tbody tr').length > 5");
        wait(&mut browser, "document.querySelector('.lane').dataset.tool");
        assert_eq!(browser.eval(LAYOUT), json!([]), "{screen:?}");
        let shades = browser.eval(
            "(() => { const canvas = document.querySelector('#stage canvas'); const copy = document.createElement('canvas'); \
             [copy.width, copy.height] = [canvas.width, canvas.height]; const context = copy.getContext('2d'); \
             context.drawImage(canvas, 0, 0); \
             return new Set(new Uint32Array(context.getImageData(0, 0, copy.width, copy.height).data.buffer)).size; })()",
        );
        assert!(shades.as_u64() > Some(100), "{screen:?}: {shades} shades are no arm");
        assert!(browser.console().is_empty(), "{screen:?}: {:?}", browser.console());
    }
    let ended = run.interrupt();
    wait(&mut browser, "document.body.classList.contains('is-ended')");
    let said = browser.text("#state");
    let report = directory.path().canonicalize().unwrap().join("run/report.html");
    let named = format!(" of 20 repetitions saved in run. Open the report: {}", report.display());
    assert!(said.starts_with("Interrupted, ") && said.ends_with(&named), "{said}");
    assert!(report.is_file());
    assert_eq!(ended.code(), Some(130));
    wait(&mut browser, "document.querySelector('#state a')?.textContent === 'Open the report'");
    let link = browser.eval("document.querySelector('#state a').href").as_str().unwrap().to_owned();
    assert!(link.starts_with("blob:"), "{link}");
    assert_eq!(
        browser.eval("!!(window.opened = window.open(document.querySelector('#state a').href))"),
        true
    );
    wait(
        &mut browser,
        "opened.document.querySelector('h1') && opened.document.querySelector('a[href^=\"blob:\"]')",
    );
    assert!(browser.console().is_empty(), "{:?}", browser.console());
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn browsers_that_hang_or_leave_do_not_disturb_a_run() {
    let directory = tempfile::tempdir().unwrap();
    let mut run = Run::start(directory.path(), &["--reps", "1", "--types", "cm"]);
    let host = run.host().to_owned();
    // They ask for the events and never read them.
    let _hanging: Vec<_> = (0..3)
        .map(|_| {
            let mut stream = TcpStream::connect(&host).unwrap();
            write!(stream, "GET /events HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
            stream
        })
        .collect();
    let mut browser = Browser::new(Graphics::None);
    browser.open_address(&run.address, Screen::wide(390));
    assert!(browser.text("#flat").contains("no WebGL"));
    wait(&mut browser, "document.querySelector('#state').textContent.startsWith('CM')");
    assert_eq!(browser.eval(LAYOUT), json!([]));
    drop(browser);
    assert!(run.bench.wait().unwrap().success());
    let results = std::fs::read_to_string(directory.path().join("run/results.json")).unwrap();
    assert!(results.contains("\"status\": \"complete\""), "{results}");
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn a_page_of_a_bench_that_was_killed_loads_the_page_of_the_next_run_at_its_address() {
    let directory = tempfile::tempdir().unwrap();
    let mut killed = Run::start(directory.path(), &["--reps", "20", "--types", "cm"]);
    let mut browser = Browser::new(Graphics::Software);
    browser.open_address(&killed.address, Screen::wide(1400));
    wait(&mut browser, "document.querySelector('.lane').dataset.tool");
    assert_eq!(browser.eval("document.querySelectorAll('#table tr.cm, #table tr.sm').length"), 1);
    browser.forget();
    killed.bench.kill().unwrap();
    killed.bench.wait().unwrap();
    let next = ["--setup", "B", "--live", killed.host(), "--out", "next", "--reps", "20", "--types", "cm,sm"];
    let next = Run::start_with(directory.path(), &next);
    assert_eq!(next.address, killed.address);
    browser.loaded();
    wait(&mut browser, "document.querySelectorAll('#table tr.cm, #table tr.sm').length === 2");
    wait(&mut browser, "document.querySelector('.lane')?.dataset.tool");
    assert_eq!(next.interrupt().code(), Some(130));
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn a_page_of_a_cell_draws_both_arms_and_shows_where_each_waits() {
    let directory = tempfile::tempdir().unwrap();
    let run = ["--setup", "E", "--live", "127.0.0.1:0", "--out", "run", "--reps", "20", "--types", "cm"];
    let run = Run::start_with(directory.path(), &run);
    let mut browser = Browser::new(Graphics::Software);
    browser.open_address(&run.address, Screen::wide(1400));
    wait(&mut browser, "document.querySelector('.lane').dataset.tool");
    assert_eq!(tool(&mut browser).split(' ').count(), 6, "the tools of both arms");
    let arm = "[...document.querySelectorAll('.arm')]";
    for station in ["left", "right"] {
        wait(
            &mut browser,
            &format!(
                "{arm}.some(arm => arm.dataset.station === '{station}' && arm.querySelector('.slots .full'))"
            ),
        );
    }
    wait(
        &mut browser,
        &format!("{arm}.some(arm => /waits at mark [1-4]/.test(arm.querySelector('.clock').textContent))"),
    );
    let passed =
        "/^4 of 4 marks passed, waited \\d+\\.\\d\\d s$/.test(arm.querySelector('.marks').textContent)";
    wait(&mut browser, &format!("{arm}.every(arm => {passed})"));
    assert_eq!(browser.eval("document.querySelectorAll('.curve canvas').length"), 2);
    for screen in Screen::all() {
        browser.open_address(&run.address, screen);
        wait(&mut browser, "document.querySelector('.lane').dataset.tool");
        wait(&mut browser, "document.querySelector('#counters tbody tr')?.cells.length === 4");
        assert_eq!(browser.eval(LAYOUT), json!([]), "{screen:?}");
        assert!(browser.console().is_empty(), "{screen:?}: {:?}", browser.console());
    }
    assert_eq!(run.interrupt().code(), Some(130));
}
