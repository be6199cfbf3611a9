//! Which node of a rig, and its name in messages.

use std::fmt;

use ::node::role::NodeRole;

/// A node of a rig.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum RigNode {
    Plc,
    /// The robot of the station with this index.
    Robot(usize),
}

impl RigNode {
    /// Returns the place of the node in lists of all nodes, the PLC's first.
    pub(super) const fn index(self) -> usize {
        match self {
            Self::Plc => 0,
            Self::Robot(station) => station + 1,
        }
    }

    /// Returns all nodes of a rig with so many robots.
    pub(super) fn all(robots: usize) -> impl Iterator<Item = Self> + Clone {
        std::iter::once(Self::Plc).chain((0..robots).map(Self::Robot))
    }

    pub(super) const fn role(self) -> NodeRole {
        match self {
            Self::Plc => NodeRole::Plc,
            Self::Robot(_) => NodeRole::Robot,
        }
    }
}

/// A node by its program, and by its station where there are several.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct NodeName {
    /// Its program.
    pub role: NodeRole,
    /// Its station; `None` for a PLC, and for the only robot.
    pub station: Option<String>,
}

impl From<NodeRole> for NodeName {
    fn from(role: NodeRole) -> Self {
        Self { role, station: None }
    }
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { role, station } = self;
        match station {
            Some(station) => write!(f, "{role} of station {station}"),
            None => role.fmt(f),
        }
    }
}
