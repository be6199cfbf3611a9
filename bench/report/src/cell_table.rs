//! The table of a cell with several stations.

use node::screen;
use plc_node::ExecutionType;

use crate::progress::label;
use records::cell_results::{CellResults, CellTypeResult};
use records::schedule::repetitions;

/// Formats the results of a cell for the screen.
#[must_use]
pub fn render(results: &CellResults) -> String {
    let title = format!("Setup {}: {}", results.setup, results.title);
    let about = format!("{}, {} mode, seed {}", repetitions(results.reps), results.mode, results.seed);
    let mut text = format!("{}\n{}\n\n", screen::wrapped(&title, 0, 2), screen::wrapped(&about, 0, 2));
    text.push_str(&figures(results));
    let meaning = "waits: mean time at marks for the other arm; start skew: mean time between the first motions of the arms; \
                   mark skew: longest time between the arrivals at a mark; pose: largest difference of one tool, seen from the other, from the plan at \
                   the same progress, at marks and where the arms move together";
    text.push_str(&format!("\n\n{}", screen::wrapped(meaning, 2, 2)));
    if has_zones(results) {
        let meaning = "zones: mean time before shared zones until the PLC granted them";
        text.push_str(&format!("\n{}", screen::wrapped(meaning, 2, 2)));
    }
    if let Some(gains) = gains(results) {
        text.push_str(&format!("\n\n{}", screen::wrapped(&gains, 2, 2)));
    }
    text
}

/// Formats the figures of all types as a table.
#[must_use]
pub fn figures(results: &CellResults) -> String {
    let mut table = screen::ruled();
    let mut header = ["", "AET ms", "MAD ms"].map(str::to_owned).to_vec();
    header.extend(results.stations.iter().map(|station| format!("{} waits ms", station.name)));
    let has_zones = has_zones(results);
    if has_zones {
        header.extend(results.stations.iter().map(|station| format!("{} zones ms", station.name)));
    }
    header.extend(["start skew ms", "mark skew ms", "pose mm", "failed"].map(str::to_owned));
    table.set_header(header);
    for execution_type in ExecutionType::ALL {
        if let Some(result) = results.results.get(execution_type) {
            table.add_row(row(execution_type, result, has_zones));
        }
    }
    screen::drawn(&screen::numbers_right(table))
}

/// Returns what CM gains over SM, for the cell and for each arm alone.
fn gains(results: &CellResults) -> Option<String> {
    let percent = |share: f64| format!("{:.1} %", share * 100.0);
    let mut text = format!("(SM − CM) / SM: {}", percent(results.aet_improvement?));
    for station in &results.stations {
        if let Some(gain) = station.alone.as_ref().and_then(|alone| alone.aet_improvement) {
            text.push_str(&format!(", {} alone {}", station.name, percent(gain)));
        }
    }
    if let Some(share) = results.remaining_gain() {
        text.push_str(&format!("; {} of the mean gain alone remains", percent(share)));
    }
    Some(text)
}

/// Returns whether the cell has shared zones.
fn has_zones(results: &CellResults) -> bool {
    let mut types = ExecutionType::ALL.into_iter().filter_map(|it| results.results.get(it));
    types.any(|result| result.stations.iter().any(|station| !station.zone_waiting_ms.is_empty()))
}

fn row(execution_type: ExecutionType, result: &CellTypeResult, has_zones: bool) -> Vec<String> {
    let shown = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"));
    let mut row = vec![label(execution_type), shown(result.aet_ms), shown(result.mad_ms)];
    row.extend(result.stations.iter().map(|station| shown(station.mean_waiting_ms())));
    if has_zones {
        row.extend(result.stations.iter().map(|station| shown(station.mean_zone_waiting_ms())));
    }
    let millis = |micros: Option<f64>| shown(micros.map(|micros| micros / 1e3));
    let pose = result.worst_relative_pose_mm().map_or_else(|| "–".to_owned(), |mm| format!("{mm:.3}"));
    row.extend([
        millis(result.mean_start_skew_us()),
        millis(result.worst_mark_skew_us()),
        pose,
        result.failed.len().to_string(),
    ]);
    row
}
