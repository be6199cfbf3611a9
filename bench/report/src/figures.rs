//! The figures of a run as the cells of a table: the same text on the screen, in Markdown and in the report.

use plc_node::ExecutionType;
use serde::Serialize;

use crate::progress::label;
use records::calibrated::{Calibrated, of_aet, of_mad};
use records::figures::{Improvement, TypeFigures};
use records::results::Results;

/// Mark of a figure that a number of the setup was calibrated to.
pub(super) const CALIBRATED: &str = "*";

/// The rows of the table.
#[derive(Serialize)]
pub(super) struct Figures {
    /// Whether there are columns of the run in which a skill call costs nothing.
    has_h0: bool,
    /// Whether there are columns of the paper.
    has_paper: bool,
    rows: Vec<FigureRow>,
    improvement: ImprovementRow,
}

/// A measured figure.
#[derive(Serialize)]
struct Measured {
    text: String,
    is_calibrated: bool,
}

/// The row of a type. Times are in ms; AET stands before MAD.
#[derive(Serialize)]
struct FigureRow {
    name: String,
    how: &'static str,
    aet: Measured,
    mad: Measured,
    count: usize,
    h0: [String; 2],
    paper: [String; 2],
    aet_minus_paper: String,
    aet_minus_paper_percent: Option<String>,
}

/// The row of AETi.
#[derive(Serialize)]
struct ImprovementRow {
    own: Measured,
    h0: String,
    paper: String,
}

impl Figures {
    pub(super) fn of(results: &Results) -> Self {
        Self {
            has_h0: results.without_skill_overhead.is_some(),
            has_paper: results.paper.is_some(),
            rows: results.figures().iter().map(FigureRow::of).collect(),
            improvement: ImprovementRow::of(results.improvement()),
        }
    }

    /// Returns the names of the columns of a plain table.
    pub(super) fn header(&self) -> Vec<&'static str> {
        let mut header = vec!["ms", "AET", "MAD", "n"];
        if self.has_h0 {
            header.extend(["AET, h = 0", "MAD, h = 0"]);
        }
        if self.has_paper {
            header.extend(["paper AET", "paper MAD", "AET − paper"]);
        }
        header
    }

    /// Returns the rows of a plain table: one for each type, and one for AETi. In the columns AET and MAD a figure without a
    /// mark has a blank in its place.
    pub(super) fn plain_rows(&self) -> Vec<Vec<String>> {
        let improvement = self.improvement.plain(self.has_h0, self.has_paper);
        self.rows.iter().map(|row| row.plain(self.has_h0, self.has_paper)).chain([improvement]).collect()
    }
}

impl Measured {
    fn new(figure: Option<f64>, is_calibrated: bool, text: impl Fn(f64) -> String) -> Self {
        Self { text: figure.map_or_else(none, text), is_calibrated: figure.is_some() && is_calibrated }
    }

    fn marked(&self) -> String {
        let mark = match (self.is_calibrated, self.text == none()) {
            (true, _) => CALIBRATED,
            (false, true) => "",
            (false, false) => " ",
        };
        format!("{}{mark}", self.text)
    }
}

impl FigureRow {
    fn of(figures: &TypeFigures<'_>) -> Self {
        let or_none = |value: Option<f64>| value.map_or_else(none, millis);
        let difference = figures.aet_minus_paper_ms();
        let share = difference.zip(figures.paper).map(|(ms, paper)| ms / paper.aet_ms * 100.0);
        Self {
            name: label(figures.execution_type),
            how: how(figures.execution_type),
            aet: Measured::new(figures.aet_ms, figures.is_aet_calibrated, millis),
            mad: Measured::new(figures.mad_ms, figures.is_mad_calibrated, millis),
            count: figures.count(),
            h0: [figures.h0_aet_ms, figures.h0_mad_ms].map(or_none),
            paper: [
                figures.paper.map_or_else(none, |paper| format!("{:.0}", rounded(paper.aet_ms, 0))),
                or_none(figures.paper.map(|paper| paper.mad_ms)),
            ],
            aet_minus_paper: difference.map_or_else(none, signed),
            aet_minus_paper_percent: share.map(signed_percent),
        }
    }

    fn plain(&self, has_h0: bool, has_paper: bool) -> Vec<String> {
        let mut row = vec![self.name.clone(), self.aet.marked(), self.mad.marked(), self.count.to_string()];
        if has_h0 {
            row.extend(self.h0.clone());
        }
        if has_paper {
            row.extend(self.paper.clone());
            let percent = self.aet_minus_paper_percent.as_ref();
            let percent = percent.map_or_else(String::new, |percent| format!(" ({percent})"));
            row.push(format!("{}{percent}", self.aet_minus_paper));
        }
        row
    }
}

impl ImprovementRow {
    fn of(Improvement { own, is_calibrated, h0, paper }: Improvement) -> Self {
        Self {
            own: Measured::new(own, is_calibrated, |share| percent(share, 1)),
            h0: h0.map_or_else(none, |share| percent(share, 1)),
            paper: paper.map_or_else(none, |share| percent(share, 0)),
        }
    }

    fn plain(&self, has_h0: bool, has_paper: bool) -> Vec<String> {
        let mut row = vec!["AETi".to_owned(), self.own.marked(), String::new(), String::new()];
        if has_h0 {
            row.extend([self.h0.clone(), String::new()]);
        }
        if has_paper {
            row.extend([self.paper.clone(), String::new(), String::new()]);
        }
        row
    }
}

/// Returns how a type runs the sequence.
pub(super) const fn how(execution_type: ExecutionType) -> &'static str {
    match execution_type {
        ExecutionType::Rc => "robot program",
        ExecutionType::Sm => "single skills",
        ExecutionType::Cm => "MoveContinuousSkill",
    }
}

/// Returns the calibrated numbers for which a figure of this run has a mark.
pub(super) fn marked(results: &Results) -> impl Iterator<Item = &Calibrated> {
    let figures = results.figures();
    results.calibrated.iter().filter(move |calibrated| {
        figures.iter().any(|figures| {
            let (execution_type, key) = (figures.execution_type, calibrated.key.as_str());
            (figures.aet_ms.is_some() && of_aet(execution_type) == key)
                || (figures.mad_ms.is_some() && of_mad(execution_type).contains(&key))
        })
    })
}

/// Rounds to this many decimals, at most three, halves away from zero. All shown figures are rounded by this function.
pub(super) fn rounded(value: f64, digits: usize) -> f64 {
    let unit = [1.0, 10.0, 100.0].get(digits).copied().unwrap_or(1_000.0);
    // Negative zero would be shown with a sign.
    (value * unit).round() / unit + 0.0
}

pub(super) fn millis(value: f64) -> String {
    format!("{:.1}", rounded(value, 1))
}

/// Formats a number for people to this many digits after the point, with its sign as U+2212; never a negative zero.
#[must_use]
pub fn signed_to(value: f64, digits: usize) -> String {
    format!("{:+.digits$}", rounded(value, digits)).replace('-', "−")
}

/// Formats a number to a tenth, with its sign; never a negative zero.
pub fn signed(value: f64) -> String {
    signed_to(value, 1)
}

/// Formats a percentage to a hundredth, with its sign.
pub fn signed_percent(percent: f64) -> String {
    format!("{:+.2} %", rounded(percent, 2)).replace('-', "−")
}

pub(super) fn percent(share: f64, digits: usize) -> String {
    format!("{:.*} %", digits, rounded(share * 100.0, digits)).replace('-', "−")
}

fn none() -> String {
    "–".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_has_a_sign_and_that_of_zero_is_positive() {
        assert_eq!([-0.04, -3.06, 0.1].map(signed), ["+0.0", "−3.1", "+0.1"]);
    }
}
