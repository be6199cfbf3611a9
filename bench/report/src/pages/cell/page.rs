//! The report of a cell as HTML.

use plc_node::ExecutionType;
use serde::Serialize;

use super::arms;
use crate::cell_table;
use crate::html::document::fill;
use crate::html::figure::Figure;
use crate::pages::cell_run::CellFiles;
use crate::pages::race;
use crate::progress::label;
use records::cell_results::{CellResults, CellTypeResult};
use records::results::Status;

const TEMPLATE: &str = include_str!("cell.html");

#[derive(Serialize)]
struct CellReport<'a> {
    name: String,
    title: &'a str,
    about: String,
    conditions: Vec<String>,
    ended: Option<&'static str>,
    types: Vec<String>,
    /// A name, and a cell for each type.
    rows: Vec<(String, Vec<String>)>,
    marks: Vec<(String, Vec<String>)>,
    gains: Vec<[String; 4]>,
    remaining: Option<String>,
    arms: Option<Figure>,
    race: Option<&'static str>,
    failed: Vec<String>,
    missing: Vec<String>,
}

/// Returns the report; `has_race` says that the race lies beside it.
pub(super) fn render(files: &CellFiles, has_race: bool) -> anyhow::Result<String> {
    let results = &files.results;
    let drawn = Figure::draw("When each arm moves and waits in the first repetitions", |format| {
        arms::draw(results, &files.trace, format)
    })?;
    let is_recorded = !files.trace.stations.is_empty();
    let (gains, remaining) = gains(results);
    let page = CellReport {
        name: files.name(),
        title: &results.title,
        about: files.about(),
        conditions: cell_table::conditions(results),
        ended: match results.status {
            Status::Complete => None,
            Status::Running => Some("The run is not finished."),
            Status::Failed => Some("The run failed."),
            Status::Interrupted => Some("The run was interrupted."),
        },
        types: types(results).map(|(one, _)| label(one)).collect(),
        rows: rows(results),
        marks: marks(results),
        gains,
        remaining,
        arms: drawn.map(|figure| figure.with(arms::data(results, &files.trace))),
        race: (has_race && is_recorded).then_some(race::FILE),
        failed: failed(results),
        missing: files.lacks(),
    };
    fill(TEMPLATE, &page)
}

fn types(results: &CellResults) -> impl Iterator<Item = (ExecutionType, &CellTypeResult)> {
    ExecutionType::ALL.into_iter().filter_map(|one| Some((one, results.results.get(one)?)))
}

fn shown(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"))
}

fn rows(results: &CellResults) -> Vec<(String, Vec<String>)> {
    let row = |name: &str, cell: &dyn Fn(&CellTypeResult) -> String| {
        (name.to_owned(), types(results).map(|(_, result)| cell(result)).collect())
    };
    let millis = |micros: Option<f64>| shown(micros.map(|micros| micros / 1e3), 2);
    let mut rows = vec![
        row("AET, ms", &|result| shown(result.aet_ms, 1)),
        row("MAD, ms", &|result| shown(result.mad_ms, 1)),
        row("repetitions", &|result| result.samples_ms.len().to_string()),
    ];
    for (index, station) in results.stations.iter().enumerate() {
        rows.push(row(&format!("{} waits, ms", station.name), &|result| {
            shown(result.stations.get(index).and_then(|station| station.mean_waiting_ms()), 1)
        }));
    }
    for (index, station) in results.stations.iter().enumerate().filter(|_| cell_table::has_zones(results)) {
        rows.push(row(&format!("{} waits before zones, ms", station.name), &|result| {
            shown(result.stations.get(index).and_then(|station| station.mean_zone_waiting_ms()), 1)
        }));
    }
    rows.push(row("start skew, ms", &|result| millis(result.mean_start_skew_us())));
    rows.push(row("longest skew at a mark, ms", &|result| millis(result.worst_mark_skew_us())));
    rows.push(row("relative pose off, mm", &|result| shown(result.worst_relative_pose_mm(), 3)));
    rows
}

/// Returns each mark and the mean skew there.
fn marks(results: &CellResults) -> Vec<(String, Vec<String>)> {
    let skew = |result: &CellTypeResult, mark: u32| {
        let all: Vec<f64> =
            result.marks.iter().filter(|it| it.mark == mark).flat_map(|it| it.skew_us.clone()).collect();
        shown((!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64 / 1e3), 2)
    };
    let row = |mark: &records::cell_results::CellMark| {
        let together = if mark.together { ", together from here" } else { "" };
        let name = format!("{} {}{together}", mark.number, mark.name);
        (name, types(results).map(|(_, result)| skew(result, mark.number)).collect())
    };
    results.marks.iter().map(row).collect()
}

/// Returns what CM gains over SM, for the cell and for each arm alone, and a sentence on what of it remains.
fn gains(results: &CellResults) -> (Vec<[String; 4]>, Option<String>) {
    let percent = |share: f64| format!("{:.1} %", share * 100.0);
    let gain = |share: Option<f64>| share.map_or_else(|| "–".to_owned(), percent);
    let aet = |one| shown(results.results.get(one).and_then(|result| result.aet_ms), 1);
    let mut rows = vec![[
        "all arms".to_owned(),
        aet(ExecutionType::Sm),
        aet(ExecutionType::Cm),
        gain(results.aet_improvement),
    ]];
    for station in &results.stations {
        let Some(alone) = &station.alone else { continue };
        let aet = |one| shown(alone.results.get(one).map(|figure| figure.aet_ms), 1);
        rows.push([
            format!("{} alone", station.name),
            aet(ExecutionType::Sm),
            aet(ExecutionType::Cm),
            gain(alone.aet_improvement),
        ]);
    }
    let remaining = results.remaining_gain().map(|share| {
        format!("Where the arms meet, {} of the mean gain of each arm alone remains.", percent(share))
    });
    (rows, remaining)
}

fn failed(results: &CellResults) -> Vec<String> {
    let of_type = |(one, result): (ExecutionType, &CellTypeResult)| {
        let line = move |failed: &records::results::FailedRepetition| {
            format!("{} {}: {}", label(one), failed.repetition, failed.error)
        };
        let names: Vec<_> = results.stations.iter().map(|station| station.name.as_str()).collect();
        let stops = result
            .stops
            .iter()
            .map(|stop| format!("{} {}: {}", label(one), stop.repetition, stop.sentence(&names)));
        result.failed.iter().map(line).chain(stops).collect::<Vec<_>>()
    };
    types(results).flat_map(of_type).collect()
}
