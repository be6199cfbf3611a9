//! The result of a calibration for other programs: each number with the range in which the figures stay within their errors, and
//! each figure beside the paper's.

use serde::Serialize;

use super::{Calibration, Parameter};
use crate::outputs::csv_number;
use records::distance::Estimate;

/// Columns of `--export-csv`.
pub const CSV_HEADER: &str = "name,unit,value,best,low,high,from,error,paper,paper_error,difference,distance";

/// Version of the format of `--export-json`.
const SCHEMA_VERSION: u32 = 1;

/// A whole calibration.
#[derive(Serialize)]
pub(super) struct CalibrationExport<'a> {
    schema_version: u32,
    setup: &'a str,
    application: &'a str,
    seeds: u32,
    seed: u64,
    reps: u32,
    numbers: Vec<CalibratedNumber>,
    figures: Vec<CalibratedFigure>,
    /// Change of RC's AET for 1 % more programmed speed.
    rc_ms_per_velocity_percent: f64,
    /// Change of RC's AET for 1 % more programmed acceleration.
    rc_ms_per_acceleration_percent: f64,
    rc_ms_at_full_speed: f64,
}

/// A number of the setup.
#[derive(Serialize)]
struct CalibratedNumber {
    key: &'static str,
    unit: &'static str,
    /// Value in the calibrated setup.
    value: f64,
    /// Value with which the figures are met best.
    best: f64,
    /// Range in which the figures stay within their errors.
    low: f64,
    high: f64,
    from: String,
}

/// A figure of the calibrated setup beside the paper's.
#[derive(Serialize)]
struct CalibratedFigure {
    figure: String,
    ms: f64,
    /// Standard error over the seeds.
    error_ms: f64,
    paper_ms: f64,
    paper_error_ms: f64,
    difference_ms: f64,
    /// Difference in standard errors of both; `None` without an error.
    distance: Option<f64>,
}

impl<'a> CalibrationExport<'a> {
    pub(super) fn of(calibration: &'a Calibration, application: &'a str, seed: u64) -> Self {
        let number = |found: &super::Found| {
            let (low, high) = found.range();
            CalibratedNumber {
                key: found.number.key(),
                unit: unit(found.number),
                value: found.value,
                best: found.fit.value,
                low,
                high,
                from: found.from.to_string(),
            }
        };
        let figure = |(figure, model): &(super::Metric, Estimate)| {
            let paper = calibration.of_paper(*figure, *model);
            let difference = model.less(paper);
            CalibratedFigure {
                figure: figure.name(),
                ms: model.ms,
                error_ms: model.error_ms,
                paper_ms: paper.ms,
                paper_error_ms: paper.error_ms,
                difference_ms: difference.ms,
                distance: Some(difference.ms / difference.error_ms).filter(|distance| distance.is_finite()),
            }
        };
        let super::Speed { by_velocity_ms, by_acceleration_ms, at_full_speed_ms } = calibration.speed;
        Self {
            schema_version: SCHEMA_VERSION,
            setup: &calibration.setup.name,
            application,
            seeds: calibration.conditions.seeds,
            seed,
            reps: calibration.conditions.reps,
            numbers: calibration.found.iter().map(number).collect(),
            figures: calibration.reached.iter().map(figure).collect(),
            rc_ms_per_velocity_percent: by_velocity_ms,
            rc_ms_per_acceleration_percent: by_acceleration_ms,
            rc_ms_at_full_speed: at_full_speed_ms,
        }
    }

    /// Formats a line for each number, then for each figure. What one of the two does not have is empty.
    pub(super) fn csv(&self) -> String {
        let digits = |value: f64| csv_number(Some(value), 4);
        let number = |number: &CalibratedNumber| {
            let CalibratedNumber { key, unit, value, best, low, high, from } = number;
            let [value, best, low, high] = [*value, *best, *low, *high].map(digits);
            format!("{key},{unit},{value},{best},{low},{high},{from},,,,,\n")
        };
        let figure = |figure: &CalibratedFigure| {
            let CalibratedFigure { figure, ms, error_ms, paper_ms, paper_error_ms, difference_ms, distance } =
                figure;
            let [ms, error, paper, paper_error, difference] =
                [*ms, *error_ms, *paper_ms, *paper_error_ms, *difference_ms].map(digits);
            let distance = csv_number(*distance, 2);
            format!("{figure},ms,{ms},,,,,{error},{paper},{paper_error},{difference},{distance}\n")
        };
        let lines: String = self.numbers.iter().map(number).chain(self.figures.iter().map(figure)).collect();
        format!("{CSV_HEADER}\n{lines}")
    }
}

/// Returns the unit of a number.
const fn unit(number: Parameter) -> &'static str {
    match number {
        Parameter::Quantum | Parameter::StartQuantum | Parameter::Overhead => "µs",
        Parameter::Velocity => "%",
        Parameter::StartCycles => "robot cycles",
    }
}
