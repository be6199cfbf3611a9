//! The result of a calibration: lines for the setup's file, and the figures that the setup then has.

use std::fmt::Write as _;

use setup::{Paper, Provenance, Setup};

use super::Speed;
use super::fit::Fit;
use super::metric::{Metric, Seeds};
use super::parameter::Parameter;
use records::distance::Estimate;
use records::schedule::REPETITIONS;
use records::statistics::error_of_mad;
use report::figures::signed;

/// A number, and the value that follows from the figures.
#[derive(Clone, PartialEq, Debug)]
pub struct Found {
    /// Which number.
    pub number: Parameter,
    /// Its value in the calibrated setup.
    pub value: f64,
    /// Its source in the setup; only a calibrated number is changed.
    pub from: Provenance,
    /// The value that follows from the figures.
    pub fit: Fit,
}

/// The conditions of a calibration.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Conditions {
    pub(super) seeds: u32,
    pub(super) reps: u32,
}

impl Conditions {
    pub(super) const fn of(seeds: Seeds<'_>) -> Self {
        Self { seeds: seeds.count, reps: seeds.reps }
    }
}

/// The result of a calibration.
#[derive(Clone, PartialEq, Debug)]
pub struct Calibration {
    /// The setup with the numbers that were found.
    pub setup: Setup,
    /// The numbers.
    pub found: Vec<Found>,
    /// The figures of the setup, over all seeds.
    pub reached: Vec<(Metric, Estimate)>,
    /// How RC's AET depends on programmed speed and acceleration.
    pub speed: Speed,
    pub(super) paper: Paper,
    pub(super) conditions: Conditions,
}

impl Found {
    /// Returns the range in which the figures stay within their errors.
    pub(super) fn range(&self) -> (f64, f64) {
        let Fit { value, known_to, .. } = self.fit;
        let (lowest, highest, _) = self.number.range();
        ((value - known_to).max(lowest), (value + known_to).min(highest))
    }

    /// Returns that range with two digits of the error.
    pub(super) fn interval(&self) -> String {
        let (from, to) = self.range();
        let known_to = self.fit.known_to;
        format!("{} to {}", with_digits_of(from, known_to), with_digits_of(to, known_to))
    }

    /// Returns why the value is beside that range; empty where it is in it. The range is that of a straight line.
    fn beside(&self, figure: &str) -> String {
        let (from, to) = self.range();
        if (from..=to).contains(&self.value) {
            return String::new();
        }
        format!(
            "; {figure} changes in steps, and of the values at the nearest step {:?} has the fewest digits",
            self.value
        )
    }
}

/// Formats a value to the digit that `error` has first; to the next one if that is a 1.
fn with_digits_of(value: f64, error: f64) -> String {
    let places = (0..7).find(|places| error * f64::from(10_u32.pow(*places)) >= 1.5).unwrap_or(7);
    if places > 0 || error < 15.0 {
        return format!("{value:.*}", places as usize);
    }
    let step = (0..7).map(|power| f64::from(10_u32.pow(power))).take_while(|step| error / step >= 1.5).last();
    let step = step.unwrap_or(1.0);
    format!("{:.0}", (value / step).round() * step)
}

impl Calibration {
    /// Returns the value of a number as it stands in a setup.
    pub(super) fn value(found: &Found) -> String {
        match found.number {
            Parameter::Velocity => format!("{:?}", found.value),
            _ => format!("{:.0}", found.value),
        }
    }

    /// Returns the note of a number in a setup: the figures that it was found from, and how well it is known.
    pub(super) fn note(&self, found: &Found) -> String {
        let seeds = self.conditions.seeds;
        let interval = found.interval();
        let figures = match found.number {
            Parameter::Quantum if self.setup.robot.start_quantum_us.is_some() => "SM's MAD",
            Parameter::Quantum => "the MADs of RC and SM",
            Parameter::StartQuantum => "RC's MAD",
            Parameter::Velocity => "RC's AET",
            Parameter::Overhead => "SM's AET",
            Parameter::StartCycles => "CM's AET minus RC's AET",
        };
        let assumed = match found.number {
            Parameter::Velocity => format!(" at the assumed acceleration, {}", self.beside_acceleration()),
            _ => String::new(),
        };
        let beside = found.beside(figures);
        format!("`bench calibrate` on {figures}, {seeds} seeds: {interval}{assumed}{beside}")
    }

    /// Returns a sentence on how much speed has the same effect as one percent of acceleration.
    fn beside_acceleration(&self) -> String {
        let Speed { by_velocity_ms, by_acceleration_ms, .. } = self.speed;
        if by_velocity_ms >= -0.05 {
            return "on which alone RC's AET depends here".to_owned();
        }
        let percent = by_acceleration_ms / by_velocity_ms;
        let digits = if percent < 1.0 { 2 } else { 1 };
        format!("of which 1 % more does as much as {percent:.digits$} % more speed")
    }

    /// Returns the lines for the setup's file, and the figures that the setup then has.
    #[must_use]
    pub fn report(&self) -> String {
        let mut text = String::new();
        for section in ["motions", "robot"] {
            let _ = writeln!(text, "[{section}]");
            for found in &self.found {
                if let Some((_, key)) =
                    found.number.key().split_once('.').filter(|(table, _)| *table == section)
                {
                    let _ = writeln!(text, "{}", self.line(key, found));
                }
            }
            text.push('\n');
        }
        let Conditions { seeds, reps } = self.conditions;
        let _ = writeln!(
            text,
            "# {seeds} seeds with {reps} repetitions; ± is the standard error, and the last column the distance in"
        );
        let _ = writeln!(text, "# standard errors of paper and model. In ms:");
        for (figure, model) in &self.reached {
            let paper = self.of_paper(*figure, *model);
            let difference = model.less(paper);
            let _ = writeln!(
                text,
                "# {:<8} {:>8.1} ± {:.1}   paper {:>6.1} ± {:.1}   {:>6}   {:>5}",
                figure.name(),
                model.ms,
                model.error_ms,
                paper.ms,
                paper.error_ms,
                signed(difference.ms),
                signed(difference.ms / difference.error_ms),
            );
        }
        let Speed { by_velocity_ms, by_acceleration_ms, at_full_speed_ms } = self.speed;
        let _ = writeln!(
            text,
            "# RC's AET changes by {} ms for 1 % more velocity_percent, by {} ms for 1 % more\n\
             # acceleration_percent, which is {}; at 100 % of speed it is {at_full_speed_ms:.0} ms.",
            signed(by_velocity_ms),
            signed(by_acceleration_ms),
            self.setup.motions.acceleration_percent.from
        );
        text
    }

    fn line(&self, key: &str, found: &Found) -> String {
        let value = Self::value(found);
        if found.from == Provenance::Calibrated {
            return format!(
                "{key} = {{ value = {value}, from = \"calibrated\", note = \"{}\" }}",
                self.note(found)
            );
        }
        format!(
            "# {key} = {value} is from \"{}\" and stays; the figures would have {}",
            found.from,
            found.interval()
        )
    }

    /// Returns the paper's figure. The error of its MAD is that of the model's MAD at the paper's number of repetitions,
    /// as in a run's report.
    pub(super) fn of_paper(&self, figure: Metric, model: Estimate) -> Estimate {
        let paper = figure.of_paper(&self.paper);
        match figure {
            Metric::Mad(_) => {
                let error = error_of_mad(model.ms, self.conditions.reps, REPETITIONS);
                Estimate { error_ms: error.unwrap_or(paper.error_ms), ..paper }
            }
            Metric::Aet(_) | Metric::CmMinusRc => paper,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A calibration of Setup A that found this speed, and what its figures would have.
    fn calibration(value: f64, [fit, known_to]: [f64; 2]) -> Calibration {
        let setup = setup::setup("A").unwrap();
        let paper = setup.paper.clone().unwrap();
        let fit = Fit { value: fit, known_to, slopes: Vec::new() };
        let found = Found { number: Parameter::Velocity, value, from: Provenance::Calibrated, fit };
        let speed = Speed { by_velocity_ms: -9.6, by_acceleration_ms: -12.4, at_full_speed_ms: 3487.0 };
        let conditions = Conditions { seeds: 32, reps: 25 };
        Calibration { setup, found: vec![found], reached: Vec::new(), speed, paper, conditions }
    }

    #[test]
    fn a_note_says_why_its_value_is_beside_the_range_and_what_the_acceleration_does() {
        let note = |value, fit| {
            let calibration = calibration(value, fit);
            calibration.note(&calibration.found[0])
        };
        let range = "`bench calibrate` on RC's AET, 32 seeds: 23.25 to 23.35 at the assumed acceleration, of which 1 % more does \
                     as much as 1.3 % more speed";
        assert_eq!(note(23.3, [23.3, 0.05]), range);
        let beside =
            "; RC's AET changes in steps, and of the values at the nearest step 23.4 has the fewest digits";
        assert_eq!(note(23.4, [23.3, 0.05]), format!("{range}{beside}"));
        let shipped = setup::setup("A").unwrap().motions.velocity_percent;
        assert_eq!(shipped.note, note(shipped.value, [23.295, 0.045]), "the note of Setup A");
    }
}
