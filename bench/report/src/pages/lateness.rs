//! Lateness of the cycles of a real run, as histograms with logarithmic axes: rare stalls are what matters.

use plotters::element::Rectangle;
use plotters::prelude::{Color, RGBColor};

use crate::html::chart::{ChartAxes, Format, INK, Panels, px, text};
use records::lateness::CycleLateness;
use records::results::Cycles;

/// Height of a panel and of the line of text above it, in pixels.
const PANEL: f64 = 120.0;
const TITLE: f64 = 30.0;

/// Lower bound of a bucket relative to its upper bound: buckets are a sixteenth of a power of two wide.
const BUCKET: f64 = 1.0 - 1.0 / 17.0;

const BAR: RGBColor = RGBColor(0x6B, 0x5F, 0xC7);

/// Draws the figure; `None` if no cycle was late, as in virtual time.
pub(super) fn draw(cycles: &Cycles, format: Format) -> anyhow::Result<Option<String>> {
    let panels: Vec<(&str, &CycleLateness)> = [("PLC scans", &cycles.plc), ("Robot cycles", &cycles.robot)]
        .into_iter()
        .filter(|(_, cycle)| cycle.max_us > 0.0 && !cycle.buckets.is_empty())
        .collect();
    let buckets = || panels.iter().flat_map(|(_, cycle)| cycle.buckets.iter());
    let latest = buckets().map(|(upper_us, _)| *upper_us).fold(1.0, f64::max);
    let most = buckets().map(|(_, count)| f64::from(*count)).fold(1.0, f64::max);
    if panels.is_empty() {
        return Ok(None);
    }
    let layout = Panels { title: TITLE, panel: PANEL };
    let svg = layout.figure(format, &panels, |whole, panel, (name, cycle)| {
        let CycleLateness { p50_us, p99_us, max_us, missed, .. } = cycle;
        let about = format.pick(
            format!("{name}: half within {p50_us:.0} µs, 99 % within {p99_us:.0} µs, latest {max_us:.0} µs, {missed} missed"),
            format!("{name}: p50 {p50_us:.0}, p99 {p99_us:.0}, max {max_us:.0} µs"),
        );
        whole.draw_text(&about, &text(format.pick(13.0, 12.0), INK), (px(2.0), px(panel.top + 8.0)))?;
        let axes = ChartAxes {
            x: (0.0, libm::log10(latest * 1.2)),
            y: (0.0, libm::log10(most * 1.6)),
            x_title: panel.is_last.then_some("late by, in µs"),
            y_title: "",
            x_lines: true,
            labels: (format.pick(6, 6), 5),
            write: (&power, &power),
        };
        let mut chart = axes.draw(format, &panel.area)?;
        let bars = cycle.buckets.iter().map(|(upper_us, count)| {
            let left = libm::log10((upper_us * BUCKET).max(1.0));
            // A single cycle must be visible, too: log 1 is 0.
            let height = libm::log10(f64::from(*count) * 1.25);
            Rectangle::new([(left, 0.0), (libm::log10(upper_us.max(1.07)), height)], BAR.filled())
        });
        chart.draw_series(bars)?;
        Ok(())
    })?;
    Ok(Some(svg))
}

/// Formats a power of ten, given its exponent; empty between two powers.
fn power(exponent: &f64) -> String {
    if (exponent - exponent.round()).abs() > 1e-6 {
        return String::new();
    }
    match exponent.round() {
        exponent if exponent < 4.0 => format!("{:.0}", libm::pow(10.0, exponent)),
        exponent => format!("{:.0} 000", libm::pow(10.0, exponent - 3.0)),
    }
}
