//! Comparison of runs: a table on screen, and a page with the samples on one axis.

use std::path::PathBuf;

use comfy_table::{Table, presets};
use node::screen;
use plc_node::ExecutionType;
use serde::Serialize;

use super::run::Run;
use super::samples;
use crate::output::exit::Failure;
use crate::output::html::chart::colour;
use crate::output::html::document::fill;
use crate::output::html::figure::Figure;
use crate::output::progress::label;
use crate::records::results::Status;
use crate::records::schedule::repetitions;

const TEMPLATE: &str = include_str!("compare.html");

/// A run, identified by a number.
#[derive(Serialize)]
struct Column {
    number: usize,
    name: String,
    about: String,
    /// AET, MAD and the difference to the first run's AET of each type, then AETi; as text.
    cells: Vec<String>,
}

#[derive(Serialize)]
struct Page {
    rows: Vec<&'static str>,
    columns: Vec<Column>,
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
}

impl Comparison {
    /// Reads the runs from their directories.
    ///
    /// # Errors
    ///
    /// A directory contains no run.
    pub fn load(directories: &[PathBuf]) -> Result<Self, Failure> {
        Ok(Self { runs: directories.iter().map(|path| Run::load(path)).collect::<Result<_, _>>()? })
    }

    /// Formats the table for the screen.
    #[must_use]
    pub fn table(&self) -> String {
        table(&columns(&self.runs))
    }

    /// Returns the page as HTML.
    ///
    /// # Errors
    ///
    /// A figure cannot be drawn.
    pub fn page(&self) -> anyhow::Result<String> {
        page(&self.runs, columns(&self.runs))
    }
}

fn columns(runs: &[Run]) -> Vec<Column> {
    let column = |(index, run): (usize, &Run)| {
        let millis = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"));
        let mut cells = Vec::new();
        for execution_type in ExecutionType::ALL {
            let figures = run.results.type_figures(execution_type);
            let aet_ms = figures.and_then(|figures| figures.aet_ms);
            let first = runs.first().and_then(|first| first.results.figure(execution_type));
            let difference = aet_ms.zip(first).filter(|_| index > 0);
            cells.push(millis(aet_ms));
            cells.push(millis(figures.and_then(|figures| figures.mad_ms)));
            cells.push(difference.map_or_else(String::new, |(aet_ms, first)| {
                format!("{:+.1}", aet_ms - first.aet_ms).replace('-', "−")
            }));
        }
        let share = run.results.aet_improvement;
        cells.push(share.map_or_else(|| "–".to_owned(), |share| format!("{:.1} %", share * 100.0)));
        let ended = match run.results.status {
            Status::Complete => "",
            Status::Running => ", not finished",
            Status::Failed => ", failed",
            Status::Interrupted => ", interrupted",
        };
        let commit = run.host("commit").map_or_else(String::new, |commit| format!(", commit {commit}"));
        let incomplete = if run.incomplete().is_some() { ", records incomplete" } else { "" };
        let results = &run.results;
        let other = results.no_paper.as_ref();
        let other = other.map_or_else(String::new, |reason| format!("; not the paper's cell: {reason}"));
        let about = format!(
            "setup {}, {} mode, {}, {}{commit}{ended}{incomplete}{other}",
            results.setup,
            results.mode,
            repetitions(results.reps),
            results.seed_and_override(", ")
        );
        Column { number: index + 1, name: run.name(), about, cells }
    };
    runs.iter().enumerate().map(column).collect()
}

fn table(columns: &[Column]) -> String {
    let mut table = Table::new();
    table.load_preset(presets::NOTHING);
    table.set_header(
        std::iter::once("ms".to_owned()).chain(columns.iter().map(|column| format!("run {}", column.number))),
    );
    for (index, row) in ROWS.iter().enumerate() {
        let cells = columns.iter().map(|column| column.cells.get(index).cloned().unwrap_or_default());
        table.add_row(std::iter::once((*row).to_owned()).chain(cells));
    }
    let runs = columns.iter().map(|Column { number, name, about, .. }| {
        screen::wrapped(&format!("run {number}: {name} ({about})"), 0, 4) + "\n"
    });
    format!("{}\n{}", runs.collect::<String>(), screen::drawn(&screen::numbers_right(table)))
}

fn page(runs: &[Run], columns: Vec<Column>) -> anyhow::Result<String> {
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
    let page = Page { rows: ROWS.to_vec(), columns, figures };
    fill(TEMPLATE, &page)
}
