//! Calibrated numbers into a setup's file. Comments and order of the file stay as they are.

use std::path::Path;

use anyhow::Context;
use setup::Provenance;
use toml_edit::{DocumentMut, Value};

use super::findings::Calibration;
use records::run_directory::{Durability, replace};

/// Writes the numbers into the file that the setup was read from.
///
/// # Errors
///
/// The file cannot be read or written, or is no setup any more; it then stays as it was.
pub(super) fn into_file(path: &Path, calibration: &Calibration) -> anyhow::Result<()> {
    let text = setup::read_plain_text(path).with_context(|| format!("cannot read {}", path.display()))?;
    let changed =
        into_text(&text, calibration).with_context(|| format!("cannot change {}", path.display()))?;
    replace(path, changed, Durability::Synced)
}

/// Returns the text of a setup with the numbers.
fn into_text(text: &str, calibration: &Calibration) -> anyhow::Result<String> {
    let mut document: DocumentMut = text.parse().context("it is not TOML")?;
    for found in calibration.found.iter().filter(|found| found.from == Provenance::Calibrated) {
        let key = found.number.key();
        let (table, name) = key.split_once('.').context("a key without its table")?;
        let number = document
            .get_mut(table)
            .and_then(|table| table.get_mut(name))
            .and_then(|item| item.as_table_like_mut())
            .with_context(|| format!("it has no {key}"))?;
        let value: Value =
            Calibration::value(found).parse().with_context(|| format!("the value of {key}"))?;
        for (name, value) in [("value", value), ("note", Value::from(calibration.note(found)))] {
            match number.get_mut(name).and_then(|item| item.as_value_mut()) {
                Some(old) => {
                    let decor = old.decor().clone();
                    *old = value;
                    *old.decor_mut() = decor;
                }
                None => {
                    number.insert(name, toml_edit::value(value));
                }
            }
        }
    }
    Ok(document.to_string())
}
