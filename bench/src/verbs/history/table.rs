//! The list on screen.

use comfy_table::{CellAlignment, Table, presets};
use node::screen;
use plc_node::ExecutionType;

use super::{Entry, History};
use records::statistics::AetMad;
use report::figures::signed;
use report::progress::label;

impl History {
    /// Formats the list as a table.
    #[must_use]
    pub fn table(&self) -> String {
        let mut table = Table::new();
        table.load_preset(presets::NOTHING);
        table.set_header([
            "run",
            "date",
            "commit",
            "setup",
            "mode",
            "application",
            "RC, ms\nAET ± MAD",
            "SM, ms\nAET ± MAD",
            "CM, ms\nAET ± MAD",
            "AETi",
            "trend of AET",
            "ended",
        ]);
        for entry in &self.entries {
            let or_none = |text: &Option<String>| text.clone().unwrap_or_else(|| "–".to_owned());
            let improvement =
                entry.aet_improvement.map(|share| format!("{:.1} %", share * 100.0).replace('-', "−"));
            table.add_row([
                entry.run.clone(),
                or_none(&entry.date),
                or_none(&entry.commit),
                entry.setup.clone(),
                if entry.is_attached { format!("{}, attached", entry.mode) } else { entry.mode.clone() },
                entry.application.clone(),
                figure(entry, ExecutionType::Rc),
                figure(entry, ExecutionType::Sm),
                figure(entry, ExecutionType::Cm),
                or_none(&improvement),
                trend(entry),
                entry.ended(),
            ]);
        }
        for column in table.column_iter_mut().skip(6).take(4) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        screen::drawn(&table)
    }
}

fn figure(entry: &Entry, execution_type: ExecutionType) -> String {
    let deviates = entry.repetitions.get(execution_type).is_some_and(|number| *number > 1);
    let text = |figure: &AetMad| match deviates {
        true => format!("{:.1} ± {:.1}", figure.aet_ms, figure.mad_ms),
        false => format!("{:.1} ±   –", figure.aet_ms),
    };
    entry.figures.get(execution_type).map_or_else(|| "–".to_owned(), text)
}

/// Formats the trend, for example `RC +0.0  SM −3.1  CM +0.2 ms`; empty for the first run of its kind. One that no earlier run can
/// be compared with says so: no difference is shown there, which is not the same as no change.
fn trend(entry: &Entry) -> String {
    let trend = |execution_type| {
        entry.trend_ms.get(execution_type).map(|ms| format!("{} {}", label(execution_type), signed(*ms)))
    };
    let trends: Vec<_> = ExecutionType::ALL.into_iter().filter_map(trend).collect();
    match (trends.is_empty(), &entry.differs) {
        (false, _) => trends.join("  ") + " ms",
        (true, Some(_)) => "other conditions".to_owned(),
        (true, None) => String::new(),
    }
}
