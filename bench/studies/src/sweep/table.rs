//! A sweep on screen, a block for each depth, and as CSV.

use std::fmt::Write as _;

use node::screen;

use super::{Sweep, SweepPoint, sentences};
use records::counted::counted;
use records::schedule::repetitions;

/// Formats a block for each depth and the sentences below them.
#[must_use]
pub fn render(sweep: &Sweep) -> String {
    let Sweep { setup, title, motions, reps, seed, .. } = sweep;
    let heading = [
        format!("Setup {setup}: {title}"),
        format!(
            "{motions} blended motions round a square, RC and CM, {}, virtual mode, seed {seed}",
            repetitions(*reps)
        ),
        format!(
            "How much longer CM takes than RC, and in brackets how many of {} blends became stops; · is none.",
            motions.saturating_sub(1)
        ),
    ];
    let mut text = heading.map(|line| screen::wrapped(&line, 0, 2) + "\n").concat();
    for depth in depths(sweep) {
        let _ = write!(text, "\n{}\n{}\n", slots(depth), block(sweep, depth));
    }
    let sentences = sentences(sweep);
    text.push('\n');
    let sentences: Vec<_> = sentences.iter().map(|sentence| screen::wrapped(sentence, 2, 2)).collect();
    text.push_str(&sentences.join("\n"));
    text
}

/// Returns the depths of a sweep, each once, in order.
pub(crate) fn depths(sweep: &Sweep) -> Vec<u32> {
    let mut depths: Vec<u32> = sweep.points.iter().map(|point| point.depth).collect();
    depths.dedup();
    depths
}

/// Returns the points of a depth as rows, one for each length of motion, the longest first.
pub(crate) fn rows(sweep: &Sweep, depth: u32) -> Vec<Vec<SweepPoint>> {
    let mut rows: Vec<Vec<SweepPoint>> = Vec::new();
    for point in sweep.points.iter().filter(|point| point.depth == depth) {
        match rows.iter_mut().find(|row| row.first().is_some_and(|first| first.length_mm == point.length_mm))
        {
            Some(row) => row.push(*point),
            None => rows.push(vec![*point]),
        }
    }
    rows.reverse();
    rows
}

/// Formats a depth in words.
pub(crate) fn slots(depth: u32) -> String {
    counted(depth, "slot")
}

fn block(sweep: &Sweep, depth: u32) -> String {
    let rows = rows(sweep, depth);
    let mut table = screen::ruled();
    let mut cycles_ms: Vec<f64> = Vec::new();
    for point in rows.iter().flatten() {
        if !cycles_ms.contains(&point.bus_cycle_ms) {
            cycles_ms.push(point.bus_cycle_ms);
        }
    }
    let cycles = cycles_ms.iter().map(|cycle_ms| format!("bus {cycle_ms} ms"));
    table.set_header(["motion".to_owned(), "takes".to_owned()].into_iter().chain(cycles));
    for row in rows {
        let Some(first) = row.first() else { continue };
        let motion =
            [format!("{} mm", first.length_mm), format!("{:.0} ms", first.rc_ms / f64::from(sweep.motions))];
        // An interrupted sweep has no point for some of the cycles.
        let at = |cycle_ms: &f64| row.iter().find(|point| point.bus_cycle_ms == *cycle_ms);
        let cells = cycles_ms.iter().map(|cycle_ms| at(cycle_ms).map_or_else(String::new, cell));
        table.add_row(motion.into_iter().chain(cells));
    }
    screen::drawn(&screen::numbers_right(table))
}

pub(crate) fn cell(point: &SweepPoint) -> String {
    if !point.loses() {
        return "·".to_owned();
    }
    format!("{} ({:.0})", percent(point.loss()), point.blends_suppressed)
}

/// Formats a share in whole percent, or in tenths where it is small.
pub(crate) fn percent(share: f64) -> String {
    let percent = share * 100.0;
    if percent.abs() < 1.0 { format!("{percent:.1} %") } else { format!("{percent:.0} %") }
}

/// Columns of the points as CSV.
pub const CSV_HEADER: &str =
    "queue_depth,bus_cycle_ms,length_mm,rc_ms,cm_ms,loss_percent,blends_suppressed,round_trip_ms,predicted";

/// Formats all points, one per line.
#[must_use]
pub fn csv(sweep: &Sweep) -> String {
    let mut text = format!("{CSV_HEADER}\n");
    for point in &sweep.points {
        let SweepPoint {
            depth,
            bus_cycle_ms,
            length_mm,
            rc_ms,
            cm_ms,
            blends_suppressed,
            round_trip_ms,
            predicted,
        } = point;
        let predicted = match predicted {
            super::Predicted::KeepsUp => "keeps-up",
            super::Predicted::Open => "open",
            super::Predicted::Starves => "starves",
        };
        let loss = point.loss() * 100.0;
        let _ = writeln!(
            text,
            "{depth},{bus_cycle_ms},{length_mm},{rc_ms:.3},{cm_ms:.3},{loss:.3},{blends_suppressed:.2},{round_trip_ms:.3},{predicted}"
        );
    }
    text
}
