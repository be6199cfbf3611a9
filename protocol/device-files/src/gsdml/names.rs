//! Texts and IDs of a file, which its elements name.

use std::collections::{HashMap, HashSet};

use crate::fault::{FileFault, excerpt};
use crate::xml::Element;

/// Most warnings that are kept: a wrong language file makes one for each text.
const MOST_WARNINGS: usize = 100;

/// Texts and names of the file, which its elements name.
pub(super) struct GsdmlNames<'d> {
    texts: HashMap<&'d str, &'d str>,
    modules: HashSet<&'d str>,
    submodules: HashSet<&'d str>,
    values: HashSet<&'d str>,
    warnings: Vec<FileFault>,
}

impl<'d> GsdmlNames<'d> {
    pub(super) fn new(process: Element<'d>) -> Result<Self, FileFault> {
        let ids = |list: &str, names: &[&str]| -> Result<HashSet<&'d str>, FileFault> {
            let mut ids = HashSet::new();
            for item in process.child(list).into_iter().flat_map(Element::children) {
                let Some(id) = item.attribute("ID").filter(|_| names.contains(&item.name())) else {
                    continue;
                };
                if !ids.insert(id) {
                    return Err(item.finding("the ID is there twice; rename one"));
                }
            }
            Ok(ids)
        };
        let language = process.at(&["ExternalTextList", "PrimaryLanguage"]);
        let texts = language.into_iter().flat_map(|within| within.children_named("Text"));
        Ok(Self {
            texts: texts
                .filter_map(|text| Some((text.attribute("TextId")?, text.attribute("Value")?)))
                .collect(),
            modules: ids("ModuleList", &["ModuleItem"])?,
            submodules: ids("SubmoduleList", &["SubmoduleItem", "PortSubmoduleItem"])?,
            values: ids("ValueList", &["ValueItem"])?,
            warnings: Vec::new(),
        })
    }

    pub(super) fn into_warnings(self) -> Vec<FileFault> {
        self.warnings
    }

    pub(super) fn has(&self, kind: PlacementKind, id: &str) -> bool {
        match kind {
            PlacementKind::Module => self.modules.contains(id),
            PlacementKind::Submodule => self.submodules.contains(id),
        }
    }

    pub(super) fn has_values(&self, id: &str) -> bool {
        self.values.contains(id)
    }

    pub(super) fn warn(&mut self, finding: FileFault) {
        if self.warnings.len() < MOST_WARNINGS {
            self.warnings.push(finding);
        }
    }

    /// Returns the text that an element names; the name itself, if the file has no such text.
    pub(super) fn text_of(&mut self, element: Element<'_>) -> Result<String, FileFault> {
        let Some(id) = element.attribute("TextId") else { return Ok(String::new()) };
        if let Some(text) = self.texts.get(id) {
            return element.keep(text);
        }
        self.warn(element.finding(format!("TextId `{}` is not in the file; shown as it is", excerpt(id))));
        element.keep(id)
    }
}

/// Kind of item that a reference names.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum PlacementKind {
    /// Module.
    Module,
    /// Submodule.
    Submodule,
}
