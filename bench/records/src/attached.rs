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
            Some(robot) => write!(f, "at {robot}"),
            None => f.write_str("not attached"),
        }
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
