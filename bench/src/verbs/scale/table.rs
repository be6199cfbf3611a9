//! The tables of a measurement, for the terminal and for a page.

use node::screen;
use serde::Serialize;

use super::measured::{Growth, ScaleFigures, ScaleRow};

/// A table: its head, and rows whose first cell names them.
#[derive(Serialize)]
pub(super) struct ScaleTable<'a> {
    head: &'a [&'static str],
    rows: Vec<Vec<String>>,
}

const COSTS: [&str; 6] = ["bus", "stations", "cost of a cycle, µs", "frames sent", "received", "memory, MiB"];
const LATENESS: [&str; 12] = [
    "lateness, µs",
    "stations",
    "p50",
    "p99",
    "max",
    "bare p50",
    "bare p99",
    "bare max",
    "p99 by bare",
    "scans missed",
    "allocations",
    "ready, ms",
];
const GROWTH: [&str; 4] = ["growth", "each further station, µs", "second station, µs", "ratio"];

/// Returns all tables that have a row.
pub(super) fn all(measured: &ScaleFigures) -> Vec<ScaleTable<'static>> {
    let tables = [
        ScaleTable { head: &COSTS, rows: measured.rows.iter().map(costs).collect() },
        ScaleTable { head: &LATENESS, rows: measured.rows.iter().filter_map(lateness).collect() },
        ScaleTable { head: &GROWTH, rows: measured.growth.iter().map(growth).collect() },
    ];
    tables.into_iter().filter(|table| !table.rows.is_empty()).collect()
}

/// Returns all tables as text.
pub(super) fn render(measured: &ScaleFigures) -> String {
    let draw = |ScaleTable { head, rows }: ScaleTable<'_>| {
        let mut table = screen::ruled();
        table.set_header(head).add_rows(rows);
        screen::drawn(&screen::numbers_right(table))
    };
    let note = screen::wrapped(note(measured), 0, 0);
    all(measured).into_iter().map(draw).chain([note]).collect::<Vec<_>>().join("\n\n")
}

/// Returns what the figures of a mode are.
pub(super) fn note(measured: &ScaleFigures) -> &'static str {
    if measured.mode == "real" {
        "Cost: processor time of the PLC's cyclic thread, with that of the kernel for it. Lateness: of that thread at its deadlines, \
         before any work; bare: of a loop that only sleeps, in the seconds between. The robots run on another core, if there is one."
    } else {
        "Cost: processor time of PLC, network and robots together, on one thread."
    }
}

fn costs(row: &ScaleRow) -> Vec<String> {
    vec![
        row.bus.to_owned(),
        row.stations.to_string(),
        format!("{:.1}", row.cost_us),
        format!("{:.2}", row.frames_sent),
        format!("{:.2}", row.frames_received),
        format!("{:.1}", row.memory_mib),
    ]
}

fn lateness(row: &ScaleRow) -> Option<Vec<String>> {
    let real = row.real.as_ref()?;
    let times = [
        real.late_p50_us,
        real.late_p99_us,
        real.late_max_us,
        real.bare_p50_us,
        real.bare_p99_us,
        real.bare_max_us,
    ];
    let mut cells = vec![row.bus.to_owned(), row.stations.to_string()];
    cells.extend(times.map(|us| format!("{us:.1}")));
    cells.push(format!("{:.2}", real.late_by_bare));
    cells.push(real.scans_missed.to_string());
    cells.push(real.allocations.to_string());
    cells.push(format!("{:.0}", real.ready_ms));
    Some(cells)
}

fn growth(Growth { bus, stations, each_us, second_us, ratio }: &Growth) -> Vec<String> {
    vec![
        format!("{bus}, {stations} stations"),
        format!("{each_us:.2}"),
        format!("{second_us:.2}"),
        format!("{ratio:.2}"),
    ]
}
