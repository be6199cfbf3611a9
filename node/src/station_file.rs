//! The file in which a node keeps the name and the address that its bus set permanently, and what the operator wrote about it,
//! as a device keeps them in its flash memory. The thread beside the cyclic one writes it.

use std::fmt::{self, Write as _};
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};

use protocol::fieldbus::{Maintenance, StationAddress, ToStore};
use serde::{Deserialize, Serialize};

use crate::ShortText;

/// A node's station file. It exists only while something is stored.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct StationFile {
    path: PathBuf,
}

/// What is stored of a station.
#[derive(Clone, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// Its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its IP address.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub address: Option<Address>,
    /// What the operator of the plant wrote about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub maintenance: Option<MaintenanceTexts>,
}

/// What the operator of a plant wrote about a station, without the blanks and zeros behind it. A character is a byte of the
/// bus, so none is above U+00FF.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaintenanceTexts {
    /// What it is for, up to 32 characters.
    pub function: String,
    /// Where it is, up to 22 characters.
    pub location: String,
    /// When it was installed, up to 16 characters.
    pub date: String,
    /// A comment, up to 54 characters.
    pub descriptor: String,
    /// A signature, up to 54 characters.
    pub signature: String,
}

impl From<&Maintenance> for MaintenanceTexts {
    fn from(Maintenance { function, location, date, descriptor, signature }: &Maintenance) -> Self {
        fn text(bytes: &[u8], filling: char) -> String {
            let text: String = bytes.iter().copied().map(char::from).collect();
            text.trim_end_matches(filling).to_owned()
        }
        Self {
            function: text(function, ' '),
            location: text(location, ' '),
            date: text(date, ' '),
            descriptor: text(descriptor, ' '),
            signature: text(signature, '\0'),
        }
    }
}

impl From<&MaintenanceTexts> for Maintenance {
    fn from(texts: &MaintenanceTexts) -> Self {
        fn fill<const LEN: usize>(mut field: [u8; LEN], text: &str) -> [u8; LEN] {
            let bytes = text.chars().map(|char| u8::try_from(char).unwrap_or(b'?'));
            field.iter_mut().zip(bytes).for_each(|(place, byte)| *place = byte);
            field
        }
        let MaintenanceTexts { function, location, date, descriptor, signature } = texts;
        let blank = Self::default();
        Self {
            function: fill(blank.function, function),
            location: fill(blank.location, location),
            date: fill(blank.date, date),
            descriptor: fill(blank.descriptor, descriptor),
            signature: fill(blank.signature, signature),
        }
    }
}

impl fmt::Display for Station {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.name, self.address) {
            (Some(name), Some(Address { ip, .. })) => write!(f, "named {name}, address {ip}"),
            (Some(name), None) => write!(f, "named {name}"),
            (None, Some(Address { ip, .. })) => write!(f, "address {ip}"),
            (None, None) => f.write_str("neither name nor address"),
        }
    }
}

/// An IP address with its mask and gateway.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Address {
    /// The station's own address.
    pub ip: Ipv4Addr,
    /// Its subnet mask.
    pub mask: Ipv4Addr,
    /// Its gateway; 0.0.0.0 or its own address if it has none.
    pub gateway: Ipv4Addr,
}

/// What the cyclic thread hands over to be stored, without allocation.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct StationRecord {
    name: Option<ShortText>,
    address: Option<Address>,
    maintenance: Option<Maintenance>,
}

impl From<ToStore<'_>> for StationRecord {
    fn from(ToStore { name, address, maintenance }: ToStore<'_>) -> Self {
        let short = |name: &str| {
            let mut text = ShortText::default();
            // The longest station name has 240 bytes, which fit.
            let _ = text.write_str(name);
            text
        };
        let address =
            address.map(|StationAddress { address, mask, gateway }| Address { ip: address, mask, gateway });
        Self { name: name.map(short), address, maintenance: maintenance.copied() }
    }
}

impl From<&StationRecord> for Station {
    fn from(StationRecord { name, address, maintenance }: &StationRecord) -> Self {
        let name = name.as_ref().map(|name| name.as_str().to_owned());
        Self { name, address: *address, maintenance: maintenance.as_ref().map(MaintenanceTexts::from) }
    }
}

/// Why a station file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StationFileError {
    /// It cannot be read.
    #[error("reading the station file {}: {reason}", path.display())]
    Read {
        /// Where it is.
        path: PathBuf,
        /// The kernel's error.
        reason: io::Error,
    },
    /// It does not hold a station.
    #[error("the station file {} does not hold a name and an address: {reason}; remove it to start anew", path.display())]
    Content {
        /// Where it is.
        path: PathBuf,
        /// What is wrong.
        reason: serde_json::Error,
    },
}

impl StationFile {
    /// Uses the file at this path, which need not exist.
    #[must_use]
    pub const fn at(path: PathBuf) -> Self {
        Self { path }
    }

    /// Returns the file of the station on this interface in the user's state directory (`STATE_DIRECTORY` of systemd,
    /// `XDG_STATE_HOME` or `~/.local/state`); `None` if there is no such directory.
    #[must_use]
    pub fn of_interface(interface: &str) -> Option<Self> {
        let variable = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let directory = variable("STATE_DIRECTORY")
            .or_else(|| Some(variable("XDG_STATE_HOME")?.join("skillbench")))
            .or_else(|| Some(variable("HOME")?.join(".local/state/skillbench")))?;
        Some(Self { path: directory.join(format!("station-{interface}.json")) })
    }

    /// Returns where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads what is stored; nothing, if there is no file.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or does not hold a station.
    pub fn load(&self) -> Result<Station, StationFileError> {
        let path = || self.path.clone();
        let text = match setup::read_plain_file(&self.path, setup::MOST_FILE_BYTES) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Station::default()),
            Err(reason) => return Err(StationFileError::Read { path: path(), reason }),
        };
        serde_json::from_slice(&text).map_err(|reason| StationFileError::Content { path: path(), reason })
    }

    /// Stores a station so that it is there after a loss of power: the whole new file or the whole old one. Nothing to store
    /// removes the file.
    ///
    /// # Errors
    ///
    /// The kernel's error.
    pub fn save(&self, station: &Station) -> io::Result<()> {
        if *station == Station::default() {
            return match fs::remove_file(&self.path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
                _ => Ok(()),
            };
        }
        let directory = self.path.parent().filter(|parent| !parent.as_os_str().is_empty());
        let directory = directory.unwrap_or(Path::new("."));
        fs::create_dir_all(directory)?;
        let mut new = self.path.clone().into_os_string();
        new.push(".new");
        let mut file = File::create(&new)?;
        let mut text = serde_json::to_vec_pretty(station)?;
        text.push(b'\n');
        file.write_all(&text)?;
        file.sync_all()?;
        fs::rename(&new, &self.path)?;
        File::open(directory)?.sync_all()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> Station {
        let address = Address {
            ip: Ipv4Addr::new(192, 168, 64, 7),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            gateway: Ipv4Addr::UNSPECIFIED,
        };
        Station { name: Some("robot".into()), address: Some(address), maintenance: None }
    }

    fn maintenance() -> Maintenance {
        let mut maintenance = Maintenance { signature: [0xE9; 54], ..Maintenance::default() };
        maintenance.function[..5].copy_from_slice(b"a  b\0");
        maintenance.date[15] = b'x';
        maintenance
    }

    #[test]
    fn what_the_operator_wrote_is_read_again_byte_for_byte() {
        let place = tempfile::tempdir().unwrap();
        let directory = place.path();
        let file = StationFile::at(directory.join("robot.json"));
        for maintenance in [maintenance(), Maintenance { date: [0xFF; 16], ..Maintenance::default() }] {
            let record =
                StationRecord::from(ToStore { maintenance: Some(&maintenance), ..ToStore::default() });
            file.save(&Station::from(&record)).unwrap();
            let texts = file.load().unwrap().maintenance.unwrap();
            assert_eq!(Maintenance::from(&texts), maintenance);
        }
        // A file that a person edited may have longer texts and other characters.
        let texts =
            MaintenanceTexts { date: "\u{20AC}".repeat(20), ..MaintenanceTexts::from(&maintenance()) };
        assert_eq!(Maintenance::from(&texts).date, [b'?'; 16]);
    }

    #[test]
    fn what_was_stored_is_read_again_and_nothing_leaves_no_file() {
        let place = tempfile::tempdir().unwrap();
        let directory = place.path();
        let file = StationFile::at(directory.join("deep/er/robot.json"));
        assert_eq!(file.load().unwrap(), Station::default());
        file.save(&robot()).unwrap();
        assert_eq!(file.load().unwrap(), robot());
        let name_only = Station { address: None, ..robot() };
        file.save(&name_only).unwrap();
        assert_eq!(file.load().unwrap(), name_only);
        file.save(&Station::default()).unwrap();
        assert!(!file.path().exists());
        file.save(&Station::default()).unwrap();
        assert_eq!(fs::read_dir(directory.join("deep/er")).unwrap().count(), 0, "no file is left behind");
    }

    #[test]
    fn a_damaged_file_and_a_directory_in_its_place_are_named() {
        let place = tempfile::tempdir().unwrap();
        let directory = place.path();
        let file = StationFile::at(directory.join("robot.json"));
        fs::write(file.path(), "{\"name\": 5}").unwrap();
        let error = file.load().unwrap_err().to_string();
        assert!(error.contains("robot.json") && error.contains("remove it"), "{error}");
        let in_place = StationFile::at(directory.to_owned());
        assert!(matches!(in_place.load(), Err(StationFileError::Read { .. })));
        assert!(in_place.save(&robot()).is_err());
    }

    #[test]
    fn a_record_of_the_cyclic_thread_becomes_what_is_stored() {
        let address = StationAddress {
            address: Ipv4Addr::new(192, 168, 64, 7),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            gateway: Ipv4Addr::UNSPECIFIED,
        };
        let record =
            StationRecord::from(ToStore { name: Some("robot"), address: Some(address), maintenance: None });
        assert_eq!(Station::from(&record), robot());
        let longest = "a".repeat(240);
        let record = StationRecord::from(ToStore { name: Some(&longest), ..ToStore::default() });
        assert_eq!(Station::from(&record), Station { name: Some(longest), ..Station::default() });
    }
}
