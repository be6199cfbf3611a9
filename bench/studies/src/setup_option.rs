//! The option `--setup`, which most verbs have, and `--drives`, which goes with it.

use std::path::Path;

use clap::{Args, ValueEnum};
use planning::Found;
use setup::{Cell, Setup};

use records::exit::{Exit, Failure};

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
        setup::built_in_setup(&self.setup).is_none().then(|| Path::new(&self.setup))
    }

    /// Returns the cell of a setup with several stations; `None` for a setup of one robot, and for one that cannot be read: what
    /// reads it says why.
    #[must_use]
    pub fn of_several(&self) -> Option<Cell> {
        setup::cell(&self.setup).ok().map(|(cell, _)| cell).filter(|cell| !cell.is_one())
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

/// What moves the robot's joints.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Drives {
    /// Emulated CiA 402 drives on an EtherCAT segment of the robot controller.
    Ethercat,
}

impl From<Drives> for setup::Drives {
    fn from(Drives::Ethercat: Drives) -> Self {
        Self::Ethercat
    }
}

/// What moves the joints of the setup's robot.
#[derive(Args, Debug)]
pub struct DrivesOption {
    /// What moves the robot's joints, instead of what the setup says: emulated CiA 402 drives on an EtherCAT segment of
    /// the robot controller.
    #[arg(long, value_enum)]
    drives: Option<Drives>,
}

impl DrivesOption {
    /// Returns the setup with these drives.
    ///
    /// # Errors
    ///
    /// Drives cannot move this arm.
    pub fn applied_to(&self, setup: Setup) -> Result<Setup, Failure> {
        let Some(drives) = self.drives else { return Ok(setup) };
        let setup = setup.with_drives(drives.into());
        setup::check(&setup).map_err(|error| Failure::new(Exit::Usage, error))?;
        Ok(setup)
    }

    /// Returns the cell with these drives at every station.
    ///
    /// # Errors
    ///
    /// Drives cannot move one of the arms.
    pub fn applied_to_cell(&self, cell: Cell) -> Result<Cell, Failure> {
        let Some(drives) = self.drives else { return Ok(cell) };
        let cell = cell.with_each_station(|setup| setup.with_drives(drives.into()));
        for setup in cell.setups() {
            setup::check(&setup).map_err(|error| Failure::new(Exit::Usage, error))?;
        }
        Ok(cell)
    }

    /// Returns the option as a command has it, after a blank; empty without drives.
    #[must_use]
    pub fn in_command(&self) -> &'static str {
        if self.drives.is_some() { " --drives ethercat" } else { "" }
    }
}
