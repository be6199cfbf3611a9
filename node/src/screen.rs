//! Tables and text that fit the screen.

use std::io::{self, IsTerminal as _};
use std::sync::OnceLock;

use comfy_table::{CellAlignment, ColumnConstraint, Table, TableComponent, presets};
use terminal_size::{Width, terminal_size_of};

/// The narrowest screen that tables and text are made for, in characters.
const NARROWEST: usize = 60;

/// Width of text on a wide screen, in characters: longer lines are hard to read.
const TEXT: usize = 100;

/// Width of the terminal in characters, if standard output is one.
static TERMINAL: OnceLock<usize> = OnceLock::new();

/// Makes tables and text fit the terminal, if standard output is one. Call it first in `main`; without it, and where the
/// output goes to a file or a pipe, tables are as wide as they are.
pub fn fit_terminal() {
    if io::stdout().is_terminal()
        && let Some((Width(width), _)) = terminal_size_of(io::stdout())
    {
        let _ = TERMINAL.set(usize::from(width).max(NARROWEST));
    }
}

/// Returns the width that a table may have, in characters; `usize::MAX` where nothing limits it.
#[must_use]
pub fn table_width() -> usize {
    TERMINAL.get().copied().unwrap_or(usize::MAX)
}

/// Returns the width that text may have, in characters.
#[must_use]
pub fn text_width() -> usize {
    table_width().min(TEXT)
}

/// Returns an empty table with lines above, below and under its header.
#[must_use]
pub fn ruled() -> Table {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY);
    for inner in [TableComponent::HorizontalLines, TableComponent::MiddleIntersections] {
        table.remove_style(inner);
    }
    for line in [TableComponent::HeaderLines, TableComponent::MiddleHeaderIntersections] {
        table.set_style(line, '─');
    }
    table
}

/// Puts all columns but the first to the right.
#[must_use]
pub fn numbers_right(mut table: Table) -> Table {
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// Draws a table without blanks at the ends of lines. If it is wider than the screen, it becomes several tables below each
/// other, each with the first column and as many of the others as fit.
#[must_use]
pub fn drawn(table: &Table) -> String {
    drawn_within(table, table_width())
}

fn drawn_within(table: &Table, width: usize) -> String {
    let fits = |text: &str| text.lines().all(|line| line.chars().count() <= width);
    let whole = text(table);
    if fits(&whole) {
        return whole;
    }
    let mut parts: Vec<Vec<usize>> = Vec::new();
    for column in 1..table.column_iter().count() {
        match parts.last_mut() {
            Some(part) if fits(&text(&with_columns(table, part, column))) => part.push(column),
            _ => parts.push(vec![column]),
        }
    }
    let drawn = parts.iter().filter_map(|part| part.split_last());
    drawn.map(|(last, part)| text(&with_columns(table, part, *last))).collect::<Vec<_>>().join("\n\n")
}

/// Returns the table with its first column, those of `part` and the `last` one.
fn with_columns(table: &Table, part: &[usize], last: usize) -> Table {
    let mut shown = table.clone();
    for (index, column) in shown.column_iter_mut().enumerate().skip(1) {
        if index != last && !part.contains(&index) {
            column.set_constraint(ColumnConstraint::Hidden);
        }
    }
    shown
}

fn text(table: &Table) -> String {
    table.to_string().lines().map(str::trim_end).collect::<Vec<_>>().join("\n")
}

/// Breaks text into lines that fit the screen, the first behind `indent` blanks and the others behind `hanging`. Words stay
/// whole.
#[must_use]
pub fn wrapped(text: &str, indent: usize, hanging: usize) -> String {
    wrapped_within(text, indent, hanging, text_width())
}

/// Breaks text like [`wrapped`], for a file, into lines of at most `width` characters.
#[must_use]
pub fn wrapped_within(text: &str, indent: usize, hanging: usize, width: usize) -> String {
    let mut lines = Vec::new();
    let mut line = " ".repeat(indent);
    let mut is_empty = true;
    for word in text.split(' ') {
        if !is_empty && line.chars().count() + 1 + word.chars().count() > width {
            lines.push(std::mem::replace(&mut line, " ".repeat(hanging)));
            is_empty = true;
        }
        if !is_empty {
            line.push(' ');
        }
        line.push_str(word);
        is_empty = false;
    }
    lines.push(line);
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures() -> Table {
        let mut table = ruled();
        table.set_header(["ms", "AET", "MAD", "paper AET", "paper MAD"]);
        table.add_row(["RC", "3725.5", "3.0", "3725", "3.6"]);
        table.add_row(["SM", "6480.0", "3.0", "6477", "11.3"]);
        table
    }

    #[test]
    fn a_table_that_is_too_wide_becomes_tables_below_each_other_with_the_first_column_in_each() {
        insta::assert_snapshot!(drawn_within(&figures(), 28), @"
        ───────────────────
         ms   AET      MAD
        ───────────────────
         RC   3725.5   3.0
         SM   6480.0   3.0
        ───────────────────

        ────────────────────────────
         ms   paper AET   paper MAD
        ────────────────────────────
         RC   3725        3.6
         SM   6477        11.3
        ────────────────────────────
        ");
    }

    #[test]
    fn a_table_that_fits_is_left_as_it_is() {
        assert_eq!(drawn_within(&figures(), 80), text(&figures()));
    }

    #[test]
    fn lines_break_between_words_only() {
        let text = "a word_that_is_much_too_long and the rest";
        assert_eq!(
            wrapped_within(text, 2, 4, 12),
            "  a\n    word_that_is_much_too_long\n    and the\n    rest"
        );
    }
}
