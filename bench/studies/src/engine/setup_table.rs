//! A setup with other values of some keys.

use setup::Cell;

use super::file::Scalar;
use super::key::{COMPONENTS, SetupKey};

/// Begin of the note of a varied number.
const VARIED: &str = "varied for a study";

/// A setup as a table, of which single keys are changed.
#[derive(Clone, Debug)]
pub(super) struct SetupTable {
    table: toml::Table,
    name: String,
}

impl SetupTable {
    /// Takes a setup.
    ///
    /// # Errors
    ///
    /// It cannot be written as a table.
    pub(super) fn of(cell: &Cell) -> Result<Self, setup::Error> {
        Ok(Self { table: setup::cell_to_table(cell)?, name: cell.name.clone() })
    }

    /// Returns the setup with other values of some keys. A changed number is `assumed`, as in every study.
    ///
    /// # Errors
    ///
    /// The setup with these values is invalid; the error names the key.
    pub(super) fn with<'a>(
        &self,
        changes: impl IntoIterator<Item = (&'a str, SetupKey, &'a Scalar)>,
    ) -> Result<Cell, setup::Error> {
        let mut table = self.table.clone();
        for (path, key, value) in changes {
            set(&mut table, path, key, value);
        }
        setup::cell_from_table(&format!("setup {}", self.name), table)
    }
}

fn set(table: &mut toml::Table, path: &str, key: SetupKey, value: &Scalar) {
    let value = match value {
        Scalar::Truth(value) => toml::Value::Boolean(*value),
        Scalar::Integer(value) => toml::Value::Integer(*value),
        Scalar::Number(value) => toml::Value::Float(*value),
        Scalar::Text(value) => toml::Value::String(value.clone()),
        Scalar::Numbers(numbers) => toml::Value::Array(numbers.iter().map(|it| (*it).into()).collect()),
    };
    match path.split_once('.') {
        Some((section, rest)) => {
            let section = table.entry(section).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            match section {
                toml::Value::Table(section) => set_within(section, rest, key, value),
                toml::Value::Array(stations) => {
                    if let Some((station, rest)) = station_of(stations, rest) {
                        set(station, rest, key, &Scalar::from(value));
                    }
                }
                _ => {}
            }
        }
        None if key.is_sourced => {
            let note = note(table.get(path).and_then(|sourced| sourced.get("value")));
            let sourced = [("value", value), ("from", "assumed".into()), ("note", note.into())];
            let sourced = sourced.map(|(name, value)| (name.to_owned(), value));
            table.insert(path.to_owned(), toml::Value::Table(sourced.into_iter().collect()));
        }
        None => {
            table.insert(path.to_owned(), value);
        }
    }
}

/// Changes a key of a section, or a component of a place.
fn set_within(section: &mut toml::Table, path: &str, key: SetupKey, value: toml::Value) {
    if !set_component(section, path, &value) {
        set(section, path, key, &Scalar::from(value));
    }
}

/// Returns the note of a varied number.
fn note(before: Option<&toml::Value>) -> String {
    before.map_or_else(|| VARIED.to_owned(), |before| format!("{VARIED}, from {before}"))
}

/// Changes a component of a place with its source; returns false where the path is not one.
fn set_component(place: &mut toml::Table, path: &str, value: &toml::Value) -> bool {
    let Some(index) = COMPONENTS.iter().position(|name| *name == path) else { return false };
    let before = place.get("value").cloned();
    let numbers = place.get_mut("value").and_then(toml::Value::as_array_mut);
    let Some(number) = numbers.and_then(|numbers| numbers.get_mut(index)) else { return false };
    *number = value.clone();
    // Several components may be varied: the note keeps the place before the first one.
    let is_varied =
        place.get("note").and_then(toml::Value::as_str).is_some_and(|note| note.starts_with(VARIED));
    if !is_varied {
        place.insert("note".to_owned(), note(before.as_ref()).into());
    }
    place.insert("from".to_owned(), "assumed".into());
    true
}

/// Returns the station that a path begins with, and the rest of the path.
fn station_of<'t, 'p>(
    stations: &'t mut [toml::Value],
    path: &'p str,
) -> Option<(&'t mut toml::Table, &'p str)> {
    let (name, rest) = path.split_once('.')?;
    let mut stations = stations.iter_mut().filter_map(toml::Value::as_table_mut);
    let is_named =
        |station: &&mut toml::Table| station.get("name").and_then(toml::Value::as_str) == Some(name);
    stations.find(is_named).map(|station| (station, rest))
}

impl From<toml::Value> for Scalar {
    fn from(value: toml::Value) -> Self {
        match value {
            toml::Value::Boolean(value) => Self::Truth(value),
            toml::Value::Integer(value) => Self::Integer(value),
            toml::Value::Float(value) => Self::Number(value),
            toml::Value::Array(values) => Self::Numbers(values.iter().filter_map(number).collect()),
            other => Self::Text(other.as_str().unwrap_or_default().to_owned()),
        }
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::key::SetupKeys;

    fn keys(setup: &str) -> SetupKeys {
        SetupKeys::of(&setup::cell(setup).unwrap().0).unwrap()
    }

    #[test]
    fn each_key_of_the_built_in_setups_is_found_and_setting_it_to_its_own_value_changes_only_its_source() {
        let mut found = 0;
        for (name, _) in [setup::SETUPS, setup::CELLS].concat() {
            let (cell, _) = setup::cell(name).unwrap();
            let table = SetupTable::of(&cell).unwrap();
            for (path, key) in &SetupKeys::of(&cell).unwrap().keys {
                let mut place = Some(toml::Value::Table(table.table.clone()));
                for part in path.split('.') {
                    let is_named =
                        |station: &&toml::Value| station.get("name").unwrap().as_str() == Some(part);
                    let component = COMPONENTS.iter().position(|name| *name == part);
                    let number =
                        |value: &toml::Value| Some(value.get("value")?.as_array()?[component?].clone());
                    place = place.and_then(|value| match value.as_array() {
                        Some(stations) => stations.iter().find(is_named).cloned(),
                        None => number(&value).or_else(|| value.get(part).cloned()),
                    });
                }
                let Some(value) = place else { continue };
                // A component of a place is a number, and its source is that of the place.
                let value = value.get("value").cloned().unwrap_or(value);
                let value = Scalar::from(value);
                let same = table.with([(path.as_str(), *key, &value)]).unwrap();
                assert_eq!(same.name, cell.name, "{path}");
                assert_eq!(key.value(path, &value).unwrap(), value, "{path}");
                found += 1;
            }
        }
        assert!(found > 200, "{found}");
    }

    #[test]
    fn changing_a_key_of_a_station_changes_that_station_alone() {
        let (cell, _) = setup::cell("E").unwrap();
        let (path, key) =
            ("station.left.robot.cycle_us", keys("E").find("station.left.robot.cycle_us").unwrap());
        let changed = SetupTable::of(&cell).unwrap().with([(path, key, &Scalar::Integer(8_000))]).unwrap();
        let varied = cell.stations[0].robot.cycle_us.varied(8_000);
        let mut wanted = cell;
        wanted.stations[0].robot.cycle_us = varied;
        assert_eq!(changed, wanted);
    }

    #[test]
    fn a_place_is_changed_as_a_whole_or_by_components_and_its_note_has_the_place_before() {
        let (cell, _) = setup::cell("F").unwrap();
        let before = cell.stations[1].root_mm_deg.value;
        let of = |path: &str| keys("F").find(path).unwrap();
        let table = SetupTable::of(&cell).unwrap();
        let [x, c] = ["station.right.root_mm_deg.x", "station.right.root_mm_deg.c"];
        let moved =
            table.with([(x, of(x), &Scalar::Number(900.5)), (c, of(c), &Scalar::Number(-3.0))]).unwrap();
        let root = &moved.stations[1].root_mm_deg;
        let mut wanted = before;
        (wanted[0], wanted[5]) = (900.5, -3.0);
        assert_eq!((root.value, root.from), (wanted, setup::Provenance::Assumed));
        assert!(root.note.starts_with(VARIED) && !root.note.contains("900.5"), "{}", root.note);
        let whole = "station.right.root_mm_deg";
        let place = Scalar::Numbers(wanted.to_vec());
        let whole = table.with([(whole, of(whole), &place)]).unwrap();
        assert_eq!(whole.stations[1].root_mm_deg.value, wanted);
        assert_eq!(whole.stations[0], cell.stations[0]);
    }
}
