//! The results in formats of other programs. Each file is replaced as a whole after every repetition, so that an
//! interrupted run keeps its results.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use plc_node::ExecutionType;

use crate::output::progress::label;
use crate::records::results::{Results, Status, TypeResult};
use crate::records::run_directory::{Durability, replace};
use crate::records::statistics::aet_improvement;

/// Which files to write besides the run directory.
#[derive(Args, Clone, Debug, Default)]
pub struct Exports {
    /// Write the results to this file as well, as JSON; bench/schemas/results.schema.json says what is in it.
    #[arg(long = "export-json", value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write AET, MAD and their neighbours to this file, as CSV with a line a type; each repetition is a line of
    /// DIR/samples.csv.
    #[arg(long = "export-csv", value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write the table to this file, as Markdown.
    #[arg(long = "export-markdown", value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Write the repetitions to this file, as JUnit XML: a suite a type, a case a repetition.
    #[arg(long = "export-junit", value_name = "FILE")]
    junit: Option<PathBuf>,
}

impl Exports {
    /// Exports only JSON, to this file.
    #[must_use]
    pub fn json(path: PathBuf) -> Self {
        Self { json: Some(path), ..Self::default() }
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
        write(&self.junit, &|| Ok(junit(results)))
    }

    /// Returns a file that two exports would write, to refuse it before the run.
    #[must_use]
    pub fn written_twice(&self) -> Option<&Path> {
        let files: Vec<_> =
            [&self.json, &self.csv, &self.markdown, &self.junit].into_iter().flatten().collect();
        files
            .iter()
            .enumerate()
            .find(|(index, file)| files[..*index].contains(file))
            .map(|(_, file)| file.as_path())
    }
}

/// Returns the requested types, in the paper's order.
fn types(results: &Results) -> impl Iterator<Item = (ExecutionType, &TypeResult)> {
    ExecutionType::ALL
        .into_iter()
        .filter_map(|execution_type| Some((execution_type, results.results.get(execution_type)?)))
}

/// Formats a line per type. Missing values are empty.
fn csv(results: &Results) -> String {
    let mut text = String::from(
        "setup,application,mode,seed,type,runs,failed,aet_ms,mad_ms,min_ms,max_ms,blends_suppressed,paper_aet_ms,paper_mad_ms\n",
    );
    for (execution_type, result) in types(results) {
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let paper = results.paper.as_ref().and_then(|paper| paper.get(execution_type));
        let fields = [
            quoted(&results.setup),
            quoted(&results.application),
            results.mode.clone(),
            results.seed.to_string(),
            execution_type.to_string(),
            result.samples_ms.len().to_string(),
            result.failed.len().to_string(),
            number(result.aet_ms),
            number(result.mad_ms),
            number(result.samples_ms.iter().copied().reduce(f64::min)),
            number(result.samples_ms.iter().copied().reduce(f64::max)),
            result.blends_suppressed.iter().sum::<u32>().to_string(),
            number(paper.map(|paper| paper.aet_ms)),
            number(paper.map(|paper| paper.mad_ms)),
        ];
        text += &fields.join(",");
        text.push('\n');
    }
    text
}

/// Formats a field of a CSV file, in quotes if necessary (RFC 4180).
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

/// Formats a heading and the table.
fn markdown(results: &Results) -> String {
    let Results { setup, title, application, mode, seed, .. } = results;
    let mut lines = vec![
        format!("### Setup {setup}: {title}"),
        String::new(),
        format!("{application}, {mode} mode, seed {seed}{}", unfinished(results.status)),
        String::new(),
    ];
    let has_paper = results.paper.is_some();
    lines.push(row("", ["AET in ms", "MAD in ms", "n"], has_paper.then_some(["paper AET", "paper MAD"])));
    lines.push(row("---", ["---:"; 3], has_paper.then_some(["---:"; 2])));
    let millis = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"));
    for (execution_type, result) in types(results) {
        let own = [millis(result.aet_ms), millis(result.mad_ms), result.samples_ms.len().to_string()];
        let paper = results.paper.as_ref().map(|paper| {
            let paper = paper.get(execution_type);
            [millis(paper.map(|paper| paper.aet_ms)), millis(paper.map(|paper| paper.mad_ms))]
        });
        lines.push(row(&label(execution_type), own, paper));
    }
    let percent =
        |share: Option<f64>| share.map_or_else(|| "–".to_owned(), |share| format!("{:.1} %", share * 100.0));
    let paper = results.paper.as_ref().map(|paper| {
        let share = paper.sm.zip(paper.cm).map(|(sm, cm)| aet_improvement(sm.aet_ms, cm.aet_ms));
        [percent(share), String::new()]
    });
    lines.push(row("AETi", [percent(results.aet_improvement), String::new(), String::new()], paper));
    if let Some(reason) = &results.no_paper {
        lines.extend([String::new(), format!("No columns of the paper: {reason}.")]);
    }
    lines.join("\n") + "\n"
}

fn row<T: AsRef<str>, const N: usize>(first: &str, own: [T; N], paper: Option<[T; 2]>) -> String {
    let cells = own.iter().chain(paper.iter().flatten()).map(AsRef::as_ref);
    let cells: Vec<_> = std::iter::once(first).chain(cells).collect();
    format!("| {} |", cells.join(" | "))
}

const fn unfinished(status: Status) -> &'static str {
    match status {
        Status::Complete => "",
        Status::Running => " (not finished)",
        Status::Failed => " (a repetition failed)",
        Status::Interrupted => " (interrupted)",
    }
}

/// Formats a test suite per type and a test case per repetition with its execution time, so that a CI server can draw
/// the trend.
fn junit(results: &Results) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let (mut tests, mut failures, mut seconds) = (0, 0, 0.0);
    let mut suites = String::new();
    for (execution_type, result) in types(results) {
        let in_suite = result.samples_ms.len() + result.failed.len();
        let time = result.samples_ms.iter().fold(0.0, |sum, sample| sum + sample) / 1e3;
        let name = format!("skillbench.{}.{}", results.setup, label(execution_type));
        let _ = writeln!(
            suites,
            r#"  <testsuite name="{}" tests="{in_suite}" failures="{}" errors="0" skipped="0" time="{time:.6}">"#,
            escaped(&name),
            result.failed.len()
        );
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
                    "{case}>\n      <failure message=\"{0}\">{0}</failure>\n    </testcase>",
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
        r#"<testsuites name="skillbench" tests="{tests}" failures="{failures}" time="{seconds:.6}">"#
    );
    text + &suites + "</testsuites>\n"
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
    use crate::records::conditions::Measured;
    use crate::records::mode::Mode;
    use crate::records::paper::Standing;
    use crate::records::schedule::Schedule;
    use std::time::Duration;

    fn results() -> Results {
        let setup = setup::setup("A").unwrap();
        let schedule = Schedule::new(&[ExecutionType::Rc, ExecutionType::Cm], 3, 7);
        let application = planning::application("pick-and-place", None).unwrap().application;
        let mut results = Results::new(&setup, "pick, place", Mode::Virtual, &schedule)
            .beside_the_paper(&setup, Standing::of(&setup, &application, None, &[]));
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
        setup,application,mode,seed,type,runs,failed,aet_ms,mad_ms,min_ms,max_ms,blends_suppressed,paper_aet_ms,paper_mad_ms
        A,"pick, place",virtual,7,rc,2,0,3725.25,3.25,3722,3728.5,3,3725,3.6
        A,"pick, place",virtual,7,cm,0,1,,,,,0,3729,3.3
        "#);
    }

    #[test]
    fn markdown_contains_the_table_and_tells_if_the_run_did_not_complete() {
        insta::assert_snapshot!(markdown(&results()), @"
        ### Setup A: Siemens S7-1517, PROFINET, KUKA KR 6 R500 (SCARA)

        pick, place, virtual mode, seed 7 (a repetition failed)

        |  | AET in ms | MAD in ms | n | paper AET | paper MAD |
        | --- | ---: | ---: | ---: | ---: | ---: |
        | RC | 3725.2 | 3.2 | 2 | 3725.0 | 3.6 |
        | CM | – | – | 0 | 3729.0 | 3.3 |
        | AETi | – |  |  | 42.4 % |  |
        ");
    }

    #[test]
    fn a_run_of_another_cell_has_no_columns_of_the_paper_and_says_why() {
        let reason = Some("the paper had no override".to_owned());
        let results = Results { paper: None, no_paper: reason, ..results() };
        assert!(csv(&results).contains(",3,,\n"), "{}", csv(&results));
        let markdown = markdown(&results);
        assert!(
            markdown.ends_with("\n\nNo columns of the paper: the paper had no override.\n"),
            "{markdown}"
        );
        assert!(!markdown.contains("paper AET"), "{markdown}");
    }

    #[test]
    fn junit_has_a_case_per_repetition_and_escapes_the_errors() {
        insta::assert_snapshot!(junit(&results()), @r#"
        <?xml version="1.0" encoding="UTF-8"?>
        <testsuites name="skillbench" tests="3" failures="1" time="7.450500">
          <testsuite name="skillbench.A.RC" tests="2" failures="0" errors="0" skipped="0" time="7.450500">
            <testcase classname="skillbench.A.RC" name="repetition 1" time="3.722000"/>
            <testcase classname="skillbench.A.RC" name="repetition 2" time="3.728500"/>
          </testsuite>
          <testsuite name="skillbench.A.CM" tests="1" failures="1" errors="0" skipped="0" time="0.000000">
            <testcase classname="skillbench.A.CM" name="repetition 1">
              <failure message="the &lt;robot&gt; said &quot;no&quot;&#10;and &amp; stopped �">the &lt;robot&gt; said &quot;no&quot;&#10;and &amp; stopped �</failure>
            </testcase>
          </testsuite>
        </testsuites>
        "#);
    }

    #[test]
    fn two_exports_to_one_file_are_found() {
        let exports = Exports { csv: Some("a".into()), junit: Some("a".into()), ..Exports::default() };
        assert_eq!(exports.written_twice(), Some(Path::new("a")));
        assert_eq!(Exports::json("a".into()).written_twice(), None);
    }
}
