//! Reports in a headless Chromium: every section is there and visible, nothing is wider than the page, the console
//! has no message, and the page prints. `scripts/dev.sh browser` runs these tests with a Chromium.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use assert_cmd::Command as Program;
use serde_json::Value;

/// Script that writes the browser's view of the page into the page, which the browser then prints.
const PROBE: &str = r#"<script>
addEventListener("load", () => {
  const visible = e => { const box = e.getBoundingClientRect(); return box.width > 0 && box.height > 0; };
  const seen = {
    width: innerWidth,
    scrolled: document.documentElement.scrollWidth,
    sections: [...document.querySelectorAll("section")].filter(visible).map(e => e.id),
    figures: [...document.querySelectorAll("svg")].filter(visible).length,
    hidden: [...document.querySelectorAll("svg")].filter(e => !visible(e)).length,
    text: document.body.innerText.length,
    smallest: Math.min(...[...document.querySelectorAll("section *")].filter(e => visible(e) && e.children.length === 0
      && e.textContent.trim() && !e.closest("svg")).map(e => parseFloat(getComputedStyle(e).fontSize))),
  };
  const out = document.createElement("template");
  out.id = "seen";
  out.setAttribute("data-seen", encodeURIComponent(JSON.stringify(seen)));
  document.body.append(out);
});
</script>"#;

const DESKTOP: &str = "1280,900";
const PHONE: &str = "390,844";

struct Browser {
    program: PathBuf,
    profile: tempfile::TempDir,
}

impl Browser {
    fn new() -> Self {
        let program = std::env::var_os("CHROMIUM")
            .expect("CHROMIUM names the browser; `scripts/dev.sh browser` sets it");
        Self { program: program.into(), profile: tempfile::tempdir().unwrap() }
    }

    fn open(&self, arguments: &[&str], page: &Path) -> Output {
        let output = Command::new(&self.program)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-quic"])
            .args(["--enable-logging=stderr", "--hide-scrollbars"])
            .arg(format!("--user-data-dir={}", self.profile.path().display()))
            .args(arguments)
            .arg(format!("file://{}", page.display()))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output
    }

    /// Returns the browser's view of a page in a window of this size; its console must have no message.
    fn look(&self, page: &Path, window: &str) -> Value {
        let probed = page.with_extension("probed.html");
        let html = std::fs::read_to_string(page).unwrap();
        assert!(html.contains("</body>"));
        std::fs::write(&probed, html.replace("</body>", &format!("{PROBE}</body>"))).unwrap();
        let output = self.open(&["--dump-dom", &format!("--window-size={window}")], &probed);
        let log = String::from_utf8_lossy(&output.stderr);
        let console: Vec<_> = log.lines().filter(|line| line.contains("CONSOLE")).collect();
        assert!(console.is_empty(), "{console:?}");
        let dom = String::from_utf8(output.stdout).unwrap();
        let seen = dom.split_once("data-seen=\"").expect("the probe ran").1.split_once('"').unwrap().0;
        serde_json::from_str(&decoded(seen)).unwrap()
    }
}

/// Decodes the result of `encodeURIComponent`.
fn decoded(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let [first, tail @ ..] = rest {
        if let ([b'%'], Some((hex, after))) = (&[*first], tail.split_at_checked(2)) {
            bytes.push(u8::from_str_radix(std::str::from_utf8(hex).unwrap(), 16).unwrap());
            rest = after;
        } else {
            bytes.push(*first);
            rest = tail;
        }
    }
    String::from_utf8(bytes).unwrap()
}

/// A virtual run of a setup, and its report.
fn report(directory: &Path, setup: &str) -> PathBuf {
    let run = Program::cargo_bin("bench")
        .unwrap()
        .current_dir(directory)
        .args(["--setup", setup, "--mode", "virtual", "--reps", "3", "--quiet", "--out", setup])
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    directory.join(setup).join("report.html")
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn a_report_shows_every_section_on_a_desktop_and_on_a_phone_and_prints() {
    let directory = tempfile::tempdir().unwrap();
    let browser = Browser::new();
    for setup in ["A", "B"] {
        let page = report(directory.path(), setup);
        for window in [DESKTOP, PHONE] {
            let seen = browser.look(&page, window);
            let sections: Vec<_> =
                seen["sections"].as_array().unwrap().iter().map(|id| id.as_str().unwrap()).collect();
            for id in ["table", "speed", "samples", "path", "queue", "lateness", "numbers", "host"] {
                assert!(sections.contains(&id), "{setup} {window}: no section {id} in {seen}");
            }
            assert!(seen["figures"].as_u64().unwrap() >= 4, "{setup} {window}: {seen}");
            let (width, scrolled) = (seen["width"].as_u64().unwrap(), seen["scrolled"].as_u64().unwrap());
            assert!(scrolled <= width, "{setup} {window}: the page is {scrolled} px wide");
            assert!(seen["smallest"].as_f64().unwrap() >= 10.0, "{setup} {window}: {seen}");
        }
        let pdf = directory.path().join(format!("{setup}.pdf"));
        browser.open(&[&format!("--print-to-pdf={}", pdf.display())], &page);
        assert!(std::fs::read(&pdf).unwrap().starts_with(b"%PDF-"));
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn a_comparison_of_runs_fits_on_a_desktop_and_on_a_phone() {
    let directory = tempfile::tempdir().unwrap();
    report(directory.path(), "A");
    report(directory.path(), "B");
    let compared = Program::cargo_bin("bench")
        .unwrap()
        .current_dir(directory.path())
        .args(["compare", "A", "B", "--html", "compared.html"])
        .output()
        .unwrap();
    assert!(compared.status.success(), "{}", String::from_utf8_lossy(&compared.stderr));
    let browser = Browser::new();
    for window in [DESKTOP, PHONE] {
        let seen = browser.look(&directory.path().join("compared.html"), window);
        assert!(seen["figures"].as_u64().unwrap() >= 1, "{window}: {seen}");
        assert!(seen["scrolled"].as_u64() <= seen["width"].as_u64(), "{window}: {seen}");
    }
}

#[test]
#[ignore = "needs a Chromium: scripts/dev.sh browser"]
fn the_probe_finds_faults_of_a_page() {
    let directory = tempfile::tempdir().unwrap();
    let page = directory.path().join("bad.html");
    let bad = "<!doctype html><html><body><section id=\"a\" style=\"width:3000px\">x</section><section id=\"b\" hidden>y</section></body></html>";
    std::fs::write(&page, bad).unwrap();
    let seen = Browser::new().look(&page, PHONE);
    assert_eq!(seen["sections"], serde_json::json!(["a"]));
    assert!(seen["scrolled"].as_u64() > seen["width"].as_u64(), "{seen}");
}
