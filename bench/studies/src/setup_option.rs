//! The option `--setup`, which most verbs have.

use std::path::Path;

use clap::Args;
use planning::Found;
use setup::Setup;

use records::exit::Failure;

/// Which setup a verb works on.
#[derive(Args, Debug)]
pub struct SetupOption {
    /// A built-in setup's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
}

impl SetupOption {
    /// Returns the name or path, as given.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.setup
    }

    /// Returns the file of the setup; `None` for a built-in one.
    #[must_use]
    pub fn file(&self) -> Option<&Path> {
        setup::built_in(setup::SETUPS, &self.setup).is_none().then(|| Path::new(&self.setup))
    }

    /// Reads the setup and its application.
    ///
    /// # Errors
    ///
    /// Either cannot be read or is invalid.
    pub fn load(&self) -> Result<(Setup, Found), Failure> {
        self.load_with(None)
    }

    /// Reads the setup, and this application in place of the setup's if there is one: a built-in one's name, or a path.
    ///
    /// # Errors
    ///
    /// Either cannot be read or is invalid.
    pub fn load_with(&self, application: Option<&str>) -> Result<(Setup, Found), Failure> {
        Ok(planning::setup_and_application(&self.setup, application)?)
    }
}
