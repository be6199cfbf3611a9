//! How tables and sentences stand on a screen.

use comfy_table::{CellAlignment, Table, TableComponent, presets};

/// A table with lines above, below and under its header.
pub(crate) fn styled() -> Table {
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

/// Width of the sentences below a table.
const WIDTH: usize = 100;

/// Sentences in lines of [`WIDTH`], each line behind two blanks.
pub(crate) fn sentences<'a>(sentences: impl IntoIterator<Item = &'a str>) -> String {
    let mut lines: Vec<String> = Vec::new();
    for sentence in sentences {
        let mut line = String::from(" ");
        for word in sentence.split(' ') {
            if line.chars().count() + 1 + word.chars().count() > WIDTH {
                lines.push(std::mem::replace(&mut line, String::from(" ")));
            }
            line.push(' ');
            line.push_str(word);
        }
        lines.push(line);
    }
    lines.join("\n")
}

/// The table with its numbers to the right, and no blanks at the ends of lines.
pub(crate) fn drawn(mut table: Table) -> String {
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table.to_string().lines().map(str::trim_end).collect::<Vec<_>>().join("\n")
}
