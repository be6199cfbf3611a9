//! The option `--attach`: nodes that already run.

use std::str::FromStr;

use node::list::values;
use setup::meant_or_all;

/// Name of the only robot of a setup.
const ONLY_ROBOT: &str = "robot";

/// Addresses of nodes that already run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Attach {
    /// Host and port of the PLC's control port.
    pub plc: String,
    /// Those of robots, each with the name of its station; `robot` for the only one.
    pub robots: Vec<(String, String)>,
}

/// Why a text is not an [`Attach`], or not one of the setup.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum AttachError {
    /// A part is not a node's address.
    #[error("`{0}` is not plc=HOST:PORT or robot=HOST:PORT, with several robots STATION=HOST:PORT")]
    Part(String),
    /// A node is given twice.
    #[error("{0}=… is there twice: give each node once")]
    Twice(String),
    /// The PLC is not given, but it starts and times every run.
    #[error("plc=HOST:PORT is missing: the PLC starts and times every run")]
    NoPlc,
    /// The setup has no such station.
    #[error("setup {setup} has no node `{name}`: {}", meant_or_all(name, &stations.iter().map(String::as_str).collect::<Vec<_>>()))]
    Unknown {
        /// The setup's name.
        setup: String,
        /// The name.
        name: String,
        /// Names of its nodes.
        stations: Vec<String>,
    },
    /// A station of several is not given.
    #[error("station {0} has no address: add {0}=HOST:PORT")]
    Missing(String),
}

impl FromStr for Attach {
    type Err = AttachError;

    fn from_str(text: &str) -> Result<Self, AttachError> {
        let (mut plc, mut robots) = (None, Vec::<(String, String)>::new());
        for part in values(text) {
            let wrong = || AttachError::Part(part.to_owned());
            let (node, address) = part.split_once('=').ok_or_else(wrong)?;
            let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
            if node.is_empty() || host.is_empty() || port.parse::<u16>().is_err() {
                return Err(wrong());
            }
            let is_twice = match node {
                "plc" => plc.replace(address.to_owned()).is_some(),
                _ => {
                    let is_twice = robots.iter().any(|(other, _)| other == node);
                    robots.push((node.to_owned(), address.to_owned()));
                    is_twice
                }
            };
            if is_twice {
                return Err(AttachError::Twice(node.to_owned()));
            }
        }
        Ok(Self { plc: plc.ok_or(AttachError::NoPlc)?, robots })
    }
}

impl Attach {
    /// Returns the address of the only robot; `None` if it is not one of our nodes.
    #[must_use]
    pub fn robot(&self) -> Option<&str> {
        self.robots.first().map(|(_, address)| address.as_str())
    }

    /// Checks that these are nodes of a setup with one robot, which may be missing.
    ///
    /// # Errors
    ///
    /// [`AttachError::Unknown`].
    pub fn check_one(&self, setup: &str) -> Result<(), AttachError> {
        self.check_known(setup, &[ONLY_ROBOT])
    }

    /// Checks that these are all stations of a setup with several.
    ///
    /// # Errors
    ///
    /// [`AttachError::Unknown`] and [`AttachError::Missing`].
    pub fn check_all(&self, setup: &str, stations: &[&str]) -> Result<(), AttachError> {
        self.check_known(setup, stations)?;
        let is_missing = |station: &&&str| !self.robots.iter().any(|(name, _)| name == **station);
        let missing = stations.iter().find(is_missing);
        missing.map_or(Ok(()), |station| Err(AttachError::Missing((*station).to_owned())))
    }

    fn check_known(&self, setup: &str, stations: &[&str]) -> Result<(), AttachError> {
        let Some((name, _)) = self.robots.iter().find(|(name, _)| !stations.contains(&name.as_str())) else {
            return Ok(());
        };
        let stations = std::iter::once("plc").chain(stations.iter().copied()).map(str::to_owned).collect();
        Err(AttachError::Unknown { setup: setup.to_owned(), name: name.clone(), stations })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_station_of_a_cell_is_given_once_and_by_its_name() {
        let check = |text: &str| {
            let attach = text.parse::<Attach>().map_err(|error| error.to_string())?;
            attach.check_all("E", &["left", "right"]).map_err(|error| error.to_string())
        };
        assert_eq!(check("right=b:2,plc=a:1,left=c:3"), Ok(()));
        let wrong = [
            "plc=a:1,left=b:2",
            "plc=a:1,left=b:2,rihgt=c:3",
            "plc=a:1,left=b:2,right=c:3,robot=d:4",
            "plc=a:1,left=b:2,left=c:3",
            "left=b:2,right=c:3",
            "plc=a:1,left=b",
        ];
        let said: Vec<_> = wrong.into_iter().map(|text| check(text).unwrap_err()).collect();
        insta::assert_snapshot!(said.join("\n"), @r"
        station right has no address: add right=HOST:PORT
        setup E has no node `rihgt`: did you mean `right`?
        setup E has no node `robot`: there is plc, left, right
        left=… is there twice: give each node once
        plc=HOST:PORT is missing: the PLC starts and times every run
        `left=b` is not plc=HOST:PORT or robot=HOST:PORT, with several robots STATION=HOST:PORT
        ");
    }
}
