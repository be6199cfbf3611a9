//! The keys of a setup as a study names them, from the schema of the setup's file.

use std::collections::BTreeMap;

use serde_json::Value;
use setup::{Setup, meant_or_all, nearest};

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

/// All keys of a setup that a study can vary, by their path.
#[derive(Clone, Debug)]
pub struct SetupKeys(BTreeMap<String, SetupKey>);

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
    /// Reads the keys from the schema of setups.
    ///
    /// # Errors
    ///
    /// The schema is broken.
    pub fn read() -> anyhow::Result<Self> {
        let schema: Value = serde_json::from_str(SCHEMA)?;
        let mut keys = BTreeMap::new();
        collect(&schema, &schema, "", 0, &mut keys);
        Ok(Self(keys))
    }

    /// Finds a key.
    ///
    /// # Errors
    ///
    /// No setup has it; the error names the one that was probably meant.
    pub fn find(&self, key: &str) -> Result<SetupKey, InvalidKey> {
        self.0.get(key).copied().ok_or_else(|| {
            let known: Vec<&str> = self.0.keys().map(String::as_str).chain([FAULTS]).collect();
            // The last name alone often is right, and its section is missing.
            let ending = format!(".{key}");
            let in_section = known.iter().copied().find(|known| known.ends_with(&ending));
            let meant = in_section.or_else(|| nearest(key, known.iter().copied()));
            let remedy = meant
                .map_or_else(|| "docs/keys.md lists all".to_owned(), |meant| meant_or_all(meant, &[meant]));
            InvalidKey::Unknown { key: key.to_owned(), remedy }
        })
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
    pub fn of(setup: &Setup) -> Result<Self, setup::Error> {
        Ok(Self { table: setup::setup_to_table(setup)?, name: setup.name.clone() })
    }

    /// Returns the setup with other values of some keys. A changed number is `assumed`, as in every study.
    ///
    /// # Errors
    ///
    /// The setup with these values is invalid; the error names the key.
    pub fn with<'a>(
        &self,
        changes: impl IntoIterator<Item = (&'a str, SetupKey, &'a Scalar)>,
    ) -> Result<Setup, setup::Error> {
        let mut table = self.table.clone();
        for (path, key, value) in changes {
            set(&mut table, path, key, value);
        }
        setup::setup_from_table(&format!("setup {}", self.name), table)
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
            if let toml::Value::Table(section) = section {
                set(section, rest, key, &Scalar::from(value));
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

    #[test]
    fn each_key_of_the_built_in_setups_is_found_and_setting_it_to_its_own_value_changes_only_its_source() {
        let keys = SetupKeys::read().unwrap();
        let mut found = 0;
        for (name, _) in setup::SETUPS {
            let setup = setup::setup(name).unwrap();
            let table = SetupTable::of(&setup).unwrap();
            for (path, key) in &keys.0 {
                let mut place = Some(toml::Value::Table(table.table.clone()));
                for part in path.split('.') {
                    place = place.and_then(|value| value.get(part).cloned());
                }
                let Some(value) = place else { continue };
                let value = if key.is_sourced { value.get("value").cloned().unwrap() } else { value };
                let value = Scalar::from(value);
                let same = table.with([(path.as_str(), *key, &value)]).unwrap();
                assert_eq!(same.name, setup.name, "{path}");
                assert_eq!(key.value(path, &value).unwrap(), value, "{path}");
                found += 1;
            }
        }
        assert!(found > 100, "{found}");
    }

    #[test]
    fn a_key_that_no_setup_has_is_refused_with_the_one_that_was_meant() {
        let keys = SetupKeys::read().unwrap();
        let refused = |key: &str| keys.find(key).unwrap_err().to_string();
        insta::assert_snapshot!(refused("robot.path_acceleration_mm_s"), @"`robot.path_acceleration_mm_s`: not a number, text or truth of a setup; did you mean `robot.path_acceleration_mm_s2`?");
        insta::assert_snapshot!(refused("path_acceleration_mm_s2"), @"`path_acceleration_mm_s2`: not a number, text or truth of a setup; did you mean `robot.path_acceleration_mm_s2`?");
        insta::assert_snapshot!(refused("xyz"), @"`xyz`: not a number, text or truth of a setup; docs/keys.md lists all");
        assert_eq!(keys.find("plc.queue_depth").unwrap().kind, ValueKind::Integer, "optional");
        assert_eq!(keys.find("bus.kind").unwrap().kind, ValueKind::Text);
        assert!(keys.find("robot.axes.speed_deg_s").is_err(), "a list");
    }

    #[test]
    fn a_value_of_another_type_is_refused() {
        let keys = SetupKeys::read().unwrap();
        let key = keys.find("bus.cycle_us").unwrap();
        let refused = key.value("bus.cycle_us", &Scalar::Number(0.5)).unwrap_err().to_string();
        insta::assert_snapshot!(refused, @"`bus.cycle_us` = 0.5: must be a whole number");
        let number = keys.find("motions.approximation_mm").unwrap();
        assert_eq!(number.value("x", &Scalar::Integer(20)), Ok(Scalar::Number(20.0)));
        assert!(number.value("x", &Scalar::Text("20".into())).is_err());
        assert!(number.value("x", &Scalar::Number(f64::NAN)).is_err());
    }
}
