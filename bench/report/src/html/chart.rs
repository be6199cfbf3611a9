//! What all figures share: their two widths, their colours, their axes.
//!
//! Each figure is drawn twice, for a screen or paper and for a phone, and the page shows the one that fits. The SVG
//! contains the colours of the light page; the style sheet lists each of them and defines its replacement on a dark
//! page.

use plc_node::ExecutionType;
use plotters::backend::SVGBackend;
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::prelude::{Cartesian2d, Color, IntoFont, RGBColor, TextStyle};
use plotters::style::FontStyle;

/// Area that figures are drawn on.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// A rectangle with two linear axes.
pub type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// SVG units per pixel: the backend uses whole numbers only, and a curve needs a finer resolution.
const UNITS: f64 = 10.0;

/// Text and marks.
pub const INK: RGBColor = RGBColor(0x1B, 0x1B, 0x1A);
/// Labels of axes.
pub const MUTED: RGBColor = RGBColor(0x66, 0x64, 0x5F);
/// Lines of a grid.
pub const GRID: RGBColor = RGBColor(0xE4, 0xE2, 0xDB);
/// Axes.
pub const AXIS: RGBColor = RGBColor(0xB5, 0xB2, 0xA9);
/// Background of the figure.
pub const PAPER: RGBColor = RGBColor(0xFF, 0xFF, 0xFE);

/// Returns the colour of a type, the same in all figures.
pub const fn colour(execution_type: ExecutionType) -> RGBColor {
    match execution_type {
        ExecutionType::Rc => RGBColor(0x1F, 0x6C, 0xC7),
        ExecutionType::Sm => RGBColor(0xC4, 0x46, 0x1A),
        ExecutionType::Cm => RGBColor(0x0E, 0x7A, 0x57),
    }
}

/// Format of the page.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Format {
    /// A screen or paper: 800 pixels.
    Wide,
    /// A phone: 360 pixels.
    Narrow,
}

impl Format {
    /// Returns the width of a figure, in pixels.
    pub const fn width(self) -> f64 {
        match self {
            Self::Wide => 800.0,
            Self::Narrow => 360.0,
        }
    }

    /// Returns the value for this format.
    pub fn pick<T>(self, wide: T, narrow: T) -> T {
        match self {
            Self::Wide => wide,
            Self::Narrow => narrow,
        }
    }

    /// Returns the width in pixels of the labels left of a vertical axis.
    pub fn margin(self) -> f64 {
        self.pick(52.0, 38.0)
    }
}

/// Converts pixels to SVG units.
pub const fn px(pixels: f64) -> i32 {
    (pixels * UNITS).round() as i32
}

/// Returns the width of a line.
pub const fn stroke(pixels: f64) -> u32 {
    (pixels * UNITS).round() as u32
}

/// Returns a text style of a size in pixels.
pub fn text(pixels: f64, colour: RGBColor) -> TextStyle<'static> {
    // The backend divides by 1.24.
    ("sans-serif", pixels * 1.24 * UNITS).into_font().color(&colour)
}

/// Returns the text style of a type's name next to its panel.
pub fn name(pixels: f64, colour: RGBColor) -> TextStyle<'static> {
    ("sans-serif", pixels * 1.24 * UNITS, FontStyle::Bold).into_font().color(&colour)
}

/// Draws a figure of this height in pixels and returns it as SVG.
pub fn figure(
    format: Format,
    height: f64,
    draw: impl FnOnce(&Area<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<String> {
    let mut svg = String::new();
    {
        let area =
            SVGBackend::with_string(&mut svg, (stroke(format.width()), stroke(height))).into_drawing_area();
        draw(&area)?;
        area.present()?;
    }
    Ok(svg.replace('\n', ""))
}

/// Adds a tooltip to each circle of a figure, in the order in which they were drawn.
pub fn with_tooltips(svg: &str, mut tooltips: impl Iterator<Item = String>) -> String {
    let mut parts = svg.split("<circle ");
    let mut told = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        told.push_str("<circle ");
        match part.split_once("/>").zip(tooltips.next()) {
            Some(((circle, rest), tooltip)) => {
                told.push_str(&format!("{circle}><title>{tooltip}</title></circle>{rest}"));
            }
            None => told.push_str(part),
        }
    }
    told
}

/// Panels of the same height, one below another, each with a line of text above it; all use the last one's horizontal
/// axis.
pub struct Panels {
    /// Height of that line in pixels.
    pub title: f64,
    /// Height of a panel in pixels.
    pub panel: f64,
}

/// One panel.
pub struct Panel<'a> {
    /// Position of its line of text, in pixels from the top of the figure.
    pub top: f64,
    /// The area below that line.
    pub area: Area<'a>,
    /// Whether the horizontal axis is below it.
    pub is_last: bool,
}

impl Panels {
    /// Draws a figure with a panel for each of `all`; `draw` draws a panel and writes its line of text.
    pub fn figure<T>(
        &self,
        format: Format,
        all: &[T],
        draw: impl Fn(&Area<'_>, &Panel<'_>, &T) -> anyhow::Result<()>,
    ) -> anyhow::Result<String> {
        let height = all.len() as f64 * (self.title + self.panel) + ChartAxes::below(true);
        figure(format, height, |whole| {
            for (index, one) in all.iter().enumerate() {
                let is_last = index + 1 == all.len();
                let top = index as f64 * (self.title + self.panel);
                let bottom = if is_last { height } else { top + self.title + self.panel };
                let size = (whole.dim_in_pixel().0, stroke(bottom - top - self.title));
                let area = whole.clone().shrink((0, px(top + self.title)), size);
                draw(whole, &Panel { top, area, is_last }, one)?;
            }
            Ok(())
        })
    }
}

/// Formats a value of an axis.
type Write<'a> = &'a dyn Fn(&f64) -> String;

/// Axes of a panel.
pub struct ChartAxes<'a> {
    /// Range of the horizontal axis.
    pub x: (f64, f64),
    /// Range of the vertical axis.
    pub y: (f64, f64),
    /// Title of the horizontal axis; without one the axis has no labels.
    pub x_title: Option<&'a str>,
    /// Title of the vertical axis.
    pub y_title: &'a str,
    /// Whether the labels of the horizontal axis have lines.
    pub x_lines: bool,
    /// Largest number of labels on each axis.
    pub labels: (usize, usize),
    /// Formats of the values of each axis.
    pub write: (Write<'a>, Write<'a>),
}

impl ChartAxes<'_> {
    /// Width in pixels right of the axes: half of a label is there.
    pub const RIGHT: f64 = 20.0;

    /// Returns the height in pixels of the labels below the horizontal axis.
    pub const fn below(has_title: bool) -> f64 {
        if has_title { 44.0 } else { 6.0 }
    }

    /// Draws the grid and returns the chart for the data.
    pub fn draw<'a, 'b>(&self, format: Format, area: &'a Area<'b>) -> anyhow::Result<Chart<'a, 'b>> {
        let mut builder = ChartBuilder::on(area);
        builder.set_label_area_size(plotters::chart::LabelAreaPosition::Left, px(format.margin()));
        let below = px(Self::below(self.x_title.is_some()));
        if self.x_title.is_some() {
            builder.set_label_area_size(plotters::chart::LabelAreaPosition::Bottom, below);
        } else {
            builder.margin_bottom(below);
        }
        builder.margin_right(px(Self::RIGHT)).margin_top(px(6.0));
        let mut chart = builder.build_cartesian_2d(self.x.0..self.x.1, self.y.0..self.y.1)?;
        let small = format.pick(12.0, 11.0);
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(plotters::style::TRANSPARENT)
            .bold_line_style(GRID.stroke_width(stroke(1.0)))
            .axis_style(AXIS.stroke_width(stroke(1.0)))
            .set_all_tick_mark_size(px(3.0))
            .label_style(text(small, MUTED))
            .x_labels(self.labels.0)
            .y_labels(self.labels.1)
            .x_label_formatter(self.write.0)
            .y_label_formatter(self.write.1)
            .axis_desc_style(text(small, MUTED));
        if !self.x_lines {
            mesh.disable_x_mesh();
        }
        if let Some(title) = self.x_title {
            mesh.x_desc(title);
        }
        mesh.draw()?;
        // A horizontal title above the axis is easier to read.
        if !self.y_title.is_empty() {
            area.draw_text(self.y_title, &text(small, MUTED), (px(2.0), px(-14.0)))?;
        }
        Ok(chart)
    }
}

/// Formats a number with its decimals, at most two.
pub fn short(value: &f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" {
        return "0".to_owned();
    }
    text.trim_end_matches('0').trim_end_matches('.').replace('-', "−")
}

/// Formats a whole number.
pub fn whole(value: &f64) -> String {
    format!("{value:.0}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circles_get_their_tooltips_in_order_and_other_elements_none() {
        let svg = r#"<svg><circle r="1"/><rect/><circle r="2"/><circle r="3"/></svg>"#;
        let told = with_tooltips(svg, ["a", "b"].map(str::to_owned).into_iter());
        let expected = r#"<svg><circle r="1"><title>a</title></circle><rect/><circle r="2"><title>b</title></circle><circle r="3"/></svg>"#;
        assert_eq!(told, expected);
    }
}
