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
    /// Six numbers.
    Place,
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

/// Keys of a station besides these sections: all of them are in no setup of one robot.
const ALONE: [(&str, SetupKey); 3] = [
    (APPLICATION, SetupKey { kind: ValueKind::Text, is_sourced: false }),
    ("position", SetupKey { kind: ValueKind::Integer, is_sourced: false }),
    (ROOT, SetupKey { kind: ValueKind::Place, is_sourced: true }),
];

/// The place of an arm, by which it is varied as a whole or by one of its components.
const ROOT: &str = "root_mm_deg";

/// The key of applications: of the only robot, of all stations, or at a station.
pub(super) const APPLICATION: &str = "application";

/// Components of a place, as a study names them.
pub(super) const COMPONENTS: [&str; 6] = ["x", "y", "z", "a", "b", "c"];

/// Returns the path of the application of a station.
pub(super) fn application_of(station: &str) -> String {
    format!("{STATION}.{station}.{APPLICATION}")
}

/// All keys of a setup that a study can vary, by their path.
#[derive(Clone, Debug)]
pub struct SetupKeys {
    pub(super) keys: BTreeMap<String, SetupKey>,
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
        ValueKind::Place => "a list of six numbers: x, y, z in mm, and a, b, c in degrees",
    }
}

impl SetupKeys {
    /// Reads the keys of a setup from the schema of setups. With several stations, bus, robot and motions are those of a station, which
    /// has an application, a place in the cell and a position in its line too.
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
        let mut keys: BTreeMap<_, _> = keys.into_iter().flat_map(at_stations).collect();
        let component = SetupKey { kind: ValueKind::Number, is_sourced: true };
        for station in &stations {
            let own = |key: &str| format!("{STATION}.{station}.{key}");
            keys.extend(ALONE.map(|(name, key)| (own(name), key)));
            keys.extend(COMPONENTS.map(|name| (own(&format!("{ROOT}.{name}")), component)));
        }
        Ok(Self { keys, setup, stations })
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
            (ValueKind::Place, Scalar::Numbers(numbers))
                if numbers.len() == COMPONENTS.len() && numbers.iter().all(|number| number.is_finite()) =>
            {
                Some(value.clone())
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(setup: &str) -> SetupKeys {
        SetupKeys::of(&setup::cell(setup).unwrap().0).unwrap()
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
        insta::assert_snapshot!(refused("E", "station.left"), @"`station.left`: not a number, text or truth of a setup; docs/keys.md lists all");
        insta::assert_snapshot!(refused("A", "station.left.robot.cycle_us"), @"`station.left.robot.cycle_us`: not a number, text or truth of a setup; did you mean `robot.cycle_us`?");
        assert_eq!(keys("E").find("plc.queue_depth").unwrap().kind, ValueKind::Integer);
        assert_eq!(keys("E").find("station.right.bus.kind").unwrap().kind, ValueKind::Text);
        for key in ["station.left.root_mm_deg.w", "station.left.applications", "station.left.root_mm_deg.x.y"]
        {
            assert!(refused("E", key).starts_with(&format!("`{key}`: not a number, text or truth")), "{key}");
        }
        assert!(refused("A", "station.left.root_mm_deg").starts_with("`station.left.root_mm_deg`: not a"));
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
        let keys = self::keys("E");
        let root = keys.find("station.left.root_mm_deg").unwrap();
        for values in [vec![0.0; 5], vec![0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0]] {
            let refused = root.value("station.left.root_mm_deg", &Scalar::Numbers(values)).unwrap_err();
            let wanted = "must be a list of six numbers: x, y, z in mm, and a, b, c in degrees";
            assert!(refused.to_string().ends_with(wanted), "{refused}");
        }
        assert!(root.value("station.left.root_mm_deg", &Scalar::Number(0.0)).is_err());
    }
}
