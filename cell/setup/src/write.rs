//! Writes a setup as a file that a person can read.

use toml::{Table, Value};

use crate::{Cell, Error, Setup};

/// Writes the setup as TOML that [`crate::setup`] reads back unchanged.
pub fn setup_to_toml(setup: &Setup) -> Result<String, Error> {
    let table = Table::try_from(setup)?;
    let mut text = String::new();
    write_table(&mut text, "", &table);
    Ok(text)
}

/// Returns a setup with any number of stations as a table of its keys, which [`crate::cell_from_table`] reads back: a cell made
/// from a setup as that setup.
pub fn cell_to_table(cell: &Cell) -> Result<Table, Error> {
    match cell.stations.as_slice() {
        [station] if cell.is_one() => Ok(Table::try_from(cell.setup_of(station))?),
        _ => Ok(Table::try_from(cell)?),
    }
}

/// Writes a setup with any number of stations as TOML that [`crate::cell()`] reads back unchanged: a cell made from a setup as
/// that setup.
pub fn cell_to_toml(cell: &Cell) -> Result<String, Error> {
    let mut text = String::new();
    write_table(&mut text, "", &cell_to_table(cell)?);
    Ok(text)
}

/// Writes a table's own keys first, then its sub-tables with their headers.
fn write_table(text: &mut String, path: &str, table: &Table) {
    for (key, value) in table.iter().filter(|(_, value)| is_line(value)) {
        text.push_str(&format!("{key} = {value}\n"));
    }
    for (key, value) in table {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        match value {
            Value::Table(inner) if !is_line(value) => {
                text.push_str(&format!("\n[{path}]\n"));
                write_table(text, &path, inner);
            }
            Value::Array(items) if !is_line(value) => {
                for inner in items.iter().filter_map(Value::as_table) {
                    text.push_str(&format!("\n[[{path}]]\n"));
                    write_table(text, &path, inner);
                }
            }
            _ => {}
        }
    }
}

/// Returns whether a value is on the line of its key: everything except tables, and of the tables a number with its
/// provenance and a figure of the paper.
fn is_line(value: &Value) -> bool {
    match value {
        Value::Table(table) => table.contains_key("from") || table.contains_key("aet_ms"),
        Value::Array(items) => !items.first().is_some_and(Value::is_table),
        _ => true,
    }
}
