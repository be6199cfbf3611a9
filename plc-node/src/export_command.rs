//! `plc-node export`: the PLC's code and an application's motions for another PLC.

use std::path::PathBuf;

use anyhow::Context as _;
use node::cell_run_error::CellRunError;
use node::device_options::{self, read_device_file};
use node::planned_station::plan_station;
use node::{Outcome, errln};
use planning::Plan;
use plc_export::{ExportError, ExportedApplication, Maker, br};
use setup::{BusKind, Refill, Setup, SlotForm, UnfitRobotFile, ways_to_plug};

use crate::PlcConfig;

/// A maker's language.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Dialect {
    /// One neutral file of Structured Text (IEC 61131-3).
    St,
    /// SCL: external sources for TIA Portal, S7-1500.
    Siemens,
    /// PLCopen XML for CODESYS.
    Codesys,
    /// A package with a library and a program for B&R Automation Studio.
    Br,
}

impl From<Dialect> for Maker {
    fn from(dialect: Dialect) -> Self {
        match dialect {
            Dialect::St => Self::St,
            Dialect::Siemens => Self::Siemens,
            Dialect::Codesys => Self::Codesys,
            Dialect::Br => Self::Br,
        }
    }
}

/// Whether images carry the check.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Check {
    /// The code sends the check, and verifies that of the robot.
    On,
    /// The code sends 0, and ignores the check of the robot.
    Off,
}

/// Returns true for an error that another robot's file corrects.
pub(crate) fn is_usage(error: &anyhow::Error) -> bool {
    error.is::<UnfitRobotFile>()
        || error.is::<CellRunError>()
        || error.is::<NeedsOthers>()
        || error.is::<RefillsByAccepted>()
        || error.is::<SendsCompactPoints>()
        || error.downcast_ref::<ExportError>().is_some_and(ExportError::is_usage)
        || device_options::is_usage(error)
}

/// Why the motions of a station are not exported: its arm waits for others, which exported code does not know.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "{setup} {needs}: marks between arms, start together and shared zones are not exported; give the station an application of its own"
)]
struct NeedsOthers {
    setup: String,
    needs: String,
}

fn check_works_alone(setup: &Setup, plan: &Plan) -> Result<(), NeedsOthers> {
    let needs = match (plan.waits.first(), plan.visits.first()) {
        (Some(wait), _) => format!("waits for other arms at mark {} after {} motions", wait.mark, wait.after),
        (None, Some(visit)) => format!("waits for a shared zone after {} motions", visit.after),
        (None, None) => return Ok(()),
    };
    Err(NeedsOthers { setup: setup.name.clone(), needs })
}

/// A setup whose PLC refills slots by another count than the exported code.
#[derive(Debug, thiserror::Error)]
#[error(
    "plc.refill = \"accepted\": exported code refills slots by `executed` only; set it to \"executed\", or leave it out"
)]
struct RefillsByAccepted;

/// A setup whose PLC sends compact points.
#[derive(Debug, thiserror::Error)]
#[error("plc.form = \"compact\": exported code sends full motions; set it to \"full\", or leave it out")]
struct SendsCompactPoints;

/// What to export.
#[derive(clap::Args, Debug)]
pub(crate) struct ExportCommand {
    /// The language of the PLC.
    #[arg(long = "for", value_name = "DIALECT")]
    dialect: Dialect,
    /// The setup: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
    /// Which robot of a setup with several stations: its motions alone.
    #[arg(long, value_name = "NAME")]
    station: Option<String>,
    /// The application, instead of that of the setup.
    #[arg(long, value_name = "NAME|FILE")]
    application: Option<String>,
    /// The robot's device file, a GSDML, an EDS or an ESI: refuses one that does not carry the image, and prints the modules to plug.
    #[arg(long, value_name = "FILE")]
    device: Option<PathBuf>,
    /// The directory for the files, new or empty.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Whether images carry the check of the process image.
    #[arg(long, value_name = "ON|OFF", default_value = "on")]
    check: Check,
    /// Memory for data of the PLC in KiB; an application that does not fit is refused. Without it that of a CPU 1517-3 for
    /// siemens, and 16384 for others.
    #[arg(long, value_name = "KIB", value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    memory: Option<u32>,
}

impl ExportCommand {
    /// Plans the application and writes the files.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let maker = Maker::from(self.dialect);
        let (setup, plan) = plan_station(&self.setup, self.station.as_deref(), self.application.as_deref())?;
        check_works_alone(&setup, &plan)?;
        if setup.plc.refills_by() == Refill::Accepted {
            return Err(RefillsByAccepted.into());
        }
        if setup.plc.sends_in_form() == SlotForm::Compact {
            return Err(SendsCompactPoints.into());
        }
        let ways = match &self.device {
            Some(path) => {
                let file = read_device_file(path)?;
                ways_to_plug(&file, &setup.bus.kind).with_context(|| path.display().to_string())?
            }
            None => Vec::new(),
        };
        let memory = self.memory.map_or(maker.memory_kib(), |memory| memory as usize);
        let exported = ExportedApplication {
            big_endian: matches!(setup.bus.kind, BusKind::Profinet(..)),
            most_motions: Maker::most_motions(memory),
            ..PlcConfig::of_plan(&setup, &plan).exported(self.check == Check::On)
        };
        plc_export::export(&exported, maker, &self.out)?;
        let (count, out) = (exported.motions.len(), self.out.display());
        errln!("{count} motions in {out}; compare your PLC with {}", plc_export::VECTORS);
        if self.station.is_some() {
            errln!(
                "The code commands this robot alone: it has no marks between arms, start together or shared zones"
            );
        }
        if !ways.is_empty() {
            errln!("Plug for the robot, in one of these ways:");
            ways.iter().for_each(|way| errln!("  {way}"));
        }
        if maker == Maker::Br {
            errln!("Add these lines to the configuration's Cpu.sw:\n{}", br::CPU_SW);
        }
        Ok(Outcome::Done)
    }
}
