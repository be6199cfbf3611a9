//! The speed over the path, as SVG.

use plotters::element::PathElement;
use plotters::prelude::Color;

use records::trace::RobotTick;
use report::html::chart::{self, ChartAxes, Format, INK, MUTED, stroke};

use super::figures::{on_path, ways};

/// Height in pixels.
const HEIGHT: f64 = 260.0;

/// Draws the speed of the tool over its way.
pub(super) fn draw(ticks: &[RobotTick], programmed_mm_s: f64) -> anyhow::Result<String> {
    let ticks = on_path(ticks);
    let ways = ways(ticks);
    let speeds = ticks.iter().map(|tick| f64::from(tick.sample.path_speed_mm_s));
    let curve: Vec<(f64, f64)> = ways.iter().copied().zip(speeds).collect();
    let whole = ways.last().copied().unwrap_or(0.0).max(1.0);
    chart::figure(Format::Wide, HEIGHT, |area| {
        let axes = ChartAxes {
            x: (0.0, whole),
            y: (0.0, 1.08 * programmed_mm_s),
            x_title: Some("way of the tool in mm"),
            y_title: "",
            x_lines: false,
            labels: (14, 5),
            write: (&chart::whole, &chart::whole),
        };
        let mut chart = axes.draw(Format::Wide, area)?;
        let programmed = [(0.0, programmed_mm_s), (whole, programmed_mm_s)];
        chart.draw_series([PathElement::new(programmed, MUTED.stroke_width(stroke(1.0)))])?;
        chart.draw_series([PathElement::new(curve, INK.stroke_width(stroke(1.4)))])?;
        Ok(())
    })
}
