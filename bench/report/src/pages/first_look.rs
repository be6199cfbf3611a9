//! The first look at a run: a bar for each type with its confidence interval beside the paper's, and the difference of CM and
//! RC magnified.

use plc_node::ExecutionType;
use serde::Serialize;

use crate::figures::signed;
use crate::html::chart::{Format, short};
use crate::progress::label;
use records::interval::Mean;
use records::results::Results;
use records::schedule::REPETITIONS;
use records::statistics::AetMad;

/// The picture in both widths, and the same as a table.
#[derive(Serialize)]
pub(super) struct FirstLook {
    wide: Bars,
    narrow: Bars,
    rows: Vec<[String; 4]>,
    has_paper: bool,
    has_intervals: bool,
}

/// The picture in one width. Lengths are in pixels.
#[derive(Serialize)]
struct Bars {
    width: f64,
    height: f64,
    /// Size of the text.
    text: f64,
    left: f64,
    top: f64,
    bottom: f64,
    ticks: Vec<(f64, String)>,
    types: Vec<OfType>,
    strip: Option<Strip>,
}

#[derive(Serialize)]
struct OfType {
    key: String,
    name: String,
    how: String,
    y: f64,
    bars: Vec<Bar>,
}

/// A bar, or a mark of the strip.
#[derive(Serialize)]
struct Bar {
    /// `ours` or `paper`.
    origin: &'static str,
    y: f64,
    height: f64,
    /// Where it ends.
    end: f64,
    /// The ends of its interval.
    interval: Option<(f64, f64)>,
    text: String,
    /// What the pointer shows.
    tooltip: String,
}

/// The difference of CM and RC on an axis of its own.
#[derive(Serialize)]
struct Strip {
    top: f64,
    zero: f64,
    bottom: f64,
    ticks: Vec<(f64, String)>,
    marks: Vec<Bar>,
}

/// A mean as it is drawn: its interval is missing with too few samples.
#[derive(Clone, Copy)]
struct Shown {
    ms: f64,
    mean: Option<Mean>,
}

impl Shown {
    fn of_run(results: &Results, execution_type: ExecutionType) -> Option<Self> {
        let ms = results.figure(execution_type)?.aet_ms;
        Some(Self { ms, mean: Mean::of(&results.results.get(execution_type)?.samples_ms) })
    }

    fn of_paper(results: &Results, execution_type: ExecutionType) -> Option<Self> {
        let AetMad { aet_ms, mad_ms } = *results.paper.as_ref()?.get(execution_type)?;
        Some(Self { ms: aet_ms, mean: Mean::published(aet_ms, mad_ms, REPETITIONS) })
    }

    fn text(&self, digits: usize) -> String {
        let Self { ms, mean } = self;
        match mean {
            Some(mean) => format!("{ms:.digits$} ± {:.1} ms", mean.margin_ms()),
            None => format!("{ms:.digits$} ms"),
        }
    }

    fn interval(&self) -> String {
        self.mean.map_or_else(|| "–".to_owned(), |mean| range(mean.interval_ms()))
    }
}

pub(super) fn range((low, high): (f64, f64)) -> String {
    format!("{low:.1} to {high:.1}").replace('-', "−")
}

pub(super) fn signed_range((low, high): (f64, f64)) -> String {
    format!("{} to {}", signed(low), signed(high))
}

const TYPES: [ExecutionType; 3] = ExecutionType::ALL;

/// Returns how a type runs the sequence, in a few words; CM with so many skills.
pub(super) fn how(execution_type: ExecutionType, continuous: Option<usize>) -> String {
    match (execution_type, continuous) {
        (ExecutionType::Rc, _) => "robot program".to_owned(),
        (ExecutionType::Sm, _) => "single skills".to_owned(),
        (ExecutionType::Cm, Some(1)) => "one MoveContinuousSkill".to_owned(),
        (ExecutionType::Cm, Some(count)) => format!("{count} MoveContinuousSkills"),
        (ExecutionType::Cm, None) => "MoveContinuousSkills".to_owned(),
    }
}

impl FirstLook {
    /// Returns the picture; `None` without a sample. `continuous` is the number of CM's skills.
    pub(super) fn of(results: &Results, continuous: Option<usize>) -> Option<Self> {
        let of_run: Vec<_> = TYPES
            .iter()
            .filter_map(|execution_type| Some((*execution_type, Shown::of_run(results, *execution_type)?)))
            .collect();
        if of_run.is_empty() {
            return None;
        }
        let row = |(execution_type, shown): &(ExecutionType, Shown)| {
            let paper = Shown::of_paper(results, *execution_type);
            [
                label(*execution_type),
                format!("{:.1}", shown.ms),
                shown.interval(),
                paper.map_or_else(
                    || "–".to_owned(),
                    |paper| format!("{:.0} ({})", paper.ms, paper.interval()),
                ),
            ]
        };
        let difference = differences(results).into_iter().map(|(execution_type, mean)| {
            (execution_type, signed(mean.ms), signed_range(mean.interval_ms()))
        });
        let mut rows: Vec<_> = of_run.iter().map(row).collect();
        let differences: Vec<_> = difference.collect();
        if let Some((_, ms, interval)) = differences.first() {
            let paper = differences.get(1).map(|(_, ms, interval)| format!("{ms} ({interval})"));
            rows.push([
                "CM − RC".to_owned(),
                ms.clone(),
                interval.clone(),
                paper.unwrap_or_else(|| "–".to_owned()),
            ]);
        }
        Some(Self {
            wide: Bars::of(results, &of_run, continuous, Format::Wide),
            narrow: Bars::of(results, &of_run, continuous, Format::Narrow),
            rows,
            has_paper: results.paper.is_some(),
            has_intervals: of_run.iter().any(|(_, shown)| shown.mean.is_some()),
        })
    }
}

/// Returns CM − RC of the run, then of the paper; nothing if the run has no interval.
pub(super) fn differences(results: &Results) -> Vec<(&'static str, Mean)> {
    let difference = |shown: &dyn Fn(ExecutionType) -> Option<Shown>| {
        let [cm, rc] = [ExecutionType::Cm, ExecutionType::Rc].map(shown);
        Some(cm?.mean?.less(rc?.mean?))
    };
    let Some(run) = difference(&|execution_type| Shown::of_run(results, execution_type)) else {
        return Vec::new();
    };
    let paper = difference(&|execution_type| Shown::of_paper(results, execution_type));
    [Some(("ours", run)), paper.map(|paper| ("paper", paper))].into_iter().flatten().collect()
}

impl Bars {
    fn of(
        results: &Results,
        types: &[(ExecutionType, Shown)],
        continuous: Option<usize>,
        format: Format,
    ) -> Self {
        let width = format.width();
        let text = format.pick(14.0, 12.0);
        let (left, top) = (2.0, 4.0);
        let papers = types.iter().map(|(execution_type, _)| Shown::of_paper(results, *execution_type));
        let longest = types.iter().map(|(_, shown)| shown.ms).chain(papers.flatten().map(|paper| paper.ms));
        let longest = longest.fold(1.0, f64::max);
        // Behind the longest bar there is room for its figure.
        let room = width - left - text * format.pick(13.0, 12.4);
        let x = |ms: f64| left + ms / longest * room;
        let (name, own, other) = (text * 1.75, format.pick(22.0, 18.0), format.pick(15.0, 14.0));
        let mut y = top;
        let mut drawn = Vec::new();
        for (execution_type, shown) in types {
            let bar = |origin: &'static str, shown: &Shown, y, height, tooltip| Bar {
                origin,
                y,
                height,
                end: x(shown.ms),
                interval: shown.mean.map(|mean| mean.interval_ms()).map(|(low, high)| (x(low), x(high))),
                text: if origin == "paper" { format!("paper {}", shown.text(0)) } else { shown.text(1) },
                tooltip,
            };
            let from = y + name;
            let mut bars = vec![bar(
                "ours",
                shown,
                from,
                own,
                format!(
                    "{}, this run: {}, n = {}",
                    label(*execution_type),
                    shown.text(1),
                    count(results, *execution_type)
                ),
            )];
            if let Some(paper) = Shown::of_paper(results, *execution_type) {
                let tooltip =
                    format!("{}, paper: {}, n = {REPETITIONS}", label(*execution_type), paper.text(1));
                bars.push(bar("paper", &paper, from + own + 2.0, other, tooltip));
            }
            let end = bars.last().map_or(from, |bar| bar.y + bar.height);
            drawn.push(OfType {
                key: execution_type.to_string(),
                name: label(*execution_type),
                how: how(*execution_type, continuous),
                y: y + name - text * 0.5,
                bars,
            });
            y = end + text * 0.6;
        }
        let bottom = y;
        let step = step(longest, format.pick(8.0, 4.0));
        let ticks = (0..=(longest / step) as u32).map(|count| f64::from(count) * step);
        let ticks = ticks.map(|ms| (x(ms), short(&ms))).collect();
        let below = bottom + text * 2.1;
        let strip = Strip::of(results, format, text, below);
        let height = strip.as_ref().map_or(below, |strip| strip.bottom + text * 2.1);
        Self { width, height, text, left, top, bottom, ticks, types: drawn, strip }
    }
}

fn count(results: &Results, execution_type: ExecutionType) -> usize {
    results.results.get(execution_type).map_or(0, |result| result.samples_ms.len())
}

impl Strip {
    fn of(results: &Results, format: Format, text: f64, above: f64) -> Option<Self> {
        let differences = differences(results);
        if differences.is_empty() {
            return None;
        }
        let ends = differences.iter().map(|(_, mean)| mean.interval_ms());
        let farthest = ends.fold(1.0_f64, |far, (low, high)| far.max(low.abs()).max(high.abs()));
        let width = format.width();
        let room = (width - text * format.pick(16.0, 12.5)) / 2.0;
        let zero = 2.0 + room;
        let x = |ms: f64| zero + ms / (farthest * 1.1) * room;
        let top = above + text * 2.4;
        let (line, between) = (format.pick(16.0, 14.0), format.pick(8.0, 6.0));
        let mark = |(index, (origin, mean)): (usize, &(&'static str, Mean))| {
            let (low, high) = mean.interval_ms();
            let ms = signed(mean.ms);
            let margin = mean.margin_ms();
            let name = if *origin == "paper" { "paper " } else { "" };
            Bar {
                origin,
                y: top + between / 2.0 + index as f64 * (line + between),
                height: line,
                end: x(mean.ms),
                interval: Some((x(low), x(high))),
                text: format!("{name}{ms} ± {margin:.1} ms"),
                tooltip: format!(
                    "CM − RC, {}: {ms} ms, 95 % interval {} ms",
                    if *origin == "paper" { "paper" } else { "this run" },
                    signed_range((low, high))
                ),
            }
        };
        let marks: Vec<_> = differences.iter().enumerate().map(mark).collect();
        let bottom = top + marks.len() as f64 * (line + between);
        let step = step(farthest, format.pick(4.0, 2.0));
        let each = (farthest / step) as i32;
        let ticks =
            (-each..=each).map(|count| f64::from(count) * step).map(|ms| (x(ms), short(&ms))).collect();
        Some(Self { top, zero, bottom, ticks, marks })
    }
}

/// Returns a round step so that at most so many fit.
fn step(longest: f64, most: f64) -> f64 {
    let rough = longest / most;
    let power = libm::pow(10.0, libm::floor(libm::log10(rough)));
    [1.0, 2.0, 5.0, 10.0]
        .map(|factor| factor * power)
        .into_iter()
        .find(|step| *step >= rough)
        .unwrap_or(rough)
}
