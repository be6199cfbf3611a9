//! The page of an exploration: the worst class at each frame, the counts, and the reasons.

use std::collections::BTreeMap;

use plotters::element::Rectangle;
use plotters::prelude::{Color, RGBColor};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use serde::Serialize;

use super::Exploration;
use super::classes::{Class, Reason};
use report::html::chart::{self, Area, Format, GRID, INK, MUTED, colour, px, text};
use report::html::document::fill;
use report::html::figure::Figure;
use report::progress::label;

const TEMPLATE: &str = include_str!("page.html");

/// Height of a line in pixels.
const LINE: f64 = 18.0;
/// Passes in another time.
const VIOLET: RGBColor = RGBColor(0x6B, 0x5F, 0xC7);

#[derive(Serialize)]
struct Page {
    setup: String,
    title: String,
    conditions: String,
    verdict: String,
    sections: Vec<ExploreSection>,
    head: Vec<&'static str>,
    rows: Vec<Vec<String>>,
    reasons: Vec<ReasonRow>,
}

#[derive(Serialize)]
struct ExploreSection {
    name: String,
    figure: Option<Figure>,
}

#[derive(Serialize)]
struct ReasonRow {
    runs: u64,
    class: &'static str,
    text: String,
    command: String,
}

/// Worst class at each frame, of one station, direction and kind of fault, with its name.
type Line<'a> = (String, &'a BTreeMap<u64, Class>);

impl Exploration<'_> {
    /// Returns the page as HTML.
    ///
    /// # Errors
    ///
    /// The template or a figure is broken.
    pub(super) fn page(&self) -> anyhow::Result<String> {
        let reason_row = |reason: &&Reason| ReasonRow {
            runs: reason.runs,
            class: reason.class.name(),
            text: reason.text.clone(),
            command: self.smallest(reason),
        };
        let sections = self.clean_runs.iter().enumerate().map(|(type_index, clean)| {
            let name = label(clean.execution_type());
            Ok(ExploreSection { name, figure: self.figure(type_index)? })
        });
        let options = self.options;
        let page = Page {
            setup: self.name.to_owned(),
            title: self.about.to_owned(),
            conditions: format!(
                "{} · a frame is held back for {} ms, the cable is cut for {} ms, a node is off for {} ms · late by at most {} ms",
                self.title(),
                options.hold_ms,
                options.cut_ms,
                options.restart_ms,
                options.late_ms
            ),
            verdict: self.verdict(),
            sections: sections.collect::<anyhow::Result<_>>()?,
            head: self.head(),
            rows: self.cells(),
            reasons: self.classes.reasons().iter().map(reason_row).collect(),
        };
        fill(TEMPLATE, &page)
    }

    /// Draws the frames of a type.
    fn figure(&self, type_index: usize) -> anyhow::Result<Option<Figure>> {
        let lines: Vec<Line<'_>> = self
            .classes
            .frames
            .iter()
            .filter(|((known, ..), _)| *known == type_index)
            .map(|((_, station, direction, what), frames)| {
                let to = if *direction == 0 { "to robot" } else { "to PLC" };
                (self.texts.at(*station, " ", &format!("{to}, {}", what.label())), frames)
            })
            .collect();
        let frames = self
            .clean_runs
            .get(type_index)
            .and_then(|clean| clean.extents.iter().flat_map(|extent| extent.frames).max())
            .unwrap_or(0);
        Figure::draw("Worst class at each frame, a line for each direction and kind of fault", |format| {
            draw(&lines, frames, format)
        })
    }
}

fn draw(lines: &[Line<'_>], frames: u64, format: Format) -> anyhow::Result<Option<String>> {
    if lines.is_empty() {
        return Ok(None);
    }
    let size = format.pick(12.0, 10.0);
    let longest = lines.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    // The names of stations make it wider.
    let left = f64::max(size * 13.5, size * 0.56 * longest as f64);
    let height = lines.len() as f64 * LINE + 26.0;
    let room = format.width() - left - 12.0;
    let svg = chart::figure(format, height, |area| {
        for (index, (name, classes)) in lines.iter().enumerate() {
            let top = index as f64 * LINE + 2.0;
            let middle = Pos::new(HPos::Left, VPos::Center);
            area.draw_text(name, &text(size, INK).pos(middle), (px(2.0), px(top + LINE / 2.0)))?;
            for (bins, class) in runs(classes, frames, room as u64) {
                let x = |bin: u64| px(left + bin as f64);
                let bar = [(x(bins[0]), px(top + 3.0)), (x(bins[1]), px(top + LINE - 3.0))];
                area.draw(&Rectangle::new(bar, colour_of(class).filled()))?;
            }
        }
        axis(area, left, room, (frames, height), size)
    })?;
    Ok(Some(svg))
}

/// Writes the first and the last frame below the lines.
fn axis(
    area: &Area<'_>,
    left: f64,
    room: f64,
    (frames, height): (u64, f64),
    size: f64,
) -> anyhow::Result<()> {
    for (x, text_of, side) in
        [(left, "frame 1".to_owned(), HPos::Left), (left + room, frames.to_string(), HPos::Right)]
    {
        let style = text(size, MUTED).pos(Pos::new(side, VPos::Bottom));
        area.draw_text(&text_of, &style, (px(x), px(height - 4.0)))?;
    }
    Ok(())
}

/// Returns the worst class of neighbouring bins of one pixel each, as runs of the same class: first bin, and the one
/// behind the last.
fn runs(classes: &BTreeMap<u64, Class>, frames: u64, bins: u64) -> Vec<([u64; 2], Class)> {
    let mut worst: BTreeMap<u64, Class> = BTreeMap::new();
    for (frame, class) in classes {
        let bin = (frame - 1) * bins / frames.max(1);
        let known = worst.entry(bin).or_insert(*class);
        *known = (*known).max(*class);
    }
    let mut runs: Vec<([u64; 2], Class)> = Vec::new();
    for (bin, class) in worst {
        match runs.last_mut() {
            // Where fewer frames than pixels are tested, each stands for those up to the next.
            Some(([_, end], last)) if *last == class => *end = bin + 1,
            Some(([_, end], _)) => {
                *end = bin;
                runs.push(([bin, bin + 1], class));
            }
            None => runs.push(([bin, bin + 1], class)),
        }
    }
    runs
}

const fn colour_of(class: Class) -> RGBColor {
    match class {
        Class::Same => GRID,
        Class::Late => VIOLET,
        Class::Refused => colour(plc_node::ExecutionType::Rc),
        Class::TooLate | Class::Stuck | Class::Altered | Class::LawBroken | Class::Panicked => {
            colour(plc_node::ExecutionType::Sm)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_one_pixel_show_the_worst_of_them_and_neighbours_of_one_class_are_one_bar() {
        let frames =
            [(1, Class::Same), (2, Class::Refused), (3, Class::Same), (5, Class::Same), (8, Class::Stuck)];
        let bars = runs(&frames.into(), 8, 4);
        assert_eq!(bars, [([0, 1], Class::Refused), ([1, 3], Class::Same), ([3, 4], Class::Stuck)]);
    }
}
