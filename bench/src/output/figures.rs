//! The figures of a run as the rows of a table: the same on the screen and in Markdown.

use plc_node::ExecutionType;

use crate::output::progress::label;
use crate::records::calibrated::{Calibrated, SKILL_OVERHEAD, of_aet, of_mad};
use crate::records::results::{PaperFigure, Results};
use crate::records::statistics::aet_improvement;

/// Mark of a figure that a number of the setup was calibrated to.
pub(super) const CALIBRATED: &str = "*";

/// The figures as text.
pub(super) struct Figures {
    pub(super) header: Vec<&'static str>,
    /// A row for each type, and one for AETi. In the columns AET and MAD a figure without a mark has a blank in its place.
    pub(super) rows: Vec<Vec<String>>,
}

impl Figures {
    pub(super) fn of(results: &Results) -> Self {
        let mut header = vec!["ms", "AET", "MAD", "n"];
        if results.without_skill_overhead.is_some() {
            header.extend(["AET, h = 0", "MAD, h = 0"]);
        }
        if results.paper.is_some() {
            header.extend(["paper AET", "paper MAD", "AET − paper"]);
        }
        let types = ExecutionType::ALL.into_iter().filter(|of| results.results.get(*of).is_some());
        let rows = types.map(|of| row(results, of)).chain([improvement(results)]).collect();
        Self { header, rows }
    }
}

/// Returns the calibrated numbers that a figure of this run was marked for.
pub(super) fn marked(results: &Results) -> impl Iterator<Item = &Calibrated> {
    let is_marked = |key: &str| {
        ExecutionType::ALL.into_iter().any(|of| {
            (results.figure(of).is_some() && of_aet(of) == key)
                || (results.mad_ms(of).is_some() && of_mad(of).contains(&key))
        })
    };
    results.calibrated.iter().filter(move |calibrated| is_marked(&calibrated.key))
}

fn row(results: &Results, of: ExecutionType) -> Vec<String> {
    let (found, mad_ms) = (results.figure(of), results.mad_ms(of));
    let n = results.results.get(of).map_or(0, |result| result.samples_ms.len());
    let mut row = vec![
        label(of),
        found.map_or_else(none, |found| millis(found.aet_ms) + mark(results.is_aet_calibrated(of))),
        mad_ms.map_or_else(none, |mad_ms| millis(mad_ms) + mark(results.is_mad_calibrated(of))),
        n.to_string(),
    ];
    if let Some(without) = &results.without_skill_overhead {
        let figure = without.results.get(of);
        row.push(figure.map_or_else(none, |figure| millis(figure.aet_ms)));
        // It has as many repetitions as the run.
        row.push(figure.filter(|_| mad_ms.is_some()).map_or_else(none, |figure| millis(figure.mad_ms)));
    }
    if let Some(paper) = &results.paper {
        let paper = paper.get(of);
        row.push(paper.map_or_else(none, |paper| format!("{:.0}", rounded(paper.aet_ms, 0))));
        row.push(paper.map_or_else(none, |paper| millis(paper.mad_ms)));
        row.push(found.zip(paper.copied()).map_or_else(none, deviation));
    }
    row
}

fn improvement(results: &Results) -> Vec<String> {
    let own = results.aet_improvement;
    let own = own.map_or_else(none, |share| percent(share, 1) + mark(results.is_calibrated(SKILL_OVERHEAD)));
    let mut row = vec!["AETi".to_owned(), own, String::new(), String::new()];
    if let Some(without) = &results.without_skill_overhead {
        row.extend([without.aet_improvement.map_or_else(none, |share| percent(share, 1)), String::new()]);
    }
    if let Some(paper) = &results.paper {
        let share = paper.sm.zip(paper.cm).map(|(sm, cm)| aet_improvement(sm.aet_ms, cm.aet_ms));
        row.extend([share.map_or_else(none, |share| percent(share, 0)), String::new(), String::new()]);
    }
    row
}

fn mark(is_calibrated: bool) -> &'static str {
    if is_calibrated { CALIBRATED } else { " " }
}

/// Rounds to this many digits behind the point, at most three, halves away from zero: by this rule wherever figures are
/// shown.
pub(super) fn rounded(value: f64, digits: usize) -> f64 {
    let unit = [1.0, 10.0, 100.0].get(digits).copied().unwrap_or(1_000.0);
    // Negative zero would be shown with a sign.
    (value * unit).round() / unit + 0.0
}

fn millis(value: f64) -> String {
    format!("{:.1}", rounded(value, 1))
}

fn percent(share: f64, digits: usize) -> String {
    format!("{:.*} %", digits, rounded(share * 100.0, digits))
}

fn none() -> String {
    "–".to_owned()
}

fn deviation((found, paper): (PaperFigure, PaperFigure)) -> String {
    let difference = found.aet_ms - paper.aet_ms;
    let share = difference / paper.aet_ms * 100.0;
    format!("{:+.1} ({:+.2} %)", rounded(difference, 1), rounded(share, 2))
}
