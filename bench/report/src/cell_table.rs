//! The table of a cell with several stations.

use node::screen;
use plc_node::ExecutionType;

use crate::progress::label;
use crate::table;
use records::cell_results::{CellAllocations, CellResults, CellTypeResult};
use records::schedule::repetitions;

/// Formats the results of a cell for the screen.
#[must_use]
pub fn render(results: &CellResults) -> String {
    let title = format!("Setup {}: {}", results.setup, results.title);
    let about = format!("{}, {} mode, {}", repetitions(results.reps), results.mode, results.conditions(", "));
    let mut text = format!("{}\n{}\n\n", screen::wrapped(&title, 0, 2), screen::wrapped(&about, 0, 2));
    text.push_str(&figures(results));
    for sentences in [meanings(results), gains(results).into_iter().collect(), conditions(results)] {
        if !sentences.is_empty() {
            let lines: Vec<_> = sentences.iter().map(|sentence| screen::wrapped(sentence, 2, 2)).collect();
            text.push_str(&format!("\n\n{}", lines.join("\n")));
        }
    }
    text
}

/// Formats the figures of all types as a table.
#[must_use]
pub fn figures(results: &CellResults) -> String {
    let mut table = screen::ruled();
    table.set_header(header(results));
    table.add_rows(rows(results));
    screen::drawn(&screen::numbers_right(table))
}

/// Returns the heads of the columns.
pub(crate) fn header(results: &CellResults) -> Vec<String> {
    let mut header = ["", "AET ms", "MAD ms"].map(str::to_owned).to_vec();
    header.extend(results.stations.iter().map(|station| format!("{} waits ms", station.name)));
    if has_zones(results) {
        header.extend(results.stations.iter().map(|station| format!("{} zones ms", station.name)));
    }
    header.extend(["start skew ms", "mark skew ms", "pose mm", "failed"].map(str::to_owned));
    header
}

/// Returns a row for each type.
pub(crate) fn rows(results: &CellResults) -> Vec<Vec<String>> {
    let has_zones = has_zones(results);
    let of_type = |it| Some(row(it, results.results.get(it)?, has_zones));
    ExecutionType::ALL.into_iter().filter_map(of_type).collect()
}

/// Returns what the columns mean, as sentences.
fn meanings(results: &CellResults) -> Vec<String> {
    let waits = "waits: mean time at marks for the other arm; start skew: mean time between the first motions of the arms; \
                 mark skew: longest time between the arrivals at a mark; pose: largest difference of one tool, seen from the other, from the plan at \
                 the same progress, at marks and where the arms move together";
    let zones = "zones: mean time before shared zones until the PLC granted them";
    [Some(waits), has_zones(results).then_some(zones)].into_iter().flatten().map(str::to_owned).collect()
}

/// Returns sentences on the nodes, the host and the buses, as the table of one robot has them.
pub(crate) fn conditions(results: &CellResults) -> Vec<String> {
    let mut sentences = Vec::new();
    if let Some(after) = results.connected_after_ms {
        sentences.push(format!(
            "Connected {after:.0} ms after the start of the nodes{}.",
            allocations(results).unwrap_or_default()
        ));
    }
    sentences.extend(results.attached.as_ref().map(|attached| {
        let names = results.stations.iter().map(|station| station.name.as_str());
        format!("Measured on nodes that ran already: {}.", attached.shown(names))
    }));
    sentences.extend(results.remarks.iter().map(|remark| format!("Connection: {remark}.")));
    sentences.extend(
        results
            .stations
            .iter()
            .map(|station| format!("Station {}: {}", station.name, table::cyclic_frames(&station.frames))),
    );
    sentences.extend(results.repeated.iter().map(|lost| format!("Run again, {lost}.")));
    sentences.extend(results.faults.as_ref().map(ToString::to_string));
    sentences
}

fn allocations(results: &CellResults) -> Option<String> {
    let CellAllocations { plc, robots } = results.cyclic_allocations.as_ref()?;
    let of_robots = results.stations.iter().zip(robots);
    let robots: Vec<_> = of_robots.map(|(station, count)| format!(", {} {count}", station.name)).collect();
    Some(format!("; allocations in the cyclic threads since: PLC {plc}{}", robots.concat()))
}

/// Returns what stands below the table, as sentences.
pub(crate) fn sentences(results: &CellResults) -> Vec<String> {
    [meanings(results), gains(results).into_iter().collect(), conditions(results)].concat()
}

/// Returns what CM gains over SM, for the cell and for each arm alone.
fn gains(results: &CellResults) -> Option<String> {
    let percent = |share: f64| format!("{:.1} %", share * 100.0).replace('-', "−");
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
pub(crate) fn has_zones(results: &CellResults) -> bool {
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
