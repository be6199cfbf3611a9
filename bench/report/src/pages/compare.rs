//! Comparison of runs: a table on screen, and a page with the samples on one axis.

use std::path::PathBuf;

use comfy_table::{Table, presets};
use node::screen;
use plc_node::ExecutionType;
use serde::Serialize;

use super::compared::{self, ComparedFigure, ComparisonExport, headlines};
use super::run::Run;
use super::samples;
use crate::figures::{millis, signed};
use crate::html::chart::colour;
use crate::html::document::fill;
use crate::html::figure::Figure;
use crate::progress::label;
use records::comparable::Conditions;
use records::exit::Failure;
use records::interval::Mean;
use records::results::Status;
use records::schedule::repetitions;

const TEMPLATE: &str = include_str!("compare.html");

/// A run, identified by a number.
#[derive(Serialize, Debug)]
struct Column {
    number: usize,
    name: String,
    about: String,
    /// AET, MAD and the difference to the first run's AET of each type, then AETi; as text.
    cells: Vec<String>,
    /// In what its conditions differ from those of the first run; `None` if they do not.
    differs: Option<String>,
}

#[derive(Serialize)]
struct Page<'a> {
    rows: Vec<&'static str>,
    columns: &'a [Column],
    notes: Vec<&'static str>,
    headlines: Vec<String>,
    figures: Vec<(String, Figure)>,
}

/// The rows of the comparison.
const ROWS: [&str; 10] = [
    "RC AET",
    "RC MAD",
    "RC AET − run 1",
    "SM AET",
    "SM MAD",
    "SM AET − run 1",
    "CM AET",
    "CM MAD",
    "CM AET − run 1",
    "AETi",
];

/// Several runs, compared with the first.
#[derive(Debug)]
pub struct Comparison {
    runs: Vec<Run>,
    columns: Vec<Column>,
    figures: Vec<ComparedFigure>,
}

impl Comparison {
    /// Reads the runs from their directories.
    ///
    /// # Errors
    ///
    /// A directory contains no run, or one whose saved figures were changed.
    pub fn load(directories: &[PathBuf]) -> Result<Self, Failure> {
        let runs = directories.iter().map(|path| Run::load(path)).collect::<Result<Vec<_>, _>>()?;
        let columns = columns(&runs);
        let differs: Vec<_> = columns.iter().map(|column| column.differs.clone()).collect();
        Ok(Self { figures: compared::compared(&runs, &differs), columns, runs })
    }

    /// Formats the table for the screen.
    #[must_use]
    pub fn table(&self) -> String {
        table(&self.columns, &headlines(&self.figures))
    }

    /// Formats a line for each type of each run as CSV.
    #[must_use]
    pub fn csv(&self) -> String {
        compared::csv(&self.figures)
    }

    /// Returns the figures of each type of each run, for JSON.
    #[must_use]
    pub fn figures(&self) -> impl Serialize {
        ComparisonExport::of(&self.figures)
    }

    /// Returns the page as HTML.
    ///
    /// # Errors
    ///
    /// A figure cannot be drawn.
    pub fn page(&self) -> anyhow::Result<String> {
        page(&self.runs, &self.columns, headlines(&self.figures))
    }
}

/// Differences of conditions that are named.
const NAMED: usize = 5;

/// Returns in what the conditions of a run differ from those of the first one.
fn differs(own: &Conditions, first: &Conditions) -> Option<String> {
    let mut differences = own.differences((first, "in run 1"));
    let more = differences.len().saturating_sub(NAMED);
    differences.truncate(NAMED);
    if more > 0 {
        differences.push(format!("and {more} more"));
    }
    (!differences.is_empty()).then(|| differences.join("; "))
}

/// The difference of a run's AET and that of the first run.
enum ShownDifference {
    /// With its confidence interval.
    Known(Mean),
    /// A run has too few samples for an interval, in ms.
    Open(f64),
}

impl ShownDifference {
    fn of(run: &Run, first: &Run, execution_type: ExecutionType) -> Option<Self> {
        let samples =
            |run: &Run| run.results.results.get(execution_type).map(|result| result.samples_ms.clone());
        let means = Mean::of(&samples(run)?).zip(Mean::of(&samples(first)?));
        let aet_ms = |run: &Run| run.results.figure(execution_type).map(|figure| figure.aet_ms);
        let ms = aet_ms(run)? - aet_ms(first)?;
        Some(means.map_or(Self::Open(ms), |(own, first)| Self::Known(own.less(first))))
    }

    fn text(&self) -> String {
        match self {
            Self::Known(mean) => format!("{} ± {}", signed(mean.ms), millis(mean.margin_ms())),
            Self::Open(ms) => format!("{} ± ?", signed(*ms)),
        }
    }
}

/// Returns what the differences mean.
fn notes(columns: &[Column]) -> Vec<&'static str> {
    let cells = || columns.iter().flat_map(|column| &column.cells);
    let is_open = |cell: &String| cell.ends_with('?');
    let has_open = cells().any(is_open);
    let has_known = cells().any(|cell| cell.contains('±') && !is_open(cell));
    let known = "± is half the 95 % interval of a difference, by Welch's method: a difference smaller than that may be chance.";
    let open = "± ? marks a difference without an interval, which takes five repetitions in both runs: it may be chance.";
    has_known.then_some(known).into_iter().chain(has_open.then_some(open)).collect()
}

fn columns(runs: &[Run]) -> Vec<Column> {
    let conditions: Vec<_> = runs.iter().map(|run| Conditions::of(&run.directory, &run.results)).collect();
    let column = |(index, run): (usize, &Run)| {
        let millis = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"));
        let mut cells = Vec::new();
        for execution_type in ExecutionType::ALL {
            let figures = run.results.type_figures(execution_type);
            let aet_ms = figures.and_then(|figures| figures.aet_ms);
            let first_run = runs.first().filter(|_| index > 0);
            let difference = first_run.and_then(|first| ShownDifference::of(run, first, execution_type));
            cells.push(millis(aet_ms));
            cells.push(millis(figures.and_then(|figures| figures.mad_ms)));
            cells.push(difference.map_or_else(String::new, |difference| difference.text()));
        }
        let share = run.results.aet_improvement;
        cells.push(
            share.map_or_else(|| "–".to_owned(), |share| format!("{:.1} %", share * 100.0).replace('-', "−")),
        );
        let ended = match run.results.status {
            Status::Complete => "",
            Status::Running => ", not finished",
            Status::Failed => ", failed",
            Status::Interrupted => ", interrupted",
        };
        let commit = run.host("commit").map_or_else(String::new, |commit| format!(", commit {commit}"));
        let incomplete = if run.incomplete().is_some() { ", records incomplete" } else { "" };
        let results = &run.results;
        let older = if results.is_of_older_version() { ", written by an older version" } else { "" };
        let other = results.no_paper.as_ref();
        let other = other.map_or_else(String::new, |reason| format!("; not the paper's cell: {reason}"));
        let about = format!(
            "setup {}, {}, {}, {}, {}{commit}{ended}{incomplete}{older}{other}",
            results.setup,
            results.application,
            results.mode_in_words(),
            repetitions(results.reps),
            results.conditions(", ")
        );
        let differs =
            conditions.first().zip(conditions.get(index)).and_then(|(first, own)| differs(own, first));
        Column { number: index + 1, name: run.name(), about, cells, differs }
    };
    runs.iter().enumerate().map(column).collect()
}

fn table(columns: &[Column], headlines: &[String]) -> String {
    let mut table = Table::new();
    table.load_preset(presets::NOTHING);
    table.set_header(
        std::iter::once("ms".to_owned()).chain(columns.iter().map(|column| format!("run {}", column.number))),
    );
    for (index, row) in ROWS.iter().enumerate() {
        let cells = columns.iter().map(|column| column.cells.get(index).cloned().unwrap_or_default());
        table.add_row(std::iter::once((*row).to_owned()).chain(cells));
    }
    let runs = columns.iter().map(|Column { number, name, about, differs, .. }| {
        let run = screen::wrapped(&format!("run {number}: {name} ({about})"), 0, 4) + "\n";
        let differs = differs.as_ref().map(|differs| {
            screen::wrapped(&format!("not under the conditions of run 1: {differs}"), 4, 4) + "\n"
        });
        run + &differs.unwrap_or_default()
    });
    let notes = notes(columns).into_iter().map(|note| format!("\n{}", screen::wrapped(note, 0, 0)));
    let headlines = headlines.iter().map(|headline| screen::wrapped(headline, 0, 0) + "\n");
    format!(
        "{}\n{}\n{}{}",
        runs.collect::<String>(),
        headlines.collect::<String>(),
        screen::drawn(&screen::numbers_right(table)),
        notes.collect::<String>()
    )
}

fn page(runs: &[Run], columns: &[Column], headlines: Vec<String>) -> anyhow::Result<String> {
    let mut figures = Vec::new();
    for execution_type in ExecutionType::ALL {
        let first =
            runs.first().and_then(|first| first.results.figure(execution_type)).map(|figure| figure.aet_ms);
        let row = |(index, run): (usize, &Run)| {
            let (figure, result) =
                (run.results.figure(execution_type)?, run.results.results.get(execution_type)?);
            Some(samples::Row {
                name: (index + 1).to_string(),
                about: format!(
                    "{:.1} ms, MAD {:.1} ms, n = {}",
                    figure.aet_ms,
                    figure.mad_ms,
                    result.samples_ms.len()
                ),
                colour: colour(execution_type),
                samples: result.samples_ms.iter().map(|sample| sample - first.unwrap_or(0.0)).collect(),
            })
        };
        let rows: Vec<_> = runs.iter().enumerate().filter_map(row).collect();
        let title =
            if first.is_some() { "execution time minus run 1's AET, in ms" } else { "execution time in ms" };
        let drawn =
            Figure::draw("Samples of the runs on one axis", |format| samples::draw(&rows, title, format))?;
        let data = || samples::data(&rows);
        figures.extend(drawn.map(|figure| (label(execution_type), figure.with(data()))));
    }
    let page = Page { rows: ROWS.to_vec(), notes: notes(columns), headlines, columns, figures };
    fill(TEMPLATE, &page)
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::conditions::Measured;
    use records::mode::Mode;
    use records::results::Results;
    use records::run_directory::{Durability, RunDirectory};
    use records::schedule::Schedule;
    use setup::Setup;
    use std::path::Path;
    use std::time::Duration;

    /// Stores a run of CM with these execution times in ms and returns its directory.
    fn keep(place: &Path, name: &str, setup: &Setup, mode: Mode, samples_ms: &[u64]) -> PathBuf {
        let (_, found) = planning::setup_with_application("A").unwrap();
        let path = place.join(name);
        let mut directory =
            RunDirectory::create(&path, setup, &found.text, None, Durability::Written).unwrap();
        let schedule = Schedule::new(&[ExecutionType::Cm], samples_ms.len() as u32, 1);
        let mut results = Results::new(setup, &found.application.name, mode, &schedule);
        for (step, millis) in schedule.steps().zip(samples_ms) {
            let measured = Measured::lasting(Duration::from_millis(*millis));
            results.record(ExecutionType::Cm, &measured).unwrap();
            directory.save(&step, &Ok(measured), &results).unwrap();
        }
        results.status = Status::Complete;
        directory.save_results(&results).unwrap();
        path
    }

    fn compared(directories: &[PathBuf]) -> Comparison {
        Comparison::load(directories).unwrap()
    }

    #[test]
    fn a_difference_has_its_interval_from_five_repetitions_on_and_is_open_before() {
        let place = tempfile::tempdir().unwrap();
        let setup = setup::setup("A").unwrap();
        let keep = |name, samples| keep(place.path(), name, &setup, Mode::Virtual, samples);
        let runs = [
            keep("first", &[3_718, 3_719, 3_720, 3_721, 3_722]),
            keep("later", &[3_728, 3_729, 3_730, 3_731, 3_732]),
            keep("short", &[3_721]),
        ];
        let table = compared(&runs).table();
        let row = table.lines().find(|line| line.trim().starts_with("CM AET − run 1")).unwrap();
        let cells: Vec<_> = row.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).collect();
        // Each standard error is √0.5 ms; 2.31 times √1 is the margin at eight degrees of freedom.
        assert_eq!(cells, ["CM AET − run 1", "+10.0 ± 2.3", "+1.0 ± ?"]);
        let notes: String = table.lines().skip_while(|line| !line.starts_with('±')).collect();
        assert!(notes.contains("95 % interval of a difference") && notes.contains("± ? marks a"), "{table}");
        let alone = compared(&runs[..2]).page().unwrap();
        assert!(alone.contains("+10.0 ± 2.3") && !alone.contains("± ?"));
    }

    #[test]
    fn a_run_under_other_conditions_says_which_on_screen_and_on_the_page() {
        let place = tempfile::tempdir().unwrap();
        let setup = setup::setup("A").unwrap();
        let mut exact = setup.clone();
        exact.motions.approximation_mm.value = 0.0;
        exact.title = "without blending".to_owned();
        let keep = |name, setup, mode| keep(place.path(), name, setup, mode, &[3_720; 5]);
        let runs = [
            keep("first", &setup, Mode::Virtual),
            keep("same", &setup, Mode::Virtual),
            keep("exact", &exact, Mode::Virtual),
            keep("other", &setup::setup("B").unwrap(), Mode::Real),
            keep("task", &setup, Mode::Virtual),
        ];
        for (file, from, to) in [
            ("results.json", "pick-and-place", "my-task"),
            ("application.toml", "name = \"pick-and-place\"", "name = \"my-task\""),
            ("application.toml", "clearance_mm = 8.0", "clearance_mm = 9.0"),
        ] {
            let path = place.path().join("task").join(file);
            let content = std::fs::read_to_string(&path).unwrap();
            assert!(content.contains(from), "{file}: {from}");
            std::fs::write(&path, content.replace(from, to)).unwrap();
        }
        let comparison = compared(&runs);
        let differs: Vec<_> = comparison.columns.iter().map(|column| &column.differs).collect();
        let text = |index: usize| differs[index].clone().unwrap_or_default();
        assert_eq!([text(0), text(1)], ["", ""]);
        insta::assert_snapshot!(text(2), @"motions.approximation_mm is 0.0, in run 1 10.0");
        insta::assert_snapshot!(text(3), @r#"setup B, in run 1 A; mode real, in run 1 virtual; bus.kind is "ethernet-ip", in run 1 "profinet"; bus.watchdog_cycles is 512, in run 1 500; bus.cable_delay_us is 27, in run 1 25; and 27 more"#);
        insta::assert_snapshot!(text(4), @"application my-task, in run 1 pick-and-place");
        let table = comparison.table();
        let line = "    not under the conditions of run 1: motions.approximation_mm is 0.0, in run 1 10.0";
        assert!(table.lines().any(|shown| shown == line), "{table}");
        assert!(table.contains("run 1: first (setup A, pick-and-place, virtual mode, "), "{table}");
        let page = comparison.page().unwrap();
        assert!(
            page.contains(
                "Not under the conditions of run 1: motions.approximation_mm is 0.0, in run 1 10.0."
            )
        );
    }
}
