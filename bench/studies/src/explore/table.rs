//! The outcomes of an exploration on screen: counts by type and fault, and reasons with commands that run again.

use node::screen;

use super::Exploration;
use super::classes::{Class, Reason, Row, RowKey};
use report::figures::signed;
use report::outln;
use report::progress::label;

/// Reasons that are shown.
const REASONS: usize = 12;

/// Classes that are shown after the time, with those of a cell.
const CLASSES: [Class; 6] =
    [Class::Refused, Class::TooLate, Class::Stuck, Class::Altered, Class::LawBroken, Class::Panicked];

impl Exploration<'_> {
    /// Returns what was explored, in a sentence.
    pub(super) fn title(&self) -> String {
        let name = &self.name;
        match self.options.pairs {
            None if self.options.draws.is_some() => format!(
                "Setup {name}: one fault at a time, drawn by seed {}, in virtual time",
                self.options.seed
            ),
            Some(_) => format!(
                "Setup {name}: two faults at a time, drawn by seed {}, in virtual time",
                self.options.seed
            ),
            None => format!("Setup {name}: one fault at a time, in virtual time"),
        }
    }

    /// Returns how many runs ended well, in a sentence.
    pub(super) fn verdict(&self) -> String {
        let count = |class| self.classes.of(class);
        format!(
            "Of {} runs {} passed in the same time, {} late by a bounded time, and {} were refused with a reason and the \
             next one passed. {} ended otherwise.",
            self.classes.runs(),
            count(Class::Same),
            count(Class::Late),
            count(Class::Refused),
            self.classes.wrong()
        )
    }

    fn shown_classes(&self) -> impl Iterator<Item = Class> {
        // A robot that works alone has no laws to share.
        let is_cell = !self.texts.stations.is_empty();
        CLASSES.into_iter().filter(move |class| is_cell || *class != Class::LawBroken)
    }

    /// Returns the heads of the columns.
    pub(super) fn head(&self) -> Vec<&'static str> {
        let first = ["type", "fault", "runs", "same", "late", "by ms"];
        first.into_iter().chain(self.shown_classes().map(Class::name)).collect()
    }

    /// Returns the cells of each row.
    pub(super) fn cells(&self) -> Vec<Vec<String>> {
        let cells = |((type_index, kinds), row): (&RowKey, &Row)| {
            let execution_type = self.clean_runs.get(*type_index)?.execution_type();
            let kinds: Vec<_> =
                kinds.iter().map(|(station, what)| self.texts.at(*station, ": ", what.label())).collect();
            let counted = |class| row.of(class).to_string();
            let first = [
                label(execution_type),
                kinds.join(" + "),
                row.runs().to_string(),
                counted(Class::Same),
                counted(Class::Late),
                later(row),
            ];
            Some(first.into_iter().chain(self.shown_classes().map(counted)).collect())
        };
        self.classes.rows.iter().filter_map(cells).collect()
    }

    /// Returns the table of the counts; that of pairs is for the page.
    pub(super) fn table(&self) -> String {
        let verdict = screen::wrapped(&self.verdict(), 0, 0);
        let mut table = screen::ruled();
        table.set_header(self.head());
        if self.options.pairs.is_none() {
            for row in self.cells() {
                table.add_row(row);
            }
            return format!(
                "{}\n\n{}\n{verdict}",
                self.title(),
                screen::drawn(&screen::numbers_right(table))
            );
        }
        format!("{}\n\n{verdict}", self.title())
    }

    /// Prints why runs did not pass, each reason with a command that runs its first one again, with the fewest faults.
    pub(super) fn tell_reasons(&self) {
        let reasons = self.classes.reasons();
        for reason in reasons.iter().take(REASONS) {
            let Reason { class, text, runs, .. } = reason;
            outln!("\n{runs} × {}: {text}\n  {}", class.name(), self.smallest(reason));
        }
        if reasons.len() > REASONS {
            outln!("\nand {} more reasons", reasons.len() - REASONS);
        }
    }

    /// Returns the command of the first run with this reason, with the fewest faults that have the same end.
    pub(super) fn smallest(&self, Reason { class, first, .. }: &Reason) -> String {
        self.clean_runs
            .get(first.type_index)
            .map_or_else(String::new, |clean| self.command_of(clean, &clean.shrunk(&first.faults, *class)))
    }
}

fn later(row: &Row) -> String {
    let ms = |nanos: i64| signed(nanos as f64 / 1e6);
    match row.later_ns {
        [0, 0] => String::new(),
        [earliest, latest] => format!("{} … {}", ms(earliest), ms(latest)),
    }
}
