//! The content of an application for several arms.

use crate::application::Application;

/// What several arms are to do, and where they wait for each other.
///
/// Only [`ArmsApplication::parse`] makes one, so that every mark is one at which arms meet, in an order that no arm waits for
/// in vain.
#[derive(Clone, PartialEq, Debug)]
pub struct ArmsApplication {
    /// Short name.
    pub name: String,
    /// What happens in it.
    pub title: String,
    /// The marks, as the file lists them.
    pub marks: Vec<Mark>,
    /// The arms, as the file lists them.
    pub arms: Vec<ArmApplication>,
}

/// A place in the work of several arms at which they wait for each other.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Mark {
    /// Its number.
    pub number: u32,
    /// What has happened there.
    pub name: String,
    /// Whether its arms move together from here to the next mark.
    pub together: bool,
}

/// What one of several arms is to do.
#[derive(Clone, PartialEq, Debug)]
pub struct ArmApplication {
    /// The arm's name.
    pub name: String,
    /// What it is to do, with its waits.
    pub application: Application,
}

impl ArmApplication {
    /// Returns the marks at which the arm waits, in its order.
    pub fn marks(&self) -> impl Iterator<Item = u32> {
        self.application.waits.iter().map(|wait| wait.mark)
    }
}
