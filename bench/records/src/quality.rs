//! Quality of the arm's motion in all runs of a type. How each figure is measured: [`robot_node::quality`].

use robot_node::Quality;
use serde::{Deserialize, Serialize};

/// Quality of the arm's motion: the highest peak of all repetitions, and the mean of all other figures.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MotionQuality {
    /// Number of repetitions.
    pub repetitions: u32,
    /// Largest distance of the tool from the programmed curves, in mm.
    pub path_deviation_mm: f64,
    /// Number of stops between start and end.
    pub stops: f64,
    /// Acceleration of the tool, in mm/s².
    pub tool_acceleration_mm_s2: Load,
    /// Jerk of the tool, in mm/s³.
    pub tool_jerk_mm_s3: Load,
    /// Speed of the joint closest to its limit, relative to its rated speed; 0 in a run of an older version.
    #[serde(default)]
    pub joint_speed: Load,
    /// Acceleration of the joint closest to its limit, relative to its rated acceleration.
    pub joint_acceleration: Load,
    /// Jerk of the joint closest to its limit, relative to its rated jerk.
    pub joint_jerk: Load,
    /// Proxy for energy and wear, in s at rated power: the sum over all joints of ∫ |q̈ · q̇| dt, divided by the
    /// joint's rated speed and rated acceleration.
    pub energy_proxy_s: f64,
}

/// Peak and root mean square while the arm moved.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Load {
    /// Highest value.
    pub peak: f64,
    /// Root mean square.
    pub rms: f64,
}

impl MotionQuality {
    /// Adds one more repetition.
    pub fn record(&mut self, quality: &Quality) {
        let before = f64::from(self.repetitions);
        let mean = |mean: f64, value: f64| (mean * before + value) / (before + 1.0);
        let load = |load: &mut Load, of_run: robot_node::quality::Load| {
            load.peak = load.peak.max(of_run.peak);
            load.rms = mean(load.rms, quality.rms(of_run));
        };
        load(&mut self.tool_acceleration_mm_s2, quality.tool_acceleration);
        load(&mut self.tool_jerk_mm_s3, quality.tool_jerk);
        load(&mut self.joint_speed, quality.joint_speed);
        load(&mut self.joint_acceleration, quality.joint_acceleration);
        load(&mut self.joint_jerk, quality.joint_jerk);
        self.path_deviation_mm = self.path_deviation_mm.max(quality.path_deviation_mm);
        self.stops = mean(self.stops, f64::from(quality.stops()));
        self.energy_proxy_s = mean(self.energy_proxy_s, quality.energy_proxy_s);
        self.repetitions += 1;
    }
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
    fn peaks_are_maxima_and_all_other_figures_are_means() {
        let mut quality = MotionQuality::default();
        for run in [run(5.0, 3, 0.1), run(3.0, 4, 0.2)] {
            quality.record(&run);
        }
        assert_eq!((quality.repetitions, quality.stops, quality.path_deviation_mm), (2, 2.5, 5.0));
        assert_eq!(quality.tool_jerk_mm_s3, Load { peak: 5.0, rms: 2.0 });
        assert!((quality.energy_proxy_s - 0.15).abs() < 1e-12);
    }
}
