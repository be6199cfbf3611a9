//! The choice as a TOML file.
//!
//! ```toml
//! access_point = "DAP_1"
//!
//! [modules]
//! "1" = "ID_Module_8DI"
//! "2.1" = "none"
//! ```

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::xml::number;

/// Choice from a catalogue. A value that is left out is that of the file, where it gives only one.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceChoice {
    /// Access point of a GSDML, by its ID.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub access_point: Option<String>,
    /// Connection of an EDS, by its name or number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub connection: Option<String>,
    /// Device of an ESI, by its type or name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device_name: Option<String>,
    /// Revision of an ESI's device.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        serialize_with = "to_hex_option",
        deserialize_with = "from_hex_option"
    )]
    pub revision: Option<u32>,
    /// Process data objects that are assigned instead of those of the ESI.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        serialize_with = "to_hex_list",
        deserialize_with = "from_hex_list"
    )]
    pub pdos: Option<Vec<u16>>,
    /// Modules and submodules by their place; [`DeviceChoice::EMPTY`] leaves a place empty.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub modules: BTreeMap<ModulePlace, String>,
}

/// Reason why a file is not a choice.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{0}")]
pub struct ChoiceFileError(String);

/// Longest file that is read.
const MOST_BYTES: usize = 1 << 20;

impl DeviceChoice {
    /// Module that leaves its place empty.
    pub const EMPTY: &'static str = "none";

    /// Reads a choice from a TOML file.
    ///
    /// # Errors
    ///
    /// It is longer than 1 MiB, is not TOML, or has a key or value that a choice does not have.
    pub fn from_toml(text: &str) -> Result<Self, ChoiceFileError> {
        if text.len() > MOST_BYTES {
            return Err(ChoiceFileError(format!("{} bytes: a choice has at most {MOST_BYTES}", text.len())));
        }
        toml::from_str(text).map_err(|error| ChoiceFileError(error.to_string().trim_end().to_owned()))
    }

    /// Writes the choice as a TOML file.
    ///
    /// # Panics
    ///
    /// Never: a choice has only texts, which TOML writes.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// Takes over what another choice names, as options do over a file.
    #[must_use]
    pub fn replaced_by(mut self, other: Self) -> Self {
        self.access_point = other.access_point.or(self.access_point);
        self.connection = other.connection.or(self.connection);
        self.device_name = other.device_name.or(self.device_name);
        self.revision = other.revision.or(self.revision);
        self.pdos = other.pdos.or(self.pdos);
        self.modules.extend(other.modules);
        self
    }
}

/// Place of a module: a slot, or a subslot of it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct ModulePlace {
    /// Slot.
    pub slot: u16,
    /// Subslot, for a submodule.
    pub subslot: Option<u16>,
}

/// Reason why a text is not a place.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("must be SLOT or SLOT.SUBSLOT, as in 1 or 1.2, each 0 to 65535")]
pub struct PlaceError;

impl FromStr for ModulePlace {
    type Err = PlaceError;

    fn from_str(text: &str) -> Result<Self, PlaceError> {
        let part = |text: &str| number::<u16>(text).ok_or(PlaceError);
        match text.split_once('.') {
            Some((slot, subslot)) => Ok(Self { slot: part(slot)?, subslot: Some(part(subslot)?) }),
            None => Ok(Self { slot: part(text)?, subslot: None }),
        }
    }
}

impl fmt::Display for ModulePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.subslot {
            Some(subslot) => write!(f, "{}.{subslot}", self.slot),
            None => write!(f, "{}", self.slot),
        }
    }
}

impl Serialize for ModulePlace {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for ModulePlace {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map_err(|error| serde::de::Error::custom(format!("place `{text}`: {error}")))
    }
}

fn to_hex_option<S: Serializer>(value: &Option<u32>, serializer: S) -> Result<S::Ok, S::Error> {
    match value {
        Some(value) => serializer.collect_str(&format_args!("0x{value:08X}")),
        None => serializer.serialize_none(),
    }
}

fn from_hex_option<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u32>, D::Error> {
    from_text(&String::deserialize(deserializer)?).map(Some)
}

fn to_hex_list<S: Serializer>(list: &Option<Vec<u16>>, serializer: S) -> Result<S::Ok, S::Error> {
    let texts = list.iter().flatten().map(|value| format!("0x{value:04X}"));
    serializer.collect_seq(texts)
}

fn from_hex_list<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<u16>>, D::Error> {
    let texts = Vec::<String>::deserialize(deserializer)?;
    texts.iter().map(|text| from_text(text)).collect::<Result<_, _>>().map(Some)
}

fn from_text<N: TryFrom<i64>, E: serde::de::Error>(text: &str) -> Result<N, E> {
    number(text).ok_or_else(|| E::custom(format!("`{text}`: must be a number such as \"0x1A00\"")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_is_written_and_read_back_to_the_same() {
        let modules = [("1", "A \"quoted\" ID"), ("2.1", "none")];
        let choice = DeviceChoice {
            access_point: Some("DAP".to_owned()),
            connection: Some("Exclusive Owner".to_owned()),
            device_name: Some("EL3004 \u{00B5}".to_owned()),
            revision: Some(0x0010_0000),
            pdos: Some(vec![0x1A00, 0x1600]),
            modules: modules.map(|(place, id)| (place.parse().unwrap(), id.to_owned())).into(),
        };
        assert_eq!(DeviceChoice::from_toml(&choice.to_toml()), Ok(choice));
        assert_eq!(DeviceChoice::from_toml(""), Ok(DeviceChoice::default()));
        let nothing_assigned = DeviceChoice { pdos: Some(Vec::new()), ..DeviceChoice::default() };
        assert_eq!(DeviceChoice::from_toml(&nothing_assigned.to_toml()), Ok(nothing_assigned));
    }

    #[test]
    fn a_file_that_is_not_a_choice_is_refused_with_its_key() {
        for (text, expected) in [
            ("access_points = \"A\"", "access_points"),
            ("revision = \"1x\"", "must be a number such as"),
            ("[modules]\n\"1.2.3\" = \"A\"", "place `1.2.3`: must be SLOT or SLOT.SUBSLOT"),
            ("[modules]\n\"70000\" = \"A\"", "place `70000`: must be"),
            ("pdos = [\"0x11A00\"]", "must be a number such as"),
        ] {
            let error = DeviceChoice::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }

    #[test]
    fn options_replace_what_a_file_chooses() {
        let file =
            DeviceChoice::from_toml("access_point = \"A\"\n[modules]\n\"1\" = \"X\"\n\"2\" = \"Y\"").unwrap();
        let options = DeviceChoice::from_toml("access_point = \"B\"\n[modules]\n\"2\" = \"Z\"").unwrap();
        let both = "access_point = \"B\"\n\n[modules]\n1 = \"X\"\n2 = \"Z\"\n";
        assert_eq!(file.replaced_by(options).to_toml(), both);
    }
}
