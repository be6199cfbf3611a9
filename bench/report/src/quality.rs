//! Quality of the arm's motion, as a table.

use node::screen;
use plc_node::ExecutionType;

use super::progress::label;
use records::quality::{Load, MotionQuality};
use records::results::Results;

/// The shown quantities, with their units.
pub const COLUMNS: [[&str; 2]; 7] = [
    ["off path", "mm"],
    ["stops", ""],
    ["acceleration", "m/s²"],
    ["jerk", "m/s³"],
    ["worst joint", "% of rated"],
    ["worst jerk", "% of rated"],
    ["energy proxy", "ms"],
];

/// Formats the columns for the screen and for the report, in the units of [`COLUMNS`].
#[must_use]
pub fn cells(quality: &MotionQuality) -> [String; COLUMNS.len()] {
    let stops = quality.stops;
    let pair = |load: Load, unit: f64| {
        let digits = if load.peak / unit < 10.0 { 2 } else { 0 };
        format!("{:.digits$} / {:.digits$}", load.peak / unit, load.rms / unit)
    };
    [
        format!("{:.2}", quality.path_deviation_mm),
        if stops.fract() == 0.0 { format!("{stops:.0}") } else { format!("{stops:.1}") },
        pair(quality.tool_acceleration_mm_s2, 1e3),
        pair(quality.tool_jerk_mm_s3, 1e3),
        pair(quality.joint_acceleration, 1e-2),
        pair(quality.joint_jerk, 1e-2),
        format!("{:.2}", quality.energy_proxy_s * 1e3),
    ]
}

/// Meaning of the columns, in sentences.
pub const LEGEND: [&str; 3] = [
    "Peak / root mean square over the time in which the arm moves, by differences from one robot cycle to the next.",
    "Worst joint: the one nearest to its rated acceleration; worst jerk: of the joint nearest to its rated jerk.",
    "Energy proxy: sum over the joints of ∫ |acceleration · speed| dt, each by its rated value: ms at rated power.",
];

/// Returns a sentence on how much more single skills cost than one MoveContinuousSkill; `None` if either is missing.
#[must_use]
pub fn summary(results: &Results) -> Option<String> {
    let quality = |execution_type| results.results.get(execution_type).and_then(|result| result.quality);
    let (sm, cm) = (quality(ExecutionType::Sm)?, quality(ExecutionType::Cm)?);
    if cm.energy_proxy_s <= 0.0 {
        return None;
    }
    let more = (sm.energy_proxy_s / cm.energy_proxy_s - 1.0) * 100.0;
    let word = if more < 0.0 { "less" } else { "more" };
    Some(format!(
        "SM stops the arm {:.0} times between start and end, CM {:.0} times; to accelerate and brake it SM costs {:.0}\u{a0}% \
         {word} by the energy proxy.",
        sm.stops,
        cm.stops,
        more.abs()
    ))
}

/// Formats the second table of the screen; `None` if the robot did not report the quality of its motion.
#[must_use]
pub fn table(results: &Results) -> Option<String> {
    let mut table = screen::ruled();
    let header =
        COLUMNS.map(|[name, unit]| if unit.is_empty() { name.to_owned() } else { format!("{name}\n{unit}") });
    table.set_header(std::iter::once("motion".to_owned()).chain(header));
    let mut is_empty = true;
    for execution_type in ExecutionType::ALL {
        let Some(quality) = results.results.get(execution_type).and_then(|result| result.quality) else {
            continue;
        };
        table.add_row(std::iter::once(label(execution_type)).chain(cells(&quality)));
        is_empty = false;
    }
    let sentences: Vec<String> = summary(results).into_iter().chain(LEGEND.map(str::to_owned)).collect();
    let sentences: Vec<_> = sentences.iter().map(|sentence| screen::wrapped(sentence, 2, 2)).collect();
    let table = screen::drawn(&screen::numbers_right(table));
    (!is_empty).then(|| format!("{table}\n\n{}", sentences.join("\n")))
}
