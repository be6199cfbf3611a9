//! The option `--setup`, which most verbs have.

use clap::Args;
use planning::Found;
use setup::Setup;

use crate::output::exit::Failure;

/// Which setup a verb works on.
#[derive(Args, Debug)]
pub struct SetupOption {
    /// A built-in setup's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
}

impl SetupOption {
    /// As it was given.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.setup
    }

    /// Reads the setup and the application that it names.
    ///
    /// # Errors
    ///
    /// Either cannot be read, or says something wrong.
    pub fn load(&self) -> Result<(Setup, Found), Failure> {
        Ok(planning::setup_with_application(&self.setup)?)
    }
}
