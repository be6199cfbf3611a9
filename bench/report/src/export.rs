//! The results in formats of other programs. Each file is replaced as a whole after every repetition, so that an
//! interrupted run keeps its results.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::cell_export;
use crate::export_text::{escaped_marks, markdown_row, markdown_text, quoted, unfinished};
use crate::figures::{self, CALIBRATED, Figures, rounded};
use crate::progress::label;
use crate::table;
use clap::Args;
use records::calibrated;
use records::cell_results::CellResults;
use records::figures::TypeFigures;
use records::results::Results;
use records::run_directory::{Durability, replace};
use records::schedule::repetitions;

/// Which files to write besides the run directory.
#[derive(Args, Clone, Debug, Default)]
pub struct Exports {
    /// Write the results to this file as well, as JSON; bench/schemas/results.schema.json says what is in it.
    #[arg(long = "export-json", value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write AET, MAD and related figures to this file, as CSV with one line per type, and per station where there are several; DIR/samples.csv has one line per
    /// repetition.
    #[arg(long = "export-csv", value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write the table and what stands below it to this file, as Markdown.
    #[arg(long = "export-markdown", value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Write the repetitions to this file, as JUnit XML: one suite per type, one case per repetition.
    #[arg(long = "export-junit", value_name = "FILE")]
    junit: Option<PathBuf>,
    /// When the run started, in UTC by ISO 8601.
    #[arg(skip)]
    started: Option<String>,
}

impl Exports {
    /// Exports only JSON, to this file.
    #[must_use]
    pub fn json(path: PathBuf) -> Self {
        Self { json: Some(path), ..Self::default() }
    }

    /// Sets when the run started, in UTC by ISO 8601.
    #[must_use]
    pub fn of_run(self, started: String) -> Self {
        Self { started: Some(started), ..self }
    }

    /// Writes every requested file.
    ///
    /// # Errors
    ///
    /// A file cannot be written; its old content is kept.
    pub fn write(&self, results: &Results, durability: Durability) -> anyhow::Result<()> {
        let write = |path: &Option<PathBuf>, text: &dyn Fn() -> anyhow::Result<String>| match path {
            Some(path) => replace(path, &text()?, durability),
            None => Ok(()),
        };
        write(&self.json, &|| Ok(results.to_json()?))?;
        write(&self.csv, &|| Ok(csv(results)))?;
        write(&self.markdown, &|| Ok(markdown(results)))?;
        write(&self.junit, &|| Ok(junit(results, self.started.as_deref())))
    }

    /// Writes every requested file of a cell.
    ///
    /// # Errors
    ///
    /// A file cannot be written; its old content is kept.
    pub fn write_cell(&self, results: &CellResults) -> anyhow::Result<()> {
        let write = |path: &Option<PathBuf>, text: &dyn Fn() -> anyhow::Result<String>| match path {
            Some(path) => replace(path, &text()?, Durability::Written),
            None => Ok(()),
        };
        write(&self.json, &|| Ok(results.to_json()?))?;
        write(&self.csv, &|| Ok(cell_export::csv(results)))?;
        write(&self.markdown, &|| Ok(cell_export::markdown(results)))?;
        // A case is a repetition of the cell, whatever its stations did in it.
        write(&self.junit, &|| Ok(junit(&results.of_station(0), self.started.as_deref())))
    }

    /// Returns the options that ask for files, each with its file if it is given.
    #[must_use]
    pub fn files(&self) -> [(&'static str, Option<&Path>); 4] {
        let Self { json, csv, markdown, junit, started: _ } = self;
        [
            ("--export-json", json.as_deref()),
            ("--export-csv", csv.as_deref()),
            ("--export-markdown", markdown.as_deref()),
            ("--export-junit", junit.as_deref()),
        ]
    }
}

const CSV_HEADER: &str = "setup,application,mode,seed,type,runs,failed,aet_ms,mad_ms,min_ms,max_ms,blends_suppressed,\
    paper_aet_ms,paper_mad_ms,aet_minus_paper_ms,aet_calibrated,mad_calibrated,h0_aet_ms,h0_mad_ms,aeti,h0_aeti\n";

/// Formats a line per type, with times in ms to a microsecond. Missing values are empty; what is the same for all types, as
/// the seed and AETi, is in every line.
fn csv(results: &Results) -> String {
    let mut text = String::from(CSV_HEADER);
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| rounded(value, 3).to_string());
    let improvement = results.improvement();
    for figures in results.figures() {
        let samples = || figures.result.samples_ms.iter().copied();
        let fields = [
            quoted(&results.setup),
            quoted(&results.application),
            results.mode.clone(),
            results.seed.to_string(),
            figures.execution_type.to_string(),
            figures.count().to_string(),
            figures.result.failed.len().to_string(),
            number(figures.aet_ms),
            number(figures.mad_ms),
            number(samples().reduce(f64::min)),
            number(samples().reduce(f64::max)),
            figures.blends_suppressed().to_string(),
            number(figures.paper.map(|paper| paper.aet_ms)),
            number(figures.paper.map(|paper| paper.mad_ms)),
            number(figures.aet_minus_paper_ms()),
            figures.is_aet_calibrated.to_string(),
            figures.is_mad_calibrated.to_string(),
            number(figures.h0_aet_ms),
            number(figures.h0_mad_ms),
            number(improvement.own),
            number(improvement.h0),
        ];
        text += &fields.join(",");
        text.push('\n');
    }
    text
}

/// Formats a heading, the table of the screen and what stands below it.
fn markdown(results: &Results) -> String {
    let Results { setup, title, application, .. } = results;
    let mut lines = vec![
        format!("### Setup {}: {}", markdown_text(setup), markdown_text(title)),
        String::new(),
        format!(
            "{}, {}, {}, {}{}",
            markdown_text(application),
            repetitions(results.reps),
            results.mode_in_words(),
            markdown_text(&results.conditions(", ")),
            unfinished(results.status)
        ),
        String::new(),
    ];
    let figures = Figures::of(results);
    let header = figures.header();
    lines.push(markdown_row(&header));
    let alignments: Vec<_> =
        header.iter().enumerate().map(|(at, _)| if at == 0 { "---" } else { "---:" }).collect();
    lines.push(markdown_row(&alignments));
    lines.extend(figures.plain_rows().iter().map(|row| markdown_row(row)));
    let calibrated: Vec<_> = figures::marked(results)
        .map(|calibrated| {
            let met = calibrated::figure(&calibrated.key, &results.calibrated);
            format!("`{}` = {} from {met}", calibrated.key, calibrated.value)
        })
        .collect();
    lines.push(String::new());
    if !calibrated.is_empty() {
        lines.push(format!(
            "- \\{CALIBRATED} calibrated on the paper's figure beside it, so no prediction: {}",
            calibrated.join(", ")
        ));
    }
    lines.extend(table::sentences(results).iter().map(|sentence| format!("- {}", escaped_marks(sentence))));
    lines.join("\n") + "\n"
}

/// Formats a test suite per type and a test case per repetition with its execution time, so that a CI server can draw
/// the trend.
fn junit(results: &Results, started: Option<&str>) -> String {
    // The format has no time zone: UTC.
    let timestamp = started.map_or_else(String::new, |started| {
        format!(" timestamp=\"{}\"", escaped(started.trim_end_matches('Z')))
    });
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let (mut tests, mut failures, mut seconds) = (0, 0, 0.0);
    let mut suites = String::new();
    for figures in results.figures() {
        let result = figures.result;
        let in_suite = result.samples_ms.len() + result.failed.len();
        let time = result.samples_ms.iter().fold(0.0, |sum, sample| sum + sample) / 1e3;
        let name = format!("skillbench.{}.{}", results.setup, label(figures.execution_type));
        let _ = writeln!(
            suites,
            r#"  <testsuite name="{}" tests="{in_suite}" failures="{}" errors="0" skipped="0" time="{time:.6}"{timestamp}>"#,
            escaped(&name),
            result.failed.len()
        );
        suites += &properties(results, &figures);
        // Samples are not numbered: they take the numbers that no failure has.
        let failed =
            |repetition: usize| result.failed.iter().find(|failed| failed.repetition as usize == repetition);
        let mut samples = result.samples_ms.iter();
        for repetition in 1..=in_suite {
            let case =
                format!(r#"    <testcase classname="{}" name="repetition {repetition}""#, escaped(&name));
            let _ = match failed(repetition) {
                Some(failed) => writeln!(
                    suites,
                    "{case} time=\"0.000000\">\n      <failure message=\"{0}\">{0}</failure>\n    </testcase>",
                    escaped(&failed.error)
                ),
                None => {
                    writeln!(
                        suites,
                        "{case} time=\"{:.6}\"/>",
                        samples.next().copied().unwrap_or_default() / 1e3
                    )
                }
            };
        }
        suites += "  </testsuite>\n";
        (tests, failures, seconds) = (tests + in_suite, failures + result.failed.len(), seconds + time);
    }
    let _ = writeln!(
        text,
        r#"<testsuites name="skillbench" tests="{tests}" failures="{failures}" time="{seconds:.6}"{timestamp}>"#
    );
    text + &suites + "</testsuites>\n"
}

/// Formats what was run and its figures, which a CI server shows beside a suite.
fn properties(results: &Results, figures: &TypeFigures<'_>) -> String {
    let millis = |value: Option<f64>| value.map(|value| rounded(value, 3).to_string());
    let properties = [
        ("setup", Some(results.setup.clone())),
        ("application", Some(results.application.clone())),
        ("mode", Some(results.mode.clone())),
        ("seed", Some(results.seed.to_string())),
        ("aet_ms", millis(figures.aet_ms)),
        ("mad_ms", millis(figures.mad_ms)),
        ("paper_aet_ms", millis(figures.paper.map(|paper| paper.aet_ms))),
        ("paper_mad_ms", millis(figures.paper.map(|paper| paper.mad_ms))),
        ("aet_calibrated", Some(figures.is_aet_calibrated.to_string())),
        ("mad_calibrated", Some(figures.is_mad_calibrated.to_string())),
    ];
    let mut text = String::from("    <properties>\n");
    for (name, value) in properties {
        if let Some(value) = value {
            let _ = writeln!(text, r#"      <property name="{name}" value="{}"/>"#, escaped(&value));
        }
    }
    text + "    </properties>\n"
}

/// Escapes text for XML, also in attributes. Characters that XML 1.0 does not allow become U+FFFD.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\n' => escaped += "&#10;",
            c if c.is_control() && c != '\t' => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use plc_node::ExecutionType;
    use records::results::Status;

    use records::conditions::Measured;
    use records::mode::Mode;
    use records::paper::PaperComparison;
    use records::schedule::Schedule;
    use std::time::Duration;

    fn results() -> Results {
        let setup = setup::setup("A").unwrap();
        let schedule = Schedule::new(&[ExecutionType::Rc, ExecutionType::Cm], 3, 7);
        let application = planning::application("pick-and-place", None).unwrap().application;
        let mut results = Results::new(&setup, "pick, place", Mode::Virtual, &schedule)
            .with_paper(&setup, PaperComparison::of(&setup, &application, None, &[]));
        for (repetition, micros) in [(1, 3_722_000), (2, 3_728_500)] {
            let mut measured = Measured::lasting(Duration::from_micros(micros));
            measured.execution.blends_suppressed = repetition;
            results.record(ExecutionType::Rc, &measured).unwrap();
        }
        results.record_failure(
            ExecutionType::Cm,
            1,
            "the <robot> said \"no\"\nand & stopped \u{1}".to_owned(),
        );
        results.status = Status::Failed;
        results
    }

    #[test]
    fn csv_has_a_line_per_type_and_empty_fields_for_missing_values() {
        insta::assert_snapshot!(csv(&results()), @r#"
        setup,application,mode,seed,type,runs,failed,aet_ms,mad_ms,min_ms,max_ms,blends_suppressed,paper_aet_ms,paper_mad_ms,aet_minus_paper_ms,aet_calibrated,mad_calibrated,h0_aet_ms,h0_mad_ms,aeti,h0_aeti
        A,"pick, place",virtual,7,rc,2,0,3725.25,3.25,3722,3728.5,3,3725,3.6,0.25,true,true,,,,
        A,"pick, place",virtual,7,cm,0,1,,,,,0,3729,3.3,,true,false,,,,
        "#);
    }

    #[test]
    fn markdown_contains_the_table_and_tells_if_the_run_did_not_complete() {
        insta::assert_snapshot!(markdown(&results()), @r#"
        ### Setup A: Siemens S7-1517, PROFINET, KUKA KR 6 R500 (SCARA)

        pick, place, 3 repetitions, virtual mode, seed 7, positions = set-points (a repetition failed)

        | ms | AET | MAD | n | paper AET | paper MAD | AET − paper |
        | --- | ---: | ---: | ---: | ---: | ---: | ---: |
        | RC | 3725.3\* | 3.3\* | 2 | 3725 | 3.6 | +0.3 (+0.01 %) |
        | CM | – | – | 0 | 3729 | 3.3 | – |
        | AETi | – |  |  | 42 % |  |  |

        - \* calibrated on the paper's figure beside it, so no prediction: `motions.velocity_percent` = 23.3 from RC's AET, `robot.interpreter_quantum_us` = 14000 from the MADs of RC and SM
        - CM's AET is RC's by construction, but for the one robot cycle of robot.continuous_start_cycles: the same motions by the same law, and one call each. The model predicts only that the PLC sends them in time.
        - 3 blends became stops, because the next motion was not there in time.
        - Cyclic frames of the PLC: 0 sent to the robot, 0 received from it; lost in both directions: 0.
        "#);
    }

    #[test]
    fn a_run_of_another_cell_has_no_columns_of_the_paper_and_says_why() {
        let reason = Some("the paper had no override".to_owned());
        let results = Results { paper: None, no_paper: reason, ..results() };
        assert!(csv(&results).contains(",3,,,,"), "{}", csv(&results));
        let markdown = markdown(&results);
        assert!(markdown.contains("\n- No columns of the paper: the paper had no override.\n"), "{markdown}");
        assert!(!markdown.contains("paper AET"), "{markdown}");
    }

    #[test]
    fn junit_has_a_case_per_repetition_and_escapes_the_errors() {
        insta::assert_snapshot!(junit(&results(), Some("2026-11-22T19:31:45Z")), @r#"
        <?xml version="1.0" encoding="UTF-8"?>
        <testsuites name="skillbench" tests="3" failures="1" time="7.450500" timestamp="2026-11-22T19:31:45">
          <testsuite name="skillbench.A.RC" tests="2" failures="0" errors="0" skipped="0" time="7.450500" timestamp="2026-11-22T19:31:45">
            <properties>
              <property name="setup" value="A"/>
              <property name="application" value="pick, place"/>
              <property name="mode" value="virtual"/>
              <property name="seed" value="7"/>
              <property name="aet_ms" value="3725.25"/>
              <property name="mad_ms" value="3.25"/>
              <property name="paper_aet_ms" value="3725"/>
              <property name="paper_mad_ms" value="3.6"/>
              <property name="aet_calibrated" value="true"/>
              <property name="mad_calibrated" value="true"/>
            </properties>
            <testcase classname="skillbench.A.RC" name="repetition 1" time="3.722000"/>
            <testcase classname="skillbench.A.RC" name="repetition 2" time="3.728500"/>
          </testsuite>
          <testsuite name="skillbench.A.CM" tests="1" failures="1" errors="0" skipped="0" time="0.000000" timestamp="2026-11-22T19:31:45">
            <properties>
              <property name="setup" value="A"/>
              <property name="application" value="pick, place"/>
              <property name="mode" value="virtual"/>
              <property name="seed" value="7"/>
              <property name="paper_aet_ms" value="3729"/>
              <property name="paper_mad_ms" value="3.3"/>
              <property name="aet_calibrated" value="true"/>
              <property name="mad_calibrated" value="false"/>
            </properties>
            <testcase classname="skillbench.A.CM" name="repetition 1" time="0.000000">
              <failure message="the &lt;robot&gt; said &quot;no&quot;&#10;and &amp; stopped �">the &lt;robot&gt; said &quot;no&quot;&#10;and &amp; stopped �</failure>
            </testcase>
          </testsuite>
        </testsuites>
        "#);
    }

    #[test]
    fn every_export_is_named_with_its_option() {
        let file = |name: &str| Some(PathBuf::from(name));
        let exports = Exports {
            json: file("json"),
            csv: file("csv"),
            markdown: file("markdown"),
            junit: file("junit"),
            started: None,
        };
        for (option, file) in exports.files() {
            assert_eq!(option, format!("--export-{}", file.unwrap().display()));
        }
        let exports = Exports::json("a".into());
        let [json, others @ ..] = exports.files();
        assert_eq!((json.1, others.map(|(_, file)| file)), (Some(Path::new("a")), [None; 3]));
    }
}
