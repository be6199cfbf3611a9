//! The option `--attach`: nodes that already run.

use std::str::FromStr;

use node::list::values;

/// Addresses of nodes that already run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Attach {
    /// Host and port of the PLC's control port.
    pub plc: String,
    /// Host and port of the robot's control port; `None` if the robot is not one of our nodes.
    pub robot: Option<String>,
}

/// Why a text is not an [`Attach`].
#[derive(Debug, thiserror::Error)]
pub enum AttachError {
    /// A part is not a node's address.
    #[error("`{0}` is not plc=HOST:PORT or robot=HOST:PORT")]
    Part(String),
    /// A node is given twice.
    #[error("{0}=… is there twice")]
    Twice(&'static str),
    /// The PLC is not given, but it starts and times every run.
    #[error("plc=HOST:PORT is missing: the PLC starts and times every run")]
    NoPlc,
}

impl FromStr for Attach {
    type Err = AttachError;

    fn from_str(text: &str) -> Result<Self, AttachError> {
        let (mut plc, mut robot) = (None, None);
        for part in values(text) {
            let wrong = || AttachError::Part(part.to_owned());
            let (node, address) = part.split_once('=').ok_or_else(wrong)?;
            let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
            if host.is_empty() || port.parse::<u16>().is_err() {
                return Err(wrong());
            }
            let (name, place) = match node {
                "plc" => ("plc", &mut plc),
                "robot" => ("robot", &mut robot),
                _ => return Err(wrong()),
            };
            if place.replace(address.to_owned()).is_some() {
                return Err(AttachError::Twice(name));
            }
        }
        Ok(Self { plc: plc.ok_or(AttachError::NoPlc)?, robot })
    }
}
