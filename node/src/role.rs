//! Which of the two nodes: the PLC or the robot.

use std::fmt;

use serde::{Deserialize, Serialize};

/// One of the two nodes.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum NodeRole {
    /// The PLC.
    #[serde(rename = "plc-node")]
    Plc,
    /// The robot.
    #[serde(rename = "robot-node")]
    Robot,
}

impl NodeRole {
    /// Returns the name of the node's program.
    #[must_use]
    pub const fn program(self) -> &'static str {
        match self {
            Self::Plc => "plc-node",
            Self::Robot => "robot-node",
        }
    }
}

impl fmt::Display for NodeRole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.program())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_has_the_same_name_in_text_and_in_json() {
        for role in [NodeRole::Plc, NodeRole::Robot] {
            assert_eq!(serde_json::to_string(&role).unwrap(), format!("\"{role}\""));
        }
    }
}
