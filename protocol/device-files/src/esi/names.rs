//! Names of elements, and warnings of a file.

use crate::fault::FileFault;
use crate::xml::Element;

/// Most warnings that are kept.
const MOST_WARNINGS: usize = 100;

/// English, in which names are shown if there are several (ETG.2000, LcId).
const ENGLISH: &str = "1033";

/// Warnings of a file.
#[derive(Default)]
pub(super) struct Warnings(Vec<FileFault>);

impl Warnings {
    pub(super) fn into_list(self) -> Vec<FileFault> {
        self.0
    }

    pub(super) fn add(&mut self, finding: FileFault) {
        if self.0.len() < MOST_WARNINGS {
            self.0.push(finding);
        }
    }
}

/// Returns a name; the English one, if there are several languages.
pub(super) fn name_of(element: Element<'_>) -> Result<String, FileFault> {
    let names = || element.children_named("Name");
    let english = names().find(|name| name.attribute("LcId") == Some(ENGLISH));
    let name = english.or_else(|| names().next()).map_or("", Element::text);
    element.keep(name)
}
