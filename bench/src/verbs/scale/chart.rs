//! The page of a measurement: the cost of a cycle by the number of stations, a panel for each bus, and the tables.

use plotters::element::{Circle, PathElement};
use plotters::prelude::Color;
use report::html::chart::{
    self, Area, ChartAxes, Format, INK, Panel, Panels, colour, px, short, stroke, text, whole,
};
use report::html::document::fill;
use report::html::figure::{Data, Figure};
use serde::Serialize;

use plc_node::ExecutionType;

use super::measured::{ScaleFigures, ScaleRow};
use super::table::{self, ScaleTable};

const TEMPLATE: &str = include_str!("page.html");

/// Height in pixels of a panel and of the line of text above it.
const PANEL: f64 = 140.0;
const TITLE: f64 = 30.0;

#[derive(Serialize)]
struct ScalePage<'a> {
    conditions: String,
    note: &'static str,
    figure: Option<Figure>,
    tables: Vec<ScaleTable<'a>>,
}

/// Returns the page as HTML.
///
/// # Errors
///
/// The template or the figure is broken.
pub(super) fn page(measured: &ScaleFigures) -> anyhow::Result<String> {
    let row = |row: &ScaleRow| vec![format!("{}, {}", row.bus, row.stations), format!("{:.1}", row.cost_us)];
    let head = ["bus, stations", "cost of a cycle, µs"].map(str::to_owned).to_vec();
    let data = Data::new(head, measured.rows.iter().map(row).collect());
    let figure = Figure::draw("Cost of a cycle by the number of stations, a panel for each bus", |format| {
        draw(&measured.rows, format)
    })?;
    let page = ScalePage {
        conditions: format!("{} mode · {} s for each number of stations", measured.mode, measured.seconds),
        note: table::note(measured),
        figure: figure.map(|figure| figure.with(data)),
        tables: table::all(measured),
    };
    fill(TEMPLATE, &page)
}

fn draw(rows: &[ScaleRow], format: Format) -> anyhow::Result<Option<String>> {
    let mut buses: Vec<&str> = rows.iter().map(|row| row.bus).collect();
    buses.dedup();
    if buses.is_empty() {
        return Ok(None);
    }
    let layout = Panels { title: TITLE, panel: PANEL };
    let most = rows.iter().map(|row| row.stations).max().unwrap_or(1);
    let svg = layout.figure(format, &buses, |area, panel, bus| {
        let of_bus: Vec<_> = rows.iter().filter(|row| row.bus == *bus).collect();
        draw_bus(area, panel, (*bus, &of_bus), most, format)
    })?;
    let of_bus = |bus: &&str| {
        let rows = rows.iter().filter(|row| row.bus == *bus);
        rows.map(|row| format!("{} stations: {:.1} µs", row.stations, row.cost_us)).collect::<Vec<_>>()
    };
    Ok(Some(chart::with_tooltips(&svg, buses.iter().flat_map(of_bus))))
}

fn draw_bus(
    area: &Area<'_>,
    panel: &Panel<'_>,
    (bus, rows): (&str, &[&ScaleRow]),
    most: u32,
    format: Format,
) -> anyhow::Result<()> {
    let ink = colour(ExecutionType::Rc);
    area.draw_text(bus, &chart::name(15.0, ink), (px(2.0), px(panel.top + 8.0)))?;
    let about = "cost of a cycle, µs";
    area.draw_text(about, &text(format.pick(13.0, 12.0), INK), (px(120.0), px(panel.top + 9.5)))?;
    let highest = rows.iter().map(|row| row.cost_us).fold(1.0, f64::max);
    let axes = ChartAxes {
        x: (0.0, f64::from(most) * 1.04),
        y: (0.0, highest * 1.15),
        x_title: panel.is_last.then_some("stations"),
        y_title: "",
        x_lines: false,
        labels: (format.pick(10, 6), 4),
        write: (&whole, &short),
    };
    let mut chart = axes.draw(format, &panel.area)?;
    let points: Vec<_> = rows.iter().map(|row| (f64::from(row.stations), row.cost_us)).collect();
    chart.draw_series([PathElement::new(points.clone(), ink.stroke_width(stroke(1.4)))])?;
    chart.draw_series(points.into_iter().map(|point| Circle::new(point, px(4.0), ink.filled())))?;
    Ok(())
}
