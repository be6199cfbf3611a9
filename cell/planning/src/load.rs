//! Finding applications: a built-in one by its name, one's own by its path.
//!
//! [`setup::find`] reads the file, as for setups.

use std::path::{Path, PathBuf};

use setup::Setup;

use crate::application::Application;
use crate::error::Error;
use crate::plan::Plan;
use crate::planner::plan;
use crate::reach::Reached;
use crate::swing::keep_clear;

/// Applications compiled in: name and text.
pub const APPLICATIONS: &[(&str, &str)] = &[
    ("pick-and-place", include_str!("../../applications/pick-and-place.toml")),
    ("pick-and-place-gripper", include_str!("../../applications/pick-and-place-gripper.toml")),
    ("gluing", include_str!("../../applications/gluing.toml")),
    ("palletising", include_str!("../../applications/palletising.toml")),
    ("engraving", include_str!("../../applications/engraving.toml")),
    ("insertion-with-force", include_str!("../../applications/insertion-with-force.toml")),
];

/// Applications for several arms compiled in: name and text.
pub const ARMS_APPLICATIONS: &[(&str, &str)] = &[
    ("hand-over", include_str!("../../applications/hand-over.toml")),
    ("carry-plate", include_str!("../../applications/carry-plate.toml")),
    ("take-turns", include_str!("../../applications/take-turns.toml")),
];

/// An application and the text that it was read from.
#[derive(Clone, PartialEq, Debug)]
pub struct Found {
    /// Its name in messages: the file's path, or the built-in's name.
    pub origin: String,
    /// The file; `None` for a built-in one.
    pub path: Option<PathBuf>,
    /// The text as it was read, to be kept beside results.
    pub text: String,
    /// The application in the text.
    pub application: Application,
}

impl Found {
    /// Plans it like [`plan()`]; a refusal names the file of the application.
    ///
    /// # Errors
    /// [`Error::Unplannable`]
    pub fn plan(&self, setup: &Setup) -> Result<Plan, Error> {
        plan(&self.application, setup).map_err(|refused| Error::Unplannable {
            origin: self.origin.clone(),
            setup: setup.name.clone(),
            refused: Box::new(refused),
        })
    }

    /// Follows its plan with the arm of a setup like [`Plan::reach`], and refuses a PTP whose joints take the tool nearer to an
    /// obstacle than the clearance; a refusal names the file of the application.
    ///
    /// # Errors
    /// [`Error::OutOfReach`], [`Error::SwingsTooNear`]
    pub fn reach(&self, plan: &Plan, setup: &Setup) -> Result<Reached, Error> {
        let [origin, name] = [&self.origin, &setup.name].map(String::clone);
        let reached = match plan.reach(&self.application, setup) {
            Ok(reached) => reached,
            Err(found) => return Err(Error::OutOfReach { origin, setup: name, found: Box::new(found) }),
        };
        match keep_clear(&self.application, plan, &reached, setup) {
            Ok(()) => Ok(reached),
            Err(found) => Err(Error::SwingsTooNear { origin, setup: name, found: Box::new(found) }),
        }
    }
}

/// Finds the application that `name` names: one of [`APPLICATIONS`], or a file, its path seen from `directory`.
///
/// # Errors
/// [`Error::Setup`] where there is none or where it cannot be read, [`Error::Value`] where a value makes no sense.
pub fn application(name: &str, directory: Option<&Path>) -> Result<Found, Error> {
    // One for several arms is found too, so that its error says what it is.
    let all =
        if setup::built_in(ARMS_APPLICATIONS, name).is_some() { ARMS_APPLICATIONS } else { APPLICATIONS };
    let setup::Text { origin, path, text } = setup::find("application", all, name, directory)?;
    let application = Application::parse(&origin, &text)?;
    Ok(Found { origin, path, text, application })
}

/// Finds the setup that `name` names and the application that it runs, which a setup in a file names by a path from
/// its directory.
///
/// # Errors
/// Those of [`setup::setup()`] and of [`application()`]. Whether the two fit each other is checked by planning.
pub fn setup_with_application(name: &str) -> Result<(Setup, Found), Error> {
    let (setup, directory) = setup::setup_with_directory(name)?;
    let found = application(&setup.application, directory.as_deref())?;
    Ok((setup, found))
}

/// Finds a setup and its application like [`setup_with_application`]; `instead` replaces the setup's application: a
/// built-in one, or the path of a file relative to the current directory.
///
/// # Errors
/// Those of [`setup_with_application`].
pub fn setup_and_application(setup: &str, instead: Option<&str>) -> Result<(Setup, Found), Error> {
    let Some(name) = instead else { return setup_with_application(setup) };
    let mut setup = setup::setup(setup)?;
    name.clone_into(&mut setup.application);
    Ok((setup, application(name, None)?))
}
