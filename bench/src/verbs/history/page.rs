//! The page of the list: for each setup, application and mode the figures over the runs, and where they changed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use plc_node::ExecutionType;
use serde::Serialize;

use super::chart::{self, Run};
use super::{Entry, History, link};
use records::counted::counted;
use report::figures::signed;
use report::html::document::fill;
use report::html::figure::Figure;
use report::pages;
use report::progress::label;

const TEMPLATE: &str = include_str!("page.html");

const NONE: &str = "–";

#[derive(Serialize)]
struct HistoryPage {
    directory: String,
    conditions: Option<String>,
    summary: String,
    sections: Vec<HistorySection>,
    hosts: Vec<String>,
    unreadable: Vec<String>,
}

/// The runs of one setup, application and mode.
#[derive(Serialize)]
struct HistorySection {
    id: String,
    title: String,
    about: String,
    figure: Option<Figure>,
    /// Which runs the figure shows, if not all.
    shown: Option<String>,
    /// Newest first.
    changes: Vec<String>,
    rows: Vec<HistoryRow>,
}

#[derive(Serialize)]
struct HistoryRow {
    number: usize,
    name: String,
    /// Address of the report; none if there is no report.
    report: Option<String>,
    made: String,
    /// What is special about the run.
    notes: Vec<String>,
    cells: Vec<Cell>,
    improvement: String,
    ended: String,
    is_complete: bool,
}

#[derive(Serialize)]
struct Cell {
    name: String,
    aet: String,
    /// MAD and number of repetitions; none without repetitions.
    spread: Option<String>,
    change: Option<String>,
}

/// Returns the page as HTML; `path` is where it will be, `directory` holds the runs.
///
/// # Errors
///
/// The template or a figure is broken.
pub(super) fn page(history: &History, directory: &Path, path: &Path) -> anyhow::Result<String> {
    let mut kinds: BTreeMap<[&str; 3], Vec<&Entry>> = BTreeMap::new();
    for entry in &history.entries {
        kinds.entry([&entry.setup, &entry.application, &entry.mode]).or_default().push(entry);
    }
    let hosts: BTreeSet<&str> = history.entries.iter().filter_map(|entry| entry.host.as_deref()).collect();
    let hosts: Vec<String> = hosts.into_iter().map(str::to_owned).collect();
    let sections = kinds.into_iter().enumerate().map(|(index, (kind, entries))| {
        let report = |entry: &Entry| link::from_page(path, &directory.join(&entry.run).join(pages::FILE));
        section(index, kind, &entries, &hosts, &report)
    });
    let dates: Vec<_> = history.entries.iter().filter_map(|entry| entry.date.as_deref()).collect();
    let span = dates.first().zip(dates.last());
    let page = HistoryPage {
        directory: directory.display().to_string(),
        conditions: span.map(|(first, last)| format!("{} to {}", readable(first), readable(last))),
        summary: summary(history),
        sections: sections.collect::<anyhow::Result<_>>()?,
        hosts,
        unreadable: history.unreadable.clone(),
    };
    fill(TEMPLATE, &page)
}

/// Formats a date of ISO 8601 for reading.
fn readable(date: &str) -> String {
    date.replace('T', " ").replace('Z', " UTC")
}

fn summary(history: &History) -> String {
    if let Some(reason) = &history.is_empty_because {
        return reason.clone();
    }
    let all = counted(history.entries.len(), "run");
    let changed: Vec<_> = history.entries.iter().filter(|entry| !changes(entry).is_empty()).collect();
    match changed.last() {
        None => {
            let compared = history.entries.iter().filter(|entry| entry.is_compared()).count();
            let others =
                history.entries.iter().filter(|entry| !entry.is_compared() && entry.differs.is_some());
            match (compared, others.count()) {
                (0, 0) => {
                    format!("{all}. None can be compared: a change takes two runs under the same conditions.")
                }
                (0, _) => format!("{all}. None can be compared: their conditions differ."),
                (_, 0) => format!("{all}. No AET changed by more than the 95\u{a0}% intervals allow."),
                (_, others) => format!(
                    "{all}. No AET changed by more than the 95\u{a0}% intervals allow between runs under the same conditions; \
                     {} not compared, since the conditions were new.",
                    if others == 1 { "one was".to_owned() } else { format!("{others} were") }
                ),
            }
        }
        Some(last) => format!(
            "{all}, {} with a change of AET. The last is {}, setup {}, {} mode: {}.",
            changed.len(),
            last.run,
            last.setup,
            last.mode,
            changes(last)
                .iter()
                .map(|change| format!("{} {} ms", change.name, signed(change.ms)))
                .collect::<Vec<_>>()
                .join(", ")
        ),
    }
}

/// A change of an AET.
struct HistoryChange<'a> {
    name: String,
    ms: f64,
    interval_ms: (f64, f64),
    /// The run that it is compared with.
    before: &'a str,
}

fn changes(entry: &Entry) -> Vec<HistoryChange<'_>> {
    let change = |execution_type| {
        let (ms, interval_ms) = entry.change(execution_type)?;
        let before = entry.compared_with.get(execution_type)?;
        Some(HistoryChange { name: label(execution_type), ms, interval_ms, before })
    };
    ExecutionType::ALL.into_iter().filter_map(change).collect()
}

fn section(
    index: usize,
    [setup, application, mode]: [&str; 3],
    entries: &[&Entry],
    hosts: &[String],
    report: &dyn Fn(&Entry) -> Option<String>,
) -> anyhow::Result<HistorySection> {
    let numbered: Vec<_> =
        entries.iter().enumerate().map(|(index, entry)| Run { number: index + 1, entry }).collect();
    let changed = numbered.iter().rev().filter_map(|run| {
        let all = changes(run.entry);
        let found = |name: &str| numbered.iter().find(|earlier| earlier.entry.run == name);
        let before = found(all.first()?.before)?;
        let text = |HistoryChange { name, ms, interval_ms: (low, high), before }: &HistoryChange<'_>| {
            let against = found(before).map_or(0, |run| run.number);
            let interval = format!("{} to {}", signed(*low), signed(*high));
            format!("{name} {} ms against run {against} (95\u{a0}% interval {interval})", signed(*ms))
        };
        let all: Vec<_> = all.iter().map(text).collect();
        Some(format!("Run {}: {}.{}", run.number, all.join(", "), others(run.entry, before)))
    });
    let number_of_changes = numbered.iter().filter(|run| !changes(run.entry).is_empty()).count();
    let is_cut_off = entries.len() > chart::MOST;
    Ok(HistorySection {
        id: format!("kind-{}", index + 1),
        title: format!("Setup {setup}, {application}, {mode} mode"),
        about: format!("{}, {number_of_changes} with a change", counted(entries.len(), "run")),
        figure: Figure::draw(
            "AET of RC, SM and CM with its 95 % interval, run by run; the table below has the same",
            |format| chart::draw(&numbered, format),
        )?,
        shown: is_cut_off.then(|| {
            format!(
                "The figure has the last {} of {}; the table has all.",
                chart::MOST,
                counted(entries.len(), "run")
            )
        }),
        changes: changed.collect(),
        rows: numbered.iter().map(|run| row(*run, hosts, report(run.entry))).collect(),
    })
}

/// Returns what else is not the same in two runs that are compared, as a sentence.
fn others(entry: &Entry, run: &Run<'_>) -> String {
    let before = run.entry;
    let commit = |entry: &Entry| entry.commit.clone().unwrap_or_else(|| "unknown".to_owned());
    let both = [
        (entry.commit != before.commit)
            .then(|| format!("commit {} in place of {}", commit(entry), commit(before))),
        (entry.host != before.host).then(|| "another host".to_owned()),
        (entry.attached != before.attached).then(|| "other nodes".to_owned()),
    ];
    let both: Vec<_> = both.into_iter().flatten().collect();
    if both.is_empty() {
        String::new()
    } else {
        format!(" New since run {}: {}.", run.number, both.join(", "))
    }
}

fn row(run: Run<'_>, hosts: &[String], report: Option<String>) -> HistoryRow {
    let Run { number, entry } = run;
    let host = hosts.iter().position(|host| Some(host) == entry.host.as_ref());
    let made = [
        entry.date.as_deref().map(readable),
        entry.commit.as_ref().map(|commit| format!("commit {commit}")),
        host.map(|index| format!("host {}", index + 1)),
    ];
    let made: Vec<_> = made.into_iter().flatten().collect();
    let notes = [
        entry.attached.as_ref().map(|nodes| format!("Attached: {nodes}.")),
        entry.differs.as_ref().map(|reason| format!("Not compared with the run before: {reason}.")),
    ];
    let improvement = entry.aet_improvement.map(|share| format!("{:.1}\u{a0}%", share * 100.0));
    HistoryRow {
        number,
        name: entry.run.clone(),
        report,
        made: if made.is_empty() { "host.json is missing or broken".to_owned() } else { made.join(" · ") },
        notes: notes.into_iter().flatten().collect(),
        cells: ExecutionType::ALL.into_iter().map(|execution_type| cell(entry, execution_type)).collect(),
        improvement: improvement.unwrap_or_else(|| NONE.to_owned()),
        ended: entry.ended(),
        is_complete: entry.is_complete(),
    }
}

fn cell(entry: &Entry, execution_type: ExecutionType) -> Cell {
    let name = label(execution_type);
    let Some(figure) = entry.figures.get(execution_type) else {
        return Cell { name, aet: NONE.to_owned(), spread: None, change: None };
    };
    let interval = entry.interval_ms.get(execution_type);
    let margin = interval.map(|(low, high)| format!("\u{a0}±\u{a0}{:.1}", (high - low) / 2.0));
    let count = entry.repetitions.get(execution_type).copied().unwrap_or_default();
    // One repetition has no deviation.
    let mad = if count > 1 { format!("MAD\u{a0}{:.1}, ", figure.mad_ms) } else { String::new() };
    Cell {
        name,
        aet: format!("{:.1}{}", figure.aet_ms, margin.unwrap_or_default()),
        spread: Some(format!("{mad}n\u{a0}=\u{a0}{count}")),
        change: entry.change(execution_type).map(|(ms, _)| format!("change\u{a0}{}", signed(ms))),
    }
}
