//! `plc-node export`: the PLC's code and an application's motions for another PLC.

use std::path::PathBuf;

use node::Outcome;
use node::errln;

use crate::PlcConfig;

/// A maker's language.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Dialect {
    /// One neutral file of Structured Text (IEC 61131-3).
    St,
}

/// Whether images carry the check.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Check {
    /// The code sends the check, and verifies that of the robot.
    On,
    /// The code sends 0, and ignores the check of the robot.
    Off,
}

/// What to export.
#[derive(clap::Args, Debug)]
pub(crate) struct ExportCommand {
    /// The language of the PLC.
    #[arg(long = "for", value_name = "DIALECT")]
    dialect: Dialect,
    /// The setup: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
    /// The application, instead of that of the setup.
    #[arg(long, value_name = "NAME|FILE")]
    application: Option<String>,
    /// The directory for the files, new or empty.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Whether images carry the check of the process image.
    #[arg(long, value_name = "ON|OFF", default_value = "on")]
    check: Check,
}

impl ExportCommand {
    /// Plans the application and writes the files.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let Dialect::St = self.dialect;
        let (setup, application) = planning::setup_and_application(&self.setup, self.application.as_deref())?;
        let plan = application.plan(&setup)?;
        application.reach(&plan, &setup)?;
        let exported = PlcConfig::of_plan(&setup, &plan).exported(self.check == Check::On);
        plc_export::export(&exported, &self.out)?;
        errln!(
            "{} motions in {}; compare your PLC with {}",
            exported.motions.len(),
            self.out.join(plc_export::FILE).display(),
            plc_export::VECTORS
        );
        Ok(Outcome::Done)
    }
}
