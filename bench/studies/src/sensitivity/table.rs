//! A study on screen and as CSV.

use std::fmt::Write as _;

use comfy_table::Table;
use node::screen;

use super::{Factor, Figures, Row, Sensitivity};
use records::schedule::repetitions;
use records::statistics::aet_improvement;

const NONE: &str = "–";

/// Meaning of the columns, in sentences.
pub(super) const LEGEND: [&str; 4] = [
    "RC, SM, CM: AET with the setup's numbers; those that were calibrated are not calibrated again for the varied ones.",
    "h = 0: a skill call costs nothing but its motion and the cycles it waits for.",
    "uncal.: nothing that was calibrated: h = 0, rated speeds, every command noticed at once.",
    "motions: the same way, pre- and post-movements joined with their paths, or each straight motion in so many pieces.",
];

/// Formats the table, with the meaning of its columns.
#[must_use]
pub fn render(study: &Sensitivity) -> String {
    let Sensitivity { setup, title, application, reps, seed, .. } = study;
    let heading = [
        format!("Setup {setup}: {title}"),
        format!(
            "{application}, one number at a time, {} of each type, virtual mode, seed {seed}",
            repetitions(*reps)
        ),
    ];
    let mut text = heading.map(|line| screen::wrapped(&line, 0, 2) + "\n").concat();
    let _ = write!(text, "\n{}\n\n", screen::drawn(&screen::numbers_right(table(study))));
    let mut sentences = Vec::new();
    if let Some((sm, cm)) = study.paper.as_ref().and_then(|paper| paper.sm.zip(paper.cm)) {
        let share = aet_improvement(sm.aet_ms, cm.aet_ms) * 100.0;
        sentences.push(format!("The paper's AETi: {share:.0} %."));
    }
    sentences.extend(LEGEND.map(str::to_owned));
    let refused = |row: &Row| Some(format!("{} is refused: {}", name(row), row.refused.as_ref()?));
    sentences.extend(study.rows.iter().filter_map(refused));
    let sentences: Vec<_> = sentences.iter().map(|sentence| screen::wrapped(sentence, 2, 2)).collect();
    text.push_str(&sentences.join("\n"));
    text
}

/// Returns the rows of a study as a table.
fn table(study: &Sensitivity) -> Table {
    let mut table = screen::ruled();
    table.set_header([
        "varied",
        "is",
        "RC\nms",
        "SM\nms",
        "CM\nms",
        "AETi\n",
        "change\npoints",
        "SM\nh = 0",
        "CM\nh = 0",
        "AETi\nh = 0",
        "RC\nuncal.",
        "SM\nuncal.",
        "CM\nuncal.",
        "AETi\nuncal.",
    ]);
    let base = study.rows.iter().find(|row| row.factor.is_none());
    let base = base.and_then(|row| row.calibrated.aet_improvement);
    for row in &study.rows {
        let (with, without, bare) = (&row.calibrated, &row.without_skill_overhead, &row.uncalibrated);
        let change =
            row.factor.and(with.aet_improvement.zip(base)).map(|(share, base)| (share - base) * 100.0);
        table.add_row([
            name(row),
            row.value.clone(),
            millis(with.rc_ms),
            millis(with.sm_ms),
            millis(with.cm_ms),
            percent(with),
            change.map_or_else(String::new, |points| format!("{points:+.1}").replace('-', "−")),
            millis(without.sm_ms),
            millis(without.cm_ms),
            percent(without),
            millis(bare.rc_ms),
            millis(bare.sm_ms),
            millis(bare.cm_ms),
            percent(bare),
        ]);
    }
    table
}

pub(super) fn name(row: &Row) -> String {
    match row.factor {
        Some(Factor::Motions) if row.times < 1.0 => "motions joined".to_owned(),
        Some(Factor::Motions) => format!("motions in {}", row.times),
        Some(factor) => format!("{factor} × {}", row.times),
        None => "as it is".to_owned(),
    }
}

pub(super) fn millis(value: Option<f64>) -> String {
    value.map_or_else(|| NONE.to_owned(), |ms| format!("{ms:.0}"))
}

pub(super) fn percent(figures: &Figures) -> String {
    figures.aet_improvement.map_or_else(|| NONE.to_owned(), |share| format!("{:.1} %", share * 100.0))
}

/// Returns the columns of the rows as CSV.
#[must_use]
pub fn csv_header() -> String {
    let figures = |variant| format!("rc_ms{variant},sm_ms{variant},cm_ms{variant},aeti{variant}");
    format!("varied,times,value,unit,{},refused", ["", "_h0", "_uncalibrated"].map(figures).join(","))
}

/// Formats all rows, one per line.
#[must_use]
pub fn csv(study: &Sensitivity) -> String {
    let mut text = csv_header() + "\n";
    for row in &study.rows {
        let factor = row.factor.map_or_else(|| "none".to_owned(), |factor| factor.to_string());
        let (value, unit) = row.value.split_once(' ').unwrap_or((&row.value, "motions"));
        let _ = write!(text, "{factor},{},{value},{unit}", row.times);
        for figures in [&row.calibrated, &row.without_skill_overhead, &row.uncalibrated] {
            for value in [figures.rc_ms, figures.sm_ms, figures.cm_ms, figures.aet_improvement] {
                text.push(',');
                if let Some(value) = value {
                    let _ = write!(text, "{value:.4}");
                }
            }
        }
        let refused = row.refused.as_deref().unwrap_or_default().replace('"', "\"\"").replace('\n', " ");
        let _ = if refused.is_empty() { writeln!(text, ",") } else { writeln!(text, ",\"{refused}\"") };
    }
    text
}
