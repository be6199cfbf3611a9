//! The page of a starvation sweep: one panel a depth, a cell a bus cycle and a length of motion.

use plotters::element::{PathElement, Rectangle};
use plotters::prelude::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use serde::Serialize;

use super::table::{cell, depths, percent, rows, slots};
use super::{Predicted, Sweep, SweepPoint, sentences};
use crate::study::part;
use records::schedule::repetitions;
use report::html::chart::{self, Area, Format, GRID, INK, MUTED, colour, px, stroke, text};
use report::html::document::fill;
use report::html::figure::Figure;

const TEMPLATE: &str = include_str!("page.html");

/// Height of what stands above and below a panel's cells, in pixels.
const TITLE: f64 = 34.0;
const BELOW: f64 = 40.0;
/// Height of a cell in pixels.
const CELL: f64 = 26.0;
/// Width of what stands left of the cells, in pixels.
const LEFT: f64 = 58.0;
/// A loss of this share fills a cell fully.
const FULL: f64 = 0.5;

#[derive(Serialize)]
struct Page {
    setup: String,
    title: String,
    conditions: String,
    summary: Option<String>,
    sentences: Vec<String>,
    blends: u32,
    figure: Option<Figure>,
    blocks: Vec<SweepBlock>,
}

#[derive(Serialize)]
struct SweepBlock {
    title: String,
    cycles: Vec<String>,
    rows: Vec<Vec<String>>,
}

/// Returns the page as HTML.
///
/// # Errors
///
/// The template or a figure is broken.
pub(super) fn page(sweep: &Sweep) -> anyhow::Result<String> {
    let mut sentences = sentences(sweep);
    let summary = (!sentences.is_empty()).then(|| sentences.remove(0));
    let page = Page {
        setup: sweep.setup.clone(),
        title: sweep.title.clone(),
        conditions: format!(
            "Setup {} · {} blended motions round a square · RC and CM · {} · virtual mode · seed {}{}",
            sweep.setup,
            sweep.motions,
            repetitions(sweep.reps),
            sweep.seed,
            part(sweep.points.len(), sweep.planned, "points")
        ),
        summary,
        sentences,
        blends: sweep.motions.saturating_sub(1),
        figure: Figure::draw("How much longer CM takes than RC, by slots, bus cycle and length", |format| {
            draw(sweep, format)
        })?,
        blocks: depths(sweep).into_iter().map(|depth| block(sweep, depth)).collect(),
    };
    fill(TEMPLATE, &page)
}

fn block(sweep: &Sweep, depth: u32) -> SweepBlock {
    let rows = rows(sweep, depth);
    let cycles = rows.first().into_iter().flatten().map(|point| format!("{} ms", point.bus_cycle_ms));
    let row = |row: &Vec<SweepPoint>| {
        let first = row.first().map(|first| {
            let takes = first.rc_ms / f64::from(sweep.motions);
            [format!("{} mm", first.length_mm), format!("{takes:.0} ms")]
        });
        first.into_iter().flatten().chain(row.iter().map(cell)).collect()
    };
    SweepBlock { title: slots(depth), cycles: cycles.collect(), rows: rows.iter().map(row).collect() }
}

/// Draws all panels, as many in a row as there is room for; none without a point.
fn draw(sweep: &Sweep, format: Format) -> anyhow::Result<Option<String>> {
    let depths = depths(sweep);
    let lines = depths.iter().map(|depth| rows(sweep, *depth).len()).max().unwrap_or(0);
    if lines == 0 {
        return Ok(None);
    }
    let columns = format.pick(3, 1).min(depths.len());
    let panel = (format.width() / columns as f64, TITLE + lines as f64 * CELL + BELOW);
    let height = depths.len().div_ceil(columns) as f64 * panel.1;
    let svg = chart::figure(format, height, |area| {
        for (index, depth) in depths.iter().enumerate() {
            let corner = ((index % columns) as f64 * panel.0, (index / columns) as f64 * panel.1);
            draw_panel(area, sweep, *depth, corner, panel.0)?;
        }
        Ok(())
    })?;
    Ok(Some(svg))
}

fn draw_panel(
    area: &Area<'_>,
    sweep: &Sweep,
    depth: u32,
    (left, top): (f64, f64),
    width: f64,
) -> anyhow::Result<()> {
    let rows = rows(sweep, depth);
    let cells = rows.first().map_or(0, Vec::len).max(1);
    let cell_width = (width - LEFT - 14.0) / cells as f64;
    let at = |column: f64, row: f64| (px(left + LEFT + column * cell_width), px(top + TITLE + row * CELL));
    let small = text(11.5, MUTED);
    let anchored = |style: &plotters::prelude::TextStyle<'static>, h, v| style.clone().pos(Pos::new(h, v));
    area.draw_text(&slots(depth), &chart::name(14.0, INK), (px(left + 2.0), px(top + 8.0)))?;
    for (index, row) in rows.iter().enumerate() {
        let y = index as f64;
        if let Some(first) = row.first() {
            let label = format!("{} mm", first.length_mm);
            let (x, middle) = (px(left + LEFT - 6.0), at(0.0, y + 0.5).1);
            area.draw_text(&label, &anchored(&small, HPos::Right, VPos::Center), (x, middle))?;
        }
        for (column, point) in row.iter().enumerate() {
            draw_cell(area, point, [at(column as f64, y), at(column as f64 + 1.0, y + 1.0)])?;
            if index + 1 == rows.len() {
                let (x, below) = at(column as f64 + 0.5, rows.len() as f64);
                let label = format!("{}", point.bus_cycle_ms);
                area.draw_text(&label, &anchored(&small, HPos::Center, VPos::Top), (x, below + px(5.0)))?;
            }
        }
    }
    for line in borders(&rows) {
        let line: Vec<_> = line.into_iter().map(|(column, row)| at(column as f64, row as f64)).collect();
        area.draw(&PathElement::new(line, INK.stroke_width(stroke(1.6))))?;
    }
    let (x, below) = at(cells as f64 / 2.0, rows.len() as f64);
    let title = "bus cycle in ms";
    area.draw_text(title, &anchored(&small, HPos::Center, VPos::Top), (x, below + px(20.0)))?;
    Ok(())
}

fn draw_cell(area: &Area<'_>, point: &SweepPoint, corners: [(i32, i32); 2]) -> anyhow::Result<()> {
    let loses = point.loses();
    if loses {
        let share = (point.loss() / FULL).clamp(0.0, 1.0);
        let fill = colour(plc_node::ExecutionType::Sm).mix(0.14 + 0.6 * share);
        area.draw(&Rectangle::new(corners, fill.filled()))?;
    }
    area.draw(&Rectangle::new(corners, GRID.stroke_width(stroke(1.0))))?;
    let [(x0, y0), (x1, y1)] = corners;
    let middle = (i32::midpoint(x0, x1), i32::midpoint(y0, y1));
    let style = text(11.5, if loses { INK } else { MUTED }).pos(Pos::new(HPos::Center, VPos::Center));
    let label = if loses { percent(point.loss()).replace(" %", "") } else { "·".to_owned() };
    area.draw_text(&label, &style, middle)?;
    Ok(())
}

/// A line between two cells' corners, as column and row.
type Border = [(usize, usize); 2];

/// Returns the borders between cells that are sure to keep up and others, for neighbours side by side and one above the
/// other.
fn borders(rows: &[Vec<SweepPoint>]) -> Vec<Border> {
    let sure = |row: usize, column: usize| {
        rows.get(row).and_then(|row| row.get(column)).map(|point| point.predicted == Predicted::KeepsUp)
    };
    let mut borders = Vec::new();
    for (y, row) in rows.iter().enumerate() {
        for x in 0..row.len() {
            let here = sure(y, x);
            if sure(y, x + 1).is_some_and(|right| Some(right) != here) {
                borders.push([(x + 1, y), (x + 1, y + 1)]);
            }
            if sure(y + 1, x).is_some_and(|below| Some(below) != here) {
                borders.push([(x, y + 1), (x + 1, y + 1)]);
            }
        }
    }
    borders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_runs_between_cells_that_are_sure_to_keep_up_and_others() {
        let point = |predicted| SweepPoint {
            depth: 5,
            bus_cycle_ms: 1.0,
            length_mm: 2.0,
            rc_ms: 1.0,
            cm_ms: 1.0,
            blends_suppressed: 0.0,
            round_trip_ms: 1.0,
            predicted,
        };
        let (sure, open) = (point(Predicted::KeepsUp), point(Predicted::Open));
        assert_eq!(borders(&[vec![sure, sure], vec![sure, sure]]), [] as [Border; 0]);
        assert_eq!(borders(&[vec![sure, sure], vec![sure, open]]), [[(1, 1), (2, 1)], [(1, 1), (1, 2)]]);
    }
}
