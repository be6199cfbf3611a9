//! How well the arm moved in the runs of one type, as results and as a table. What is measured, and how, says
//! [`robot_node::quality`].

use plc_node::ExecutionType;
use robot_node::Quality;
use serde::{Deserialize, Serialize};

use crate::progress::label;
use crate::results::Results;
use crate::table::{self, drawn, styled};

/// How well the arm moved: of peaks the highest of all repetitions, of the rest the mean.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MotionQuality {
    /// Repetitions that are in it.
    pub repetitions: u32,
    /// Farthest that the tool was from the programmed curves, in mm.
    pub path_deviation_mm: f64,
    /// How often the arm stopped between start and end.
    pub stops: f64,
    /// Acceleration of the tool, in mm/s².
    pub tool_acceleration_mm_s2: Load,
    /// Jerk of the tool, in mm/s³.
    pub tool_jerk_mm_s3: Load,
    /// Acceleration of the joint that is nearest to its limit, as a share of its rated acceleration.
    pub joint_acceleration: Load,
    /// Jerk of the joint that is nearest to its limit, as a share of its rated jerk.
    pub joint_jerk: Load,
    /// What stands for energy and wear, in s at rated power: the sum over all joints of ∫ |q̈ · q̇| dt, divided by the
    /// joint's rated speed and rated acceleration.
    pub energy_proxy_s: f64,
}

/// Peak and root mean square over the time in which the arm moved.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Load {
    /// Highest value.
    pub peak: f64,
    /// Root mean square.
    pub rms: f64,
}

impl MotionQuality {
    /// Takes up one more repetition.
    pub fn record(&mut self, of: &Quality) {
        let before = f64::from(self.repetitions);
        let mean = |mean: f64, value: f64| (mean * before + value) / (before + 1.0);
        let load = |load: &mut Load, of_run: robot_node::quality::Load| {
            load.peak = load.peak.max(of_run.peak);
            load.rms = mean(load.rms, of.rms(of_run));
        };
        load(&mut self.tool_acceleration_mm_s2, of.tool_acceleration);
        load(&mut self.tool_jerk_mm_s3, of.tool_jerk);
        load(&mut self.joint_acceleration, of.joint_acceleration);
        load(&mut self.joint_jerk, of.joint_jerk);
        self.path_deviation_mm = self.path_deviation_mm.max(of.path_deviation_mm);
        self.stops = mean(self.stops, f64::from(of.stops()));
        self.energy_proxy_s = mean(self.energy_proxy_s, of.energy_proxy_s);
        self.repetitions += 1;
    }

    /// The columns that both the screen and the report show, in the units of [`COLUMNS`].
    #[must_use]
    pub fn cells(&self) -> [String; COLUMNS.len()] {
        let stops = self.stops;
        let pair = |load: Load, unit: f64| {
            let digits = if load.peak / unit < 10.0 { 2 } else { 0 };
            format!("{:.digits$} / {:.digits$}", load.peak / unit, load.rms / unit)
        };
        [
            format!("{:.2}", self.path_deviation_mm),
            if stops.fract() == 0.0 { format!("{stops:.0}") } else { format!("{stops:.1}") },
            pair(self.tool_acceleration_mm_s2, 1e3),
            pair(self.tool_jerk_mm_s3, 1e3),
            pair(self.joint_acceleration, 1e-2),
            pair(self.joint_jerk, 1e-2),
            format!("{:.2}", self.energy_proxy_s * 1e3),
        ]
    }
}

/// What is shown, with its unit.
pub const COLUMNS: [[&str; 2]; 7] = [
    ["off path", "mm"],
    ["stops", ""],
    ["acceleration", "m/s²"],
    ["jerk", "m/s³"],
    ["worst joint", "% of rated"],
    ["worst jerk", "% of rated"],
    ["energy proxy", "ms"],
];

/// What the columns mean, in sentences.
pub const LEGEND: [&str; 3] = [
    "Peak / root mean square over the time in which the arm moves, by differences from one robot cycle to the next.",
    "Worst joint: the one nearest to its rated acceleration; worst jerk: of the joint nearest to its rated jerk.",
    "Energy proxy: sum over the joints of ∫ |acceleration · speed| dt, each by its rated value: ms at rated power.",
];

/// What single skills cost more than one MoveContinuousSkill, in a sentence; none without both.
#[must_use]
pub fn summary(results: &Results) -> Option<String> {
    let quality = |of| results.results.get(of).and_then(|result| result.quality);
    let (sm, cm) = (quality(ExecutionType::Sm)?, quality(ExecutionType::Cm)?);
    if cm.energy_proxy_s <= 0.0 {
        return None;
    }
    let more = (sm.energy_proxy_s / cm.energy_proxy_s - 1.0) * 100.0;
    let word = if more < 0.0 { "less" } else { "more" };
    Some(format!(
        "Single skills stop the arm {:.0} times between start and end, one MoveContinuousSkill {:.0} times; to accelerate and \
         brake it they cost {:.0} % {word} by the energy proxy.",
        sm.stops,
        cm.stops,
        more.abs()
    ))
}

/// The second table on screen; none where no robot said how it moved.
#[must_use]
pub fn table(results: &Results) -> Option<String> {
    let mut table = styled();
    let header =
        COLUMNS.map(|[name, unit]| if unit.is_empty() { name.to_owned() } else { format!("{name}\n{unit}") });
    table.set_header(std::iter::once("motion".to_owned()).chain(header));
    let mut is_empty = true;
    for of in ExecutionType::ALL {
        let Some(quality) = results.results.get(of).and_then(|result| result.quality) else { continue };
        table.add_row(std::iter::once(label(of)).chain(quality.cells()));
        is_empty = false;
    }
    let sentences: Vec<String> = summary(results).into_iter().chain(LEGEND.map(str::to_owned)).collect();
    (!is_empty)
        .then(|| format!("{}\n\n{}", drawn(table), table::sentences(sentences.iter().map(String::as_str))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(peak: f64, rests: u32, energy_proxy_s: f64) -> Quality {
        let load = robot_node::quality::Load { peak, square_s: 8.0 };
        Quality {
            moving_s: 2.0,
            rests,
            energy_proxy_s,
            tool_jerk: load,
            path_deviation_mm: peak,
            ..Quality::default()
        }
    }

    #[test]
    fn of_peaks_the_highest_counts_and_of_the_rest_the_mean() {
        let mut quality = MotionQuality::default();
        for run in [run(5.0, 3, 0.1), run(3.0, 4, 0.2)] {
            quality.record(&run);
        }
        assert_eq!((quality.repetitions, quality.stops, quality.path_deviation_mm), (2, 2.5, 5.0));
        assert_eq!(quality.tool_jerk_mm_s3, Load { peak: 5.0, rms: 2.0 });
        assert!((quality.energy_proxy_s - 0.15).abs() < 1e-12);
    }
}
