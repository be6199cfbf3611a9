//! Results of a PLC and a robot that no bench ran: from a capture, or imported from the PLC.

use std::fmt;

use plc_node::ExecutionType;
use serde::{Deserialize, Serialize};
use setup::Setup;

use crate::results::{FailedRepetition, PerType, Results, Status, TypeResult};

/// Source of the samples of a run that no bench ran.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Origin {
    /// How they were measured.
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

/// How the samples of a run were measured that no bench ran.
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
#[cfg_attr(test, derive(schemars::JsonSchema))]
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

impl fmt::Display for Origin {
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

impl Results {
    /// Creates the results of samples that were measured elsewhere. They have no simulated figures.
    #[must_use]
    pub fn measured(setup: &Setup, application: &str, origin: Origin, types: &PerType<MeasuredType>) -> Self {
        let mut results = Self::empty([&setup.name, application, origin.kind.mode()]);
        results.title.clone_from(&setup.title);
        results.origin = Some(origin);
        results.status = Status::Complete;
        for execution_type in ExecutionType::ALL {
            let Some(measured) = types.get(execution_type) else { continue };
            let count = u32::try_from(measured.repetitions.len()).unwrap_or(u32::MAX);
            results.reps = results.reps.max(count);
            *results.results.entry(execution_type) = Some(TypeResult::measured(measured));
        }
        results.derive_figures();
        results
    }

    /// Returns how the run was measured, for a line that describes it.
    #[must_use]
    pub fn mode_in_words(&self) -> String {
        match self.origin.as_ref().map(|origin| origin.kind) {
            None => format!("{} mode", self.mode),
            Some(OriginKind::Capture) => "measured from a capture".to_owned(),
            Some(OriginKind::Import) => "imported".to_owned(),
        }
    }
}

impl TypeResult {
    fn measured(measured: &MeasuredType) -> Self {
        let mut result = Self::default();
        for (number, repetition) in (1..).zip(&measured.repetitions) {
            match repetition {
                Ok(time) => {
                    result.samples_ms.push(time.execution_ms);
                    result.robot_samples_ms.extend(time.robot_execution_ms);
                    result.blends_suppressed.extend(time.blends_suppressed);
                }
                Err(error) => {
                    result.failed.push(FailedRepetition { repetition: number, error: error.clone() });
                }
            }
        }
        result
    }
}
