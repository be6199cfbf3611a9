//! The samples of several rows as strips with a box below each, on one axis.

use plotters::element::{Circle, PathElement};
use plotters::prelude::{Color, RGBColor};

use crate::html::chart::{self, ChartAxes, Format, INK, MUTED, Panels, px, stroke, text};
use crate::html::figure::Data;

/// Height of a row's strip and box, and of the text above them, in pixels.
const ROW: f64 = 74.0;
const TITLE: f64 = 30.0;

/// One row.
pub(super) struct Row {
    /// Its short name.
    pub(super) name: String,
    /// Text behind the name.
    pub(super) about: String,
    /// Colour of the name and of the marks.
    pub(super) colour: RGBColor,
    /// The samples in the order of their measurement, in ms.
    pub(super) samples: Vec<f64>,
}

/// Returns the rows as a table, in ms.
pub(super) fn data(rows: &[Row]) -> Data {
    let head = ["ms", "n", "least", "quarter below", "median", "quarter above", "most"].map(str::to_owned);
    let line = |row: &Row| {
        let Quartiles { low, q1, median, q3, high } = Quartiles::of(&row.samples)?;
        let figures = [low, q1, median, q3, high].map(|value| signed(&value));
        Some([row.name.clone(), row.samples.len().to_string()].into_iter().chain(figures).collect())
    };
    Data::new(head.into(), rows.iter().filter_map(line).collect())
}

/// Draws the rows; `None` without samples.
pub(super) fn draw(rows: &[Row], x_title: &str, format: Format) -> anyhow::Result<Option<String>> {
    let samples = || rows.iter().flat_map(|row| row.samples.iter().copied());
    let (low, high) = samples()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), sample| (low.min(sample), high.max(sample)));
    if low > high {
        return Ok(None);
    }
    let room = ((high - low) * 0.04).max(0.5);
    let layout = Panels { title: TITLE, panel: ROW };
    let svg = layout.figure(format, rows, |whole, panel, row| {
        whole.draw_text(&row.name, &chart::name(15.0, row.colour), (px(2.0), px(panel.top + 8.0)))?;
        let after = 12.0 + 11.5 * row.name.chars().count() as f64;
        whole.draw_text(&row.about, &text(format.pick(13.0, 12.0), INK), (px(after), px(panel.top + 9.5)))?;
        let axes = ChartAxes {
            x: (low - room, high + room),
            y: (0.0, 1.0),
            x_title: panel.is_last.then_some(x_title),
            y_title: "",
            x_lines: true,
            labels: (format.pick(14, 7), 0),
            write: (&signed, &|_| String::new()),
        };
        let mut chart = axes.draw(format, &panel.area)?;
        let count = row.samples.len().max(1) as f64;
        let dots = row.samples.iter().enumerate().map(|(index, sample)| {
            // From top to bottom in the order of the repetitions: a drift appears as a slope.
            let y = 0.94 - 0.50 * (index as f64 + 0.5) / count;
            Circle::new((*sample, y), px(format.pick(3.4, 2.8)), row.colour.mix(0.75).filled())
        });
        chart.draw_series(dots)?;
        if let Some(quartiles) = Quartiles::of(&row.samples) {
            draw_box(&mut chart, &quartiles)?;
        }
        Ok(())
    })?;
    let tooltip = |row: &Row| {
        let name = row.name.clone();
        let told = move |(index, sample): (usize, &f64)| {
            format!("{name}, repetition {}: {} ms", index + 1, signed(sample))
        };
        row.samples.iter().enumerate().map(told).collect::<Vec<_>>()
    };
    Ok(Some(chart::with_tooltips(&svg, rows.iter().flat_map(tooltip))))
}

fn draw_box(chart: &mut chart::Chart<'_, '_>, quartiles: &Quartiles) -> anyhow::Result<()> {
    let Quartiles { low, q1, median, q3, high } = *quartiles;
    let (bottom, middle, top) = (0.08, 0.20, 0.32);
    let thin = MUTED.stroke_width(stroke(1.2));
    let line = |from: (f64, f64), to: (f64, f64), style| PathElement::new(vec![from, to], style);
    chart.draw_series([
        line((low, middle), (q1, middle), thin),
        line((q3, middle), (high, middle), thin),
        line((low, bottom + 0.05), (low, top - 0.05), thin),
        line((high, bottom + 0.05), (high, top - 0.05), thin),
    ])?;
    let outline = vec![(q1, bottom), (q3, bottom), (q3, top), (q1, top), (q1, bottom)];
    chart.draw_series([PathElement::new(outline, thin)])?;
    chart.draw_series([line((median, bottom), (median, top), INK.stroke_width(stroke(2.2)))])?;
    Ok(())
}

/// The values that a box shows.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Quartiles {
    low: f64,
    q1: f64,
    median: f64,
    q3: f64,
    high: f64,
}

impl Quartiles {
    /// Computes the quartiles by linear interpolation between the samples; `None` without samples.
    fn of(samples: &[f64]) -> Option<Self> {
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = share * (sorted.len().checked_sub(1)?) as f64;
            let (below, above) = (sorted.get(place.floor() as usize)?, sorted.get(place.ceil() as usize)?);
            Some(below + (above - below) * place.fract())
        };
        Some(Self { low: at(0.0)?, q1: at(0.25)?, median: at(0.5)?, q3: at(0.75)?, high: at(1.0)? })
    }
}

fn signed(value: &f64) -> String {
    let sign = if *value > 1e-9 { "+" } else { "" };
    format!("{sign}{}", chart::short(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_the_samples_and_one_sample_is_all_of_them() {
        let found = Quartiles::of(&[4.0, 1.0, 2.0, 3.0]).unwrap();
        assert_eq!((found.low, found.q1, found.median, found.q3, found.high), (1.0, 1.75, 2.5, 3.25, 4.0));
        assert_eq!(Quartiles::of(&[7.0]).unwrap().q3, 7.0);
        assert_eq!(Quartiles::of(&[]), None);
    }
}
