//! Writing a setup back, as a person would.

use toml::{Table, Value};

use crate::{Error, Setup};

/// The setup as TOML that [`crate::setup`] reads back to the same.
pub fn setup_to_toml(setup: &Setup) -> Result<String, Error> {
    let table = Table::try_from(setup)?;
    let mut text = String::new();
    write_table(&mut text, "", &table);
    Ok(text)
}

/// Writes a table's own keys first, then the tables under it, each under its header.
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

/// Whether a value stands on the line of its key: all but tables, and of those the ones that are a number with its
/// provenance or a figure of the paper.
fn is_line(value: &Value) -> bool {
    match value {
        Value::Table(table) => table.contains_key("from") || table.contains_key("aet_ms"),
        Value::Array(items) => !items.first().is_some_and(Value::is_table),
        _ => true,
    }
}
