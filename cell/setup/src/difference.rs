//! Where two setups, or two other files, differ, key by key.
//!
//! Of a number in a setup only the value counts: its provenance and the notes on it change nothing that happens in the cell.

use toml::{Table, Value};

use crate::{Cell, Error, Setup};

/// A key whose value is not the same in two setups.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Difference {
    /// Path of the key, such as `motions.velocity_percent`.
    pub key: String,
    /// Value in the first setup, as TOML; `None` if the key is missing there.
    pub first: Option<String>,
    /// Value in the second setup.
    pub second: Option<String>,
}

impl Setup {
    /// Returns where this setup differs from another one, in the order of their keys.
    ///
    /// # Errors
    ///
    /// One of them cannot be written as TOML.
    pub fn differences(&self, other: &Self) -> Result<Vec<Difference>, Error> {
        let (first, second) = (Table::try_from(self)?, Table::try_from(other)?);
        let mut differences = Vec::new();
        compare_tables("", &first, &second, &mut differences);
        Ok(differences)
    }
}

impl Cell {
    /// Returns where this cell differs from another one, like [`Setup::differences`]. A station's keys are `station.NAME.…`:
    /// stations of one name are compared, wherever they stand in the file. A station that only one cell has is one difference.
    ///
    /// # Errors
    ///
    /// One of them cannot be written as TOML.
    pub fn differences(&self, other: &Self) -> Result<Vec<Difference>, Error> {
        let (first, second) = (self.by_name()?, other.by_name()?);
        let mut differences = Vec::new();
        compare_tables("", &first, &second, &mut differences);
        for difference in &mut differences {
            let is_station = difference.key.strip_prefix("station.").is_some_and(|name| !name.contains('.'));
            if is_station {
                // The whole section would hide the rest of a table.
                let found = |value: &Option<String>| value.as_ref().map(|_| "a station".to_owned());
                (difference.first, difference.second) = (found(&difference.first), found(&difference.second));
            }
        }
        Ok(differences)
    }

    /// Returns the cell as TOML, with tables of stations and of shared zones by their names.
    fn by_name(&self) -> Result<Table, Error> {
        let mut table = Table::try_from(self)?;
        let mut by_name = Table::new();
        for station in &self.stations {
            let mut section = Table::try_from(station)?;
            section.remove("name");
            by_name.insert(station.name.clone(), Value::Table(section));
        }
        table.insert("station".to_owned(), Value::Table(by_name));
        if !self.shared_zones.is_empty() {
            let mut by_name = Table::new();
            for zone in &self.shared_zones {
                let mut section = Table::try_from(zone)?;
                section.remove("name");
                by_name.insert(zone.name.clone(), Value::Table(section));
            }
            table.insert("shared_zone".to_owned(), Value::Table(by_name));
        }
        Ok(table)
    }
}

/// Returns where two texts in TOML differ, such as those of applications; `None` if one of them is no TOML.
#[must_use]
pub fn text_differences(first: &str, second: &str) -> Option<Vec<Difference>> {
    let (first, second) = (first.parse::<Table>().ok()?, second.parse::<Table>().ok()?);
    let mut differences = Vec::new();
    compare_tables("", &first, &second, &mut differences);
    Some(differences)
}

fn compare_tables(path: &str, first: &Table, second: &Table, differences: &mut Vec<Difference>) {
    let only_second = second.keys().filter(|key| !first.contains_key(*key));
    for key in first.keys().chain(only_second) {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        compare(path, first.get(key).map(bare), second.get(key).map(bare), differences);
    }
}

fn compare(key: String, first: Option<&Value>, second: Option<&Value>, differences: &mut Vec<Difference>) {
    match (first, second) {
        (Some(Value::Table(first)), Some(Value::Table(second))) => {
            compare_tables(&key, first, second, differences);
        }
        (Some(Value::Array(first)), Some(Value::Array(second)))
            if first.len() == second.len() && first.iter().all(Value::is_table) =>
        {
            for (index, (first, second)) in first.iter().zip(second).enumerate() {
                compare(format!("{key}[{index}]"), Some(first), Some(second), differences);
            }
        }
        (first, second) if first == second => {}
        (first, second) => {
            // The device of a file is a table of hundreds of values.
            let is_device = key.ends_with("chosen_device");
            let text = |value: &Value| if is_device { "a device".to_owned() } else { value.to_string() };
            let text = |value: Option<&Value>| value.map(text);
            differences.push(Difference { key, first: text(first), second: text(second) });
        }
    }
}

/// Returns the value of a number with provenance, and any other value as it is.
fn bare(value: &Value) -> &Value {
    match value {
        Value::Table(table) if table.contains_key("from") => table.get("value").unwrap_or(value),
        _ => value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Provenance, setup};

    fn keys(first: &Setup, second: &Setup) -> Vec<String> {
        let differences = first.differences(second).unwrap();
        differences
            .into_iter()
            .map(|Difference { key, first, second }| {
                let text = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
                format!("{key}: {} {}", text(first), text(second))
            })
            .collect()
    }

    #[test]
    fn another_value_is_a_difference_and_another_note_or_source_is_none() {
        let shipped = setup("A").unwrap();
        let mut changed = shipped.clone();
        changed.motions.velocity_percent.note = "measured".to_owned();
        changed.motions.velocity_percent.from = Provenance::Assumed;
        assert_eq!(keys(&shipped, &changed), Vec::<String>::new());
        changed.motions.velocity_percent.value = 50.5;
        changed.robot.start_quantum_us = Some(shipped.robot.interpreter_quantum_us.varied(7));
        changed.robot.bases.clear();
        let velocity = shipped.motions.velocity_percent.value;
        let told = keys(&shipped, &changed);
        assert!(told[0].starts_with("robot.bases: [") && told[0].ends_with(" []"), "{}", told[0]);
        assert_eq!(told[1], "robot.start_quantum_us: - 7");
        assert_eq!(told[2], format!("motions.velocity_percent: {velocity:?} 50.5"));
        assert_eq!(told.len(), 3);
    }

    #[test]
    fn texts_are_compared_by_what_they_say_and_not_by_how_they_are_written() {
        let first = "# a\nname = 'x'\n[[step]]\nat = [1, 2]\n";
        assert_eq!(text_differences(first, "name = \"x\"\nstep = [{ at = [1,2] }]\n"), Some(Vec::new()));
        let differences = text_differences(first, "name = 'x'\n[[step]]\nat = [1, 3]\n").unwrap();
        assert_eq!(differences[0].key, "step[0].at");
        assert_eq!(text_differences(first, "]"), None);
    }

    #[test]
    fn within_a_list_the_entry_is_named() {
        let shipped = setup("A").unwrap();
        let mut changed = shipped.clone();
        changed.robot.bases[0].number = 2;
        assert_eq!(keys(&shipped, &changed), ["robot.bases[0].number: 1 2"]);
    }
}
