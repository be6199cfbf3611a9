//! `robot-node export`: the second layer and the planned program as code for another robot.

use std::path::PathBuf;

use node::cell_run_error::CellRunError;
use node::planned_station::plan_station;
use node::{Outcome, errln};
use robot_export::{ExportError, Maker, RobotApplication};

/// A maker's language.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Language {
    /// KRL, for KR C4 and KR C5.
    Kuka,
    /// RAPID, for IRC5 and OmniCore.
    Abb,
}

/// Returns true for an error that the user corrects in application or options.
pub(crate) fn is_usage(error: &anyhow::Error) -> bool {
    error.is::<CellRunError>() || error.downcast_ref::<ExportError>().is_some_and(ExportError::is_usage)
}

/// The export.
#[derive(clap::Args, Debug)]
pub(crate) struct ExportCommand {
    /// The robot's maker.
    #[arg(long = "for", value_name = "MAKER")]
    language: Language,
    /// The setup: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
    /// Which robot of a setup with several stations.
    #[arg(long, value_name = "NAME")]
    station: Option<String>,
    /// The application, instead of that of the setup.
    #[arg(long, value_name = "NAME|FILE")]
    application: Option<String>,
    /// The directory for the files, new or empty.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl ExportCommand {
    /// Plans the application and writes the files.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let maker = match self.language {
            Language::Kuka => Maker::Kuka,
            Language::Abb => Maker::Abb,
        };
        let (setup, plan) = plan_station(&self.setup, self.station.as_deref(), self.application.as_deref())?;
        let application = RobotApplication::of_plan(&setup, &plan);
        robot_export::export(&application, maker, &self.out)?;
        let count: usize = application.programs.iter().map(|program| program.motions.len()).sum();
        errln!("{count} motions in {}; not tried on a controller: begin at 10 % speed", self.out.display());
        if let Some(last) = application.programs.last().filter(|_| application.programs.len() > 1) {
            errln!(
                "programs 1 to {}: between them the arm waits for others, at a mark or before a shared zone; the PLC starts each",
                last.number
            );
        }
        Ok(Outcome::Done)
    }
}
