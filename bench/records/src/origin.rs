//! Results of a PLC and a robot that no bench ran: from a capture, or imported from the PLC.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Source of the samples of a run that no bench ran.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SampleOrigin {
    /// Kind of the source.
    pub kind: OriginKind,
    /// Name of the file, without its directory.
    pub file: String,
    /// Bus that carried the images; null if that is not known.
    pub bus: Option<String>,
    /// The PLC.
    pub plc: MeasuredPeer,
    /// The robot.
    pub robot: MeasuredPeer,
}

/// Kind of the source of samples.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum OriginKind {
    /// From the frames of a capture, by its clock.
    Capture,
    /// By the PLC itself, from which they were read out.
    Import,
}

/// A PLC or a robot, as far as it is known.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
pub struct MeasuredPeer {
    /// Address of its cyclic frames.
    pub address: Option<String>,
    /// MAC address of the interface that sends them.
    pub mac: Option<String>,
    /// Station name.
    pub name: Option<String>,
    /// Vendor and device, or what the user calls it.
    pub identity: Option<String>,
}

/// Execution times of a type that were measured elsewhere, in their order.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct MeasuredType {
    /// Times in ms, or why the repetition failed.
    pub repetitions: Vec<Result<MeasuredTime, String>>,
}

/// Time of one repetition.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct MeasuredTime {
    /// By the PLC or the capture, in ms.
    pub execution_ms: f64,
    /// By the robot, in ms; `None` if that is not known.
    pub robot_execution_ms: Option<f64>,
    /// Motions that ended in a stop because the next one did not arrive in time; `None` if that is not known.
    pub blends_suppressed: Option<u32>,
}

impl OriginKind {
    /// Returns the mode in results and lists.
    #[must_use]
    pub const fn mode(self) -> &'static str {
        match self {
            Self::Capture => "captured",
            Self::Import => "imported",
        }
    }
}

impl fmt::Display for SampleOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, file, bus, plc, robot } = self;
        match kind {
            OriginKind::Capture => write!(f, "Measured from the capture {file}")?,
            OriginKind::Import => write!(f, "Imported from {file}, as the PLC measured it")?,
        }
        write!(f, ": PLC {plc}; robot {robot}")?;
        bus.as_ref().map_or(Ok(()), |bus| write!(f, "; {bus}"))
    }
}

impl fmt::Display for MeasuredPeer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { address, mac, name, identity } = self;
        let mac = mac.as_ref().filter(|mac| Some(*mac) != address.as_ref());
        let known = [address.as_ref(), name.as_ref(), identity.as_ref(), mac];
        let known: Vec<_> = known.into_iter().flatten().map(String::as_str).collect();
        f.write_str(if known.is_empty() { "not named" } else { "" })?;
        f.write_str(&known.join(", "))
    }
}
