//! The nodes of a run that the bench did not start itself.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The nodes that the bench was attached to.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Attached {
    /// The PLC.
    pub plc: AttachedAt,
    /// The robot; null if no robot node was attached, as where the robot is not one of skillbench's nodes.
    pub robot: Option<AttachedAt>,
    /// Identity that the robot reports on its bus; absent if the PLC did not report it, or in a run of an older version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identity: Option<String>,
}

/// The nodes of a cell that the bench was attached to.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CellAttached {
    /// The PLC.
    pub plc: AttachedAt,
    /// The robots, in the order of the stations.
    pub robots: Vec<AttachedAt>,
    /// Identity that each robot reports on its bus, in the order of the stations; null where the PLC did not report it, empty in a run of an
    /// older version.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub identities: Vec<Option<String>>,
}

/// A node that ran already.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct AttachedAt {
    /// Host and port of its control port, as given to the bench.
    pub address: String,
    /// Its version; null if it did not tell.
    pub version: Option<String>,
    /// Its computer's name, and the kernel with its release; null if it did not tell.
    pub host: Option<String>,
}

impl fmt::Display for Attached {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PLC at {}; robot ", self.plc)?;
        match &self.robot {
            Some(robot) => write!(f, "at {robot}")?,
            None => f.write_str("not attached")?,
        }
        self.identity.as_ref().map_or(Ok(()), |identity| write!(f, "; on the bus the robot is {identity}"))
    }
}

impl fmt::Display for AttachedAt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.address)?;
        if let Some(version) = &self.version {
            write!(f, ", skillbench {version}")?;
        }
        self.host.as_ref().map_or(Ok(()), |host| write!(f, " on {host}"))
    }
}

impl CellAttached {
    /// Formats the nodes with what the robots say of themselves on their buses; `names` are those of the stations.
    #[must_use]
    pub fn shown<'a>(&self, names: impl Iterator<Item = &'a str>) -> String {
        let mut text = format!("PLC at {}", self.plc);
        for (index, name) in names.enumerate() {
            if let Some(robot) = self.robots.get(index) {
                text.push_str(&format!("; {name} at {robot}"));
            }
            if let Some(Some(identity)) = self.identities.get(index) {
                text.push_str(&format!("; on the bus {name} is {identity}"));
            }
        }
        text
    }
}
