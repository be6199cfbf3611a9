//! Pictures of a report: a figure by the values of a key, and the posterior of two keys.

use plc_node::ExecutionType;
use plotters::element::{Circle, PathElement};
use plotters::prelude::Color;
use plotters::style::RGBColor;
use report::html::chart::{self, ChartAxes, Format, INK, MUTED, Panels, colour, px, short, stroke, text};
use report::html::figure::Figure;

use super::effects::FigureEffect;
use crate::engine::identify::{DrawnPrior, ModelVariant};

/// Height of a panel and of the line above it, in pixels.
const PANEL: Panels = Panels { title: 24.0, panel: 150.0 };

/// Share of a range that is added at its ends.
const ROOM: f64 = 0.06;

fn colour_of(effect: &FigureEffect) -> RGBColor {
    let execution_type = effect.execution_type.as_ref().and_then(|name| name.parse::<ExecutionType>().ok());
    execution_type.map_or(INK, colour)
}

/// Name of a series: its type, if it is of one.
fn series_name(effect: &FigureEffect) -> String {
    let figure = effect.figure;
    let unit = if effect.unit.is_empty() { String::new() } else { format!(" in {}", effect.unit) };
    let of_type =
        effect.execution_type.as_ref().map_or_else(String::new, |name| format!("{} ", name.to_uppercase()));
    format!("{of_type}{figure}{unit}")
}

/// Positions of the levels: their numbers, or one after the other for texts.
fn positions(effect: &FigureEffect) -> Vec<f64> {
    let numbers: Option<Vec<f64>> = effect.levels.iter().map(|level| level.number).collect();
    numbers.unwrap_or_else(|| (0..effect.levels.len()).map(|index| index as f64).collect())
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    let room = if high > low { (high - low) * ROOM } else { high.abs().max(1.0) * ROOM };
    (low - room, high + room)
}

/// Draws figures by the values of a key: a panel for each, with the 95 % intervals of the means.
pub(super) fn by_key(key: &str, effects: &[&FigureEffect]) -> anyhow::Result<Option<Figure>> {
    let shown: Vec<&FigureEffect> =
        effects.iter().copied().filter(|effect| effect.levels.len() > 1).collect();
    let about = shown.first().map_or("", |effect| effect.figure);
    Figure::draw(&format!("{about} by {key}, with 95 % intervals"), |format| {
        if shown.is_empty() {
            return Ok(None);
        }
        PANEL
            .figure(format, &shown, |whole, panel, effect| {
                let place = (px(2.0), px(panel.top + 5.0));
                whole.draw_text(&series_name(effect), &chart::name(13.0, colour_of(effect)), place)?;
                draw_levels(format, &panel.area, panel.is_last.then_some(key), effect)
            })
            .map(Some)
    })
}

fn draw_levels(
    format: Format,
    area: &chart::Area<'_>,
    title: Option<&str>,
    effect: &FigureEffect,
) -> anyhow::Result<()> {
    let places = positions(effect);
    let is_text = effect.levels.iter().any(|level| level.number.is_none());
    let name = |place: &f64| {
        let index = libm::round(*place);
        let level =
            effect.levels.get(index as usize).filter(|_| (place - index).abs() < 1e-6 && index >= 0.0);
        level.map_or_else(String::new, |level| level.value.clone())
    };
    let ends = effect.levels.iter().flat_map(|level| {
        let margin = level.mean.margin.unwrap_or_default();
        [level.mean.value - margin, level.mean.value + margin]
    });
    let axes = ChartAxes {
        x: range(places.iter().copied()),
        y: range(ends),
        x_title: title,
        y_title: "",
        x_lines: false,
        labels: (format.pick(8, 4), 4),
        write: (if is_text { &name } else { &short }, &short),
    };
    let mut chart = axes.draw(format, area)?;
    let ink = colour_of(effect);
    let middle = places.iter().zip(&effect.levels).map(|(place, level)| (*place, level.mean.value));
    if !is_text {
        chart.draw_series([PathElement::new(
            middle.clone().collect::<Vec<_>>(),
            ink.mix(0.5).stroke_width(stroke(1.2)),
        )])?;
    }
    for ((place, value), level) in middle.zip(&effect.levels) {
        if let Some(margin) = level.mean.margin {
            let bar = vec![(place, value - margin), (place, value + margin)];
            chart.draw_series([PathElement::new(bar, ink.stroke_width(stroke(1.6)))])?;
        }
        chart.draw_series([Circle::new((place, value), px(3.0), ink.filled())])?;
    }
    Ok(())
}

/// Draws the posteriors of all drawn keys as bars within their priors.
pub(super) fn posteriors(priors: &[DrawnPrior], variant: &ModelVariant) -> anyhow::Result<Option<Figure>> {
    Figure::draw("95 % interval of the posterior of each key within its prior", |format| {
        let size = format.pick(13.0, 11.0);
        let (left, line) = (size * format.pick(17.0, 14.0), 26.0);
        let room = format.width() - left - 20.0;
        let svg = chart::figure(format, priors.len() as f64 * line + 8.0, |area| {
            for (index, (prior, found)) in priors.iter().zip(&variant.posterior).enumerate() {
                let middle = index as f64 * line + 4.0 + line / 2.0;
                let x = |value: f64| px(left + (value - prior.min) / (prior.max - prior.min) * room);
                let bar = |[from, to]: [f64; 2]| vec![(x(from), px(middle)), (x(to), px(middle))];
                area.draw_text(&prior.key, &text(size, INK), (px(2.0), px(middle - size / 2.0)))?;
                area.draw(&PathElement::new(
                    bar([prior.min, prior.max]),
                    chart::GRID.stroke_width(stroke(9.0)),
                ))?;
                area.draw(&PathElement::new(
                    bar(found.interval),
                    colour(ExecutionType::Rc).stroke_width(stroke(9.0)),
                ))?;
                area.draw(&Circle::new((x(found.mean), px(middle)), px(2.5), INK.filled()))?;
            }
            Ok(())
        })?;
        Ok(Some(svg))
    })
}

/// Draws the posterior of two keys, a point for each draw.
pub(super) fn pair(
    priors: &[DrawnPrior],
    variant: &ModelVariant,
    keys: [usize; 2],
) -> anyhow::Result<Option<Figure>> {
    let Some((first, second)) = priors.get(keys[0]).zip(priors.get(keys[1])) else { return Ok(None) };
    let points: Vec<(f64, f64)> =
        variant.draws.iter().filter_map(|draw| Some((*draw.get(keys[0])?, *draw.get(keys[1])?))).collect();
    Figure::draw(&format!("Posterior of {} and {}, a point for each draw", first.key, second.key), |format| {
        let svg = chart::figure(format, 280.0, |area| {
            area.draw_text(&second.key, &text(12.0, MUTED), (px(2.0), px(2.0)))?;
            let inner = area.clone().shrink((0, px(18.0)), (area.dim_in_pixel().0, stroke(262.0)));
            let axes = ChartAxes {
                x: (first.min, first.max),
                y: (second.min, second.max),
                x_title: Some(&first.key),
                y_title: "",
                x_lines: true,
                labels: (format.pick(8, 4), 6),
                write: (&short, &short),
            };
            let mut chart = axes.draw(format, &inner)?;
            let ink = colour(ExecutionType::Rc).mix(0.5);
            chart.draw_series(points.iter().map(|point| Circle::new(*point, px(2.0), ink.filled())))?;
            Ok(())
        })?;
        Ok(Some(svg))
    })
}
