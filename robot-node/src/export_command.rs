//! `robot-node export`: the second layer and the planned program as code for another robot.

use std::path::PathBuf;

use node::Outcome;
use node::errln;
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
    error.downcast_ref::<ExportError>().is_some_and(ExportError::is_usage)
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
        let (setup, found) = planning::setup_and_application(&self.setup, self.application.as_deref())?;
        let plan = found.plan(&setup)?;
        found.reach(&plan, &setup)?;
        let application = RobotApplication::of_plan(&setup, &plan);
        robot_export::export(&application, maker, &self.out)?;
        let count: usize = application.programs.iter().map(|program| program.motions.len()).sum();
        errln!("{count} motions in {}; not tried on a controller: begin at 10 % speed", self.out.display());
        Ok(Outcome::Done)
    }
}
