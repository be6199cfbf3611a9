//! The page of a sensitivity study: how far each case moves AETi, as bars, and all figures.

use plotters::element::{PathElement, Rectangle};
use plotters::prelude::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use serde::Serialize;

use super::table::{LEGEND, millis, name, percent};
use super::{Row, Sensitivity};
use crate::study::part;
use records::schedule::repetitions;
use report::html::chart::{self, Format, INK, MUTED, colour, px, stroke, text};
use report::html::document::fill;
use report::html::figure::{Data, Figure};

const TEMPLATE: &str = include_str!("page.html");

/// Height of a case in pixels.
const LINE: f64 = 24.0;

#[derive(Serialize)]
struct Page {
    setup: String,
    title: String,
    conditions: String,
    summary: Option<String>,
    figure: Option<Figure>,
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
    notes: Vec<String>,
}

/// A case that moves AETi.
struct ShownChange {
    name: String,
    value: String,
    /// In percentage points.
    points: f64,
}

/// Returns the page as HTML.
///
/// # Errors
///
/// The template or the figure is broken.
pub(super) fn page(study: &Sensitivity) -> anyhow::Result<String> {
    let changes = changes(study);
    let head = ["case", "value", "change of AETi, points"].map(str::to_owned);
    let line = |change: &ShownChange| vec![change.name.clone(), change.value.clone(), points(change.points)];
    let data = Data::new(head.into(), changes.iter().map(line).collect());
    let refused = study.rows.iter().filter_map(|row| Some((name(row), row.refused.as_ref()?)));
    let refused = refused.map(|(name, reason)| format!("{name} is refused: {reason}"));
    let page = Page {
        setup: study.setup.clone(),
        title: study.title.clone(),
        conditions: format!(
            "Setup {} · {} · one number at a time · {} of each type · virtual mode · seed {}{}",
            study.setup,
            study.application,
            repetitions(study.reps),
            study.seed,
            part(study.rows.len(), study.planned, "cases")
        ),
        summary: summary(study, &changes),
        figure: Figure::draw("Change of AETi in percentage points, a bar for each case", |format| {
            draw(&changes, format)
        })?
        .map(|figure| figure.with(data)),
        columns: columns(),
        rows: study.rows.iter().map(cells).collect(),
        notes: LEGEND.map(str::to_owned).into_iter().chain(refused).collect(),
    };
    fill(TEMPLATE, &page)
}

fn changes(study: &Sensitivity) -> Vec<ShownChange> {
    let base = study.rows.first().and_then(|row| row.calibrated.aet_improvement);
    let change = |row: &Row| {
        row.factor?;
        let points = (row.calibrated.aet_improvement? - base?) * 100.0;
        Some(ShownChange { name: name(row), value: row.value.clone(), points })
    };
    study.rows.iter().filter_map(change).collect()
}

fn summary(study: &Sensitivity, changes: &[ShownChange]) -> Option<String> {
    let base = study.rows.first()?.calibrated.aet_improvement? * 100.0;
    let most = changes.iter().max_by(|one, other| one.points.abs().total_cmp(&other.points.abs()))?;
    Some(format!(
        "As it is, CM saves {base:.1}\u{a0}% of SM's time. Of these cases, \u{201c}{}\u{201d} moves that most, by {} points.",
        most.name,
        points(most.points)
    ))
}

fn points(value: f64) -> String {
    let text = format!("{value:+.1}").replace('-', "−");
    if text == "−0.0" { "+0.0".to_owned() } else { text }
}

fn columns() -> Vec<String> {
    let figures = ["", ", h = 0", ", uncal."]
        .into_iter()
        .flat_map(|variant| ["RC", "SM", "CM", "AETi"].map(|figure| format!("{figure}{variant}")));
    ["varied", "is"].map(str::to_owned).into_iter().chain(figures).collect()
}

fn cells(row: &Row) -> Vec<String> {
    let variants = [&row.calibrated, &row.without_skill_overhead, &row.uncalibrated];
    let figures = variants.into_iter().flat_map(|figures| {
        [millis(figures.rc_ms), millis(figures.sm_ms), millis(figures.cm_ms), percent(figures)]
    });
    // A figure stays beside its unit.
    let unbroken = [row.value.clone()].into_iter().chain(figures).map(|figure| figure.replace(' ', "\u{a0}"));
    [name(row)].into_iter().chain(unbroken).collect()
}

/// Draws a bar for each case, from no change on; none without a case.
fn draw(changes: &[ShownChange], format: Format) -> anyhow::Result<Option<String>> {
    if changes.is_empty() {
        return Ok(None);
    }
    let size = format.pick(13.0, 11.0);
    let (left, beside) = (size * 13.0, size * 3.6);
    let ends = |keep: fn(f64, f64) -> f64| changes.iter().map(|change| change.points).fold(0.0, keep);
    let (low, high) = (ends(f64::min), ends(f64::max));
    let room = format.width() - left - 2.0 * beside;
    let x = |points: f64| px(left + beside + (points - low) / (high - low).max(1.0) * room);
    let height = changes.len() as f64 * LINE + 8.0;
    let svg = chart::figure(format, height, |area| {
        for (index, ShownChange { name, points: change, .. }) in changes.iter().enumerate() {
            let top = index as f64 * LINE + 4.0;
            let middle = px(top + LINE / 2.0);
            let anchored = |h, ink| text(size, ink).pos(Pos::new(h, VPos::Center));
            area.draw_text(name, &anchored(HPos::Left, INK), (px(2.0), middle))?;
            let bar = [(x(change.min(0.0)), px(top + 4.0)), (x(change.max(0.0)), px(top + LINE - 4.0))];
            let fill =
                colour(if *change < 0.0 { plc_node::ExecutionType::Sm } else { plc_node::ExecutionType::Cm });
            area.draw(&Rectangle::new(bar, fill.filled()))?;
            let (side, gap) = if *change < 0.0 { (HPos::Right, -5.0) } else { (HPos::Left, 5.0) };
            area.draw_text(&points(*change), &anchored(side, MUTED), (x(*change) + px(gap), middle))?;
        }
        let zero = [(x(0.0), px(2.0)), (x(0.0), px(height - 2.0))];
        area.draw(&PathElement::new(zero, INK.stroke_width(stroke(1.0))))?;
        Ok(())
    })?;
    Ok(Some(svg))
}
