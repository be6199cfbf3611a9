//! The keys of a setup as a study names them, from the schema of the setup's file.

use std::collections::BTreeMap;

use serde_json::Value;
use setup::{Cell, meant_or_all, nearest};

use super::file::Scalar;

const SCHEMA: &str = include_str!("../../../../cell/schemas/setup.schema.json");

/// The key that varies the faults of a job, which no setup has.
pub const FAULTS: &str = "faults";

/// Depth of a key: no section of a setup is as deep, so that a schema that contains itself ends.
const DEEPEST: usize = 8;

/// Kind of value that a key has.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ValueKind {
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// A text.
    Text,
    /// True or false.
    Truth,
}

/// A key of a setup.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SetupKey {
    /// Kind of its value.
    pub kind: ValueKind,
    /// A number with its source.
    pub is_sourced: bool,
}

/// Section of a station, in a setup of several.
const STATION: &str = "station";

/// Sections of a setup of one robot that each station of a cell has.
const OF_STATION: [&str; 3] = ["bus", "robot", "motions"];

/// All keys of a setup that a study can vary, by their path.
#[derive(Clone, Debug)]
pub struct SetupKeys {
    keys: BTreeMap<String, SetupKey>,
    /// The setup's name, for messages.
    setup: String,
    /// The stations of a setup of several; none of one robot.
    stations: Vec<String>,
}

/// A key or a value that a study cannot vary.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum InvalidKey {
    /// No setup has it.
    #[error("`{key}`: not a number, text or truth of a setup; {remedy}")]
    Unknown {
        /// The given key.
        key: String,
        /// The one that was meant.
        remedy: String,
    },
    /// The setup has no such station.
    #[error("`{key}`: setup {setup} has no station `{station}`; {remedy}")]
    Station {
        /// The given key.
        key: String,
        /// The setup's name.
        setup: String,
        /// The given station.
        station: String,
        /// The one that was meant.
        remedy: String,
    },
    /// The value has another type.
    #[error("`{key}` = {value}: must be {}", expected(.kind))]
    Type {
        /// The key.
        key: String,
        /// The given value.
        value: String,
        /// Required type.
        kind: ValueKind,
    },
}

const fn expected(kind: &ValueKind) -> &'static str {
    match kind {
        ValueKind::Integer => "a whole number",
        ValueKind::Number => "a number",
        ValueKind::Text => "a text in quotes",
        ValueKind::Truth => "true or false",
    }
}

impl SetupKeys {
    /// Reads the keys of a setup from the schema of setups. With several stations, bus, robot and motions are those of a station.
    ///
    /// # Errors
    ///
    /// The schema is broken.
    pub fn of(cell: &Cell) -> anyhow::Result<Self> {
        let schema: Value = serde_json::from_str(SCHEMA)?;
        let mut keys = BTreeMap::new();
        collect(&schema, &schema, "", 0, &mut keys);
        let setup = cell.name.clone();
        if cell.is_one() {
            return Ok(Self { keys, setup, stations: Vec::new() });
        }
        let stations: Vec<String> = cell.names().map(str::to_owned).collect();
        let at_stations = |(path, key): (String, SetupKey)| {
            let is_of_station = OF_STATION.contains(&path.split('.').next().unwrap_or_default());
            let at = |station: &String| (format!("{STATION}.{station}.{path}"), key);
            if is_of_station { stations.iter().map(at).collect() } else { vec![(path, key)] }
        };
        Ok(Self { keys: keys.into_iter().flat_map(at_stations).collect(), setup, stations })
    }

    /// Finds a key.
    ///
    /// # Errors
    ///
    /// The setup has no such key or station; the error names the one that was probably meant.
    pub fn find(&self, key: &str) -> Result<SetupKey, InvalidKey> {
        self.keys.get(key).copied().ok_or_else(|| self.unknown(key))
    }

    fn unknown(&self, key: &str) -> InvalidKey {
        let station = key.strip_prefix(STATION).and_then(|rest| rest.strip_prefix('.'));
        let [station, of_station] = station
            .map(|rest| rest.split_once('.').unwrap_or((rest, "")))
            .map_or([None; 2], |(name, rest)| [Some(name), Some(rest)]);
        if let Some(station) = station.filter(|name| !self.stations.is_empty() && !self.has(name)) {
            let names: Vec<&str> = self.stations.iter().map(String::as_str).collect();
            let (setup, remedy) = (self.setup.clone(), meant_or_all(station, &names));
            return InvalidKey::Station { key: key.to_owned(), setup, station: station.to_owned(), remedy };
        }
        let known: Vec<&str> = self.keys.keys().map(String::as_str).chain([FAULTS]).collect();
        // A setup of one robot has the keys of a station without its name.
        let without_station = of_station.and_then(|wanted| known.iter().copied().find(|it| *it == wanted));
        // The last name alone often is right, and its section is missing.
        let ending = format!(".{key}");
        let in_section = || known.iter().copied().find(|known| known.ends_with(&ending));
        let meant = without_station.or_else(in_section).or_else(|| nearest(key, known.iter().copied()));
        let remedy =
            meant.map_or_else(|| "docs/keys.md lists all".to_owned(), |meant| meant_or_all(meant, &[meant]));
        InvalidKey::Unknown { key: key.to_owned(), remedy }
    }

    fn has(&self, station: &str) -> bool {
        self.stations.iter().any(|known| known == station)
    }
}

/// Adds the keys of a part of the schema.
fn collect(root: &Value, part: &Value, path: &str, depth: usize, keys: &mut BTreeMap<String, SetupKey>) {
    if depth > DEEPEST {
        return;
    }
    let part = resolved(root, part);
    let variants = part.get("oneOf").and_then(Value::as_array).into_iter().flatten();
    for variant in variants.clone() {
        collect(root, variant, path, depth + 1, keys);
    }
    let Some(properties) = part.get("properties").and_then(Value::as_object) else {
        let kind = kind_of(part).or_else(|| variants.into_iter().find_map(kind_of));
        if let Some(kind) = kind {
            keys.insert(path.to_owned(), SetupKey { kind, is_sourced: false });
        }
        return;
    };
    if let (Some(value), true) = (properties.get("value"), properties.contains_key("from")) {
        if let Some(kind) = kind_of(resolved(root, value)) {
            keys.insert(path.to_owned(), SetupKey { kind, is_sourced: true });
        }
        return;
    }
    for (name, property) in properties {
        let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        collect(root, property, &path, depth + 1, keys);
    }
}

/// Follows references, and takes the part of an optional value that is not null.
fn resolved<'a>(root: &'a Value, part: &'a Value) -> &'a Value {
    let mut part = part;
    for _ in 0..DEEPEST {
        if let Some(name) = part.get("$ref").and_then(Value::as_str).and_then(|path| path.rsplit('/').next())
        {
            part = root.get("$defs").and_then(|definitions| definitions.get(name)).unwrap_or(&Value::Null);
        } else if let Some(any) = part.get("anyOf").and_then(Value::as_array) {
            let is_null = |one: &&Value| one.get("type").and_then(Value::as_str) == Some("null");
            part = any.iter().find(|one| !is_null(one)).unwrap_or(&Value::Null);
        } else {
            break;
        }
    }
    part
}

fn kind_of(part: &Value) -> Option<ValueKind> {
    let kind = part.get("type")?;
    let named = |name: &str| match name {
        "integer" => Some(ValueKind::Integer),
        "number" => Some(ValueKind::Number),
        "string" => Some(ValueKind::Text),
        "boolean" => Some(ValueKind::Truth),
        _ => None,
    };
    match kind {
        Value::String(name) => named(name),
        Value::Array(names) => names.iter().filter_map(Value::as_str).find_map(named),
        _ => None,
    }
}

impl SetupKey {
    /// Converts a value to the type of the key: a whole number may stand for a number.
    ///
    /// # Errors
    ///
    /// It has another type.
    pub fn value(self, key: &str, value: &Scalar) -> Result<Scalar, InvalidKey> {
        let fitting = match (self.kind, value) {
            (ValueKind::Number, Scalar::Integer(whole)) => Some(Scalar::Number(*whole as f64)),
            (ValueKind::Number, Scalar::Number(number)) if number.is_finite() => {
                Some(Scalar::Number(*number))
            }
            (ValueKind::Integer, Scalar::Integer(_))
            | (ValueKind::Text, Scalar::Text(_))
            | (ValueKind::Truth, Scalar::Truth(_)) => Some(value.clone()),
            // The steps of a range are numbers.
            (ValueKind::Integer, Scalar::Number(number)) if libm::trunc(*number) == *number => {
                Some(Scalar::Integer(*number as i64))
            }
            _ => None,
        };
        fitting.ok_or_else(|| InvalidKey::Type {
            key: key.to_owned(),
            value: value.to_string(),
            kind: self.kind,
        })
    }
}

/// A setup as a table, of which single keys are changed.
#[derive(Clone, Debug)]
pub struct SetupTable {
    table: toml::Table,
    name: String,
}

impl SetupTable {
    /// Takes a setup.
    ///
    /// # Errors
    ///
    /// It cannot be written as a table.
    pub fn of(cell: &Cell) -> Result<Self, setup::Error> {
        Ok(Self { table: setup::cell_to_table(cell)?, name: cell.name.clone() })
    }

    /// Returns the setup with other values of some keys. A changed number is `assumed`, as in every study.
    ///
    /// # Errors
    ///
    /// The setup with these values is invalid; the error names the key.
    pub fn with<'a>(
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
    };
    match path.split_once('.') {
        Some((section, rest)) => {
            let section = table.entry(section).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            match section {
                toml::Value::Table(section) => set(section, rest, key, &Scalar::from(value)),
                toml::Value::Array(stations) => {
                    if let Some((station, rest)) = station_of(stations, rest) {
                        set(station, rest, key, &Scalar::from(value));
                    }
                }
                _ => {}
            }
        }
        None if key.is_sourced => {
            let before = table.get(path).and_then(|sourced| sourced.get("value"));
            let note = before.map_or_else(
                || "varied for a study".to_owned(),
                |before| format!("varied for a study, from {before}"),
            );
            let sourced = [("value", value), ("from", "assumed".into()), ("note", note.into())];
            let sourced = sourced.map(|(name, value)| (name.to_owned(), value));
            table.insert(path.to_owned(), toml::Value::Table(sourced.into_iter().collect()));
        }
        None => {
            table.insert(path.to_owned(), value);
        }
    }
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
            other => Self::Text(other.as_str().unwrap_or_default().to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
                    place = place.and_then(|value| match value.as_array() {
                        Some(stations) => stations.iter().find(is_named).cloned(),
                        None => value.get(part).cloned(),
                    });
                }
                let Some(value) = place else { continue };
                let value = if key.is_sourced { value.get("value").cloned().unwrap() } else { value };
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
    fn a_key_that_no_setup_has_is_refused_with_the_one_that_was_meant() {
        let keys = keys("A");
        let refused = |key: &str| keys.find(key).unwrap_err().to_string();
        insta::assert_snapshot!(refused("robot.path_acceleration_mm_s"), @"`robot.path_acceleration_mm_s`: not a number, text or truth of a setup; did you mean `robot.path_acceleration_mm_s2`?");
        insta::assert_snapshot!(refused("path_acceleration_mm_s2"), @"`path_acceleration_mm_s2`: not a number, text or truth of a setup; did you mean `robot.path_acceleration_mm_s2`?");
        insta::assert_snapshot!(refused("xyz"), @"`xyz`: not a number, text or truth of a setup; docs/keys.md lists all");
        assert_eq!(keys.find("plc.queue_depth").unwrap().kind, ValueKind::Integer, "optional");
        assert_eq!(keys.find("bus.kind").unwrap().kind, ValueKind::Text);
        assert!(keys.find("robot.axes.speed_deg_s").is_err(), "a list");
    }

    #[test]
    fn a_key_of_a_station_that_a_setup_does_not_have_is_refused_with_the_one_that_was_meant() {
        let refused = |setup, key: &str| keys(setup).find(key).unwrap_err().to_string();
        insta::assert_snapshot!(refused("E", "station.lft.robot.cycle_us"), @"`station.lft.robot.cycle_us`: setup E has no station `lft`; did you mean `left`?");
        insta::assert_snapshot!(refused("E", "station.third.robot.cycle_us"), @"`station.third.robot.cycle_us`: setup E has no station `third`; there is left, right");
        insta::assert_snapshot!(refused("E", "station.right.robot.cycl_us"), @"`station.right.robot.cycl_us`: not a number, text or truth of a setup; did you mean `station.right.robot.cycle_us`?");
        insta::assert_snapshot!(refused("E", "robot.cycle_us"), @"`robot.cycle_us`: not a number, text or truth of a setup; did you mean `station.left.robot.cycle_us`?");
        insta::assert_snapshot!(refused("E", "station.left"), @"`station.left`: not a number, text or truth of a setup; did you mean `station.left.bus.kind`?");
        insta::assert_snapshot!(refused("A", "station.left.robot.cycle_us"), @"`station.left.robot.cycle_us`: not a number, text or truth of a setup; did you mean `robot.cycle_us`?");
        assert_eq!(keys("E").find("plc.queue_depth").unwrap().kind, ValueKind::Integer);
        assert_eq!(keys("E").find("station.right.bus.kind").unwrap().kind, ValueKind::Text);
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
    fn a_value_of_another_type_is_refused() {
        let keys = keys("A");
        let key = keys.find("bus.cycle_us").unwrap();
        let refused = key.value("bus.cycle_us", &Scalar::Number(0.5)).unwrap_err().to_string();
        insta::assert_snapshot!(refused, @"`bus.cycle_us` = 0.5: must be a whole number");
        let number = keys.find("motions.approximation_mm").unwrap();
        assert_eq!(number.value("x", &Scalar::Integer(20)), Ok(Scalar::Number(20.0)));
        assert!(number.value("x", &Scalar::Text("20".into())).is_err());
        assert!(number.value("x", &Scalar::Number(f64::NAN)).is_err());
    }
}
