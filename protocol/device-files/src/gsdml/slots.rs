//! Slots and subslots, and what fits into them.

use serde::Serialize;

use super::names::{GsdmlNames, PlacementKind};
use crate::fault::{FileFault, excerpt};
use crate::xml::{Element, number};

/// Numbers as ranges with first and last, such as `0..63 65`.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(transparent)]
pub struct SlotRanges(pub Vec<(u16, u16)>);

impl SlotRanges {
    /// Parses ranges such as `0..63 65` (GSDML, ValueList).
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut ranges = Vec::new();
        for part in text.split([' ', ';', ',', '\t', '\n', '\r']).filter(|part| !part.is_empty()) {
            let (first, last) = part.split_once("..").unwrap_or((part, part));
            let range: (u16, u16) = (number(first)?, number(last)?);
            ranges.push((range.0 <= range.1).then_some(range)?);
        }
        Some(Self(ranges))
    }

    /// Returns whether a number is in one of the ranges.
    #[must_use]
    pub fn contains(&self, number: u16) -> bool {
        self.0.iter().any(|(first, last)| (*first..=*last).contains(&number))
    }

    /// Returns the numbers of all ranges.
    pub fn iter(&self) -> impl Iterator<Item = u16> {
        self.0.iter().flat_map(|(first, last)| *first..=*last)
    }

    /// Reads an attribute; nothing without it.
    pub(super) fn of(element: Element<'_>, name: &str) -> Result<Self, FileFault> {
        let text = element.attribute(name).unwrap_or_default();
        element.charge(2 * text.len())?;
        let fault =
            || element.finding(format!("{name} `{}`: must be numbers such as `0..3 8`", excerpt(text)));
        Self::parse(text).ok_or_else(fault)
    }
}

impl std::fmt::Display for SlotRanges {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (at, (first, last)) in self.0.iter().enumerate() {
            let blank = if at > 0 { " " } else { "" };
            match first == last {
                true => write!(formatter, "{blank}{first}")?,
                false => write!(formatter, "{blank}{first}..{last}")?,
            }
        }
        Ok(())
    }
}

/// Module or submodule, and the slots or subslots that it fits into.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Placement {
    /// ID of the module or submodule.
    pub id: String,
    /// Where the user may plug it.
    pub allowed: SlotRanges,
    /// Where it is plugged in a new configuration, and may be pulled.
    pub used: SlotRanges,
    /// Where it always is.
    pub fixed: SlotRanges,
}

impl Placement {
    /// Returns whether it may be at a number.
    #[must_use]
    pub fn fits(&self, number: u16) -> bool {
        [&self.allowed, &self.used, &self.fixed].iter().any(|ranges| ranges.contains(number))
    }

    /// Reads the references of an access point to modules, or of either to submodules.
    pub(super) fn list(
        context: &mut GsdmlNames<'_>,
        within: Option<Element<'_>>,
        kind: PlacementKind,
    ) -> Result<Vec<Self>, FileFault> {
        let Some(within) = within else { return Ok(Vec::new()) };
        let (element, target, places) = match kind {
            PlacementKind::Module => ("ModuleItemRef", "ModuleItemTarget", "Slots"),
            PlacementKind::Submodule => ("SubmoduleItemRef", "SubmoduleItemTarget", "Subslots"),
        };
        let mut list = Vec::new();
        for reference in within.children_named(element) {
            reference.charge(size_of::<Self>())?;
            let id = reference.required(target)?;
            if !context.has(kind, id) {
                context.warn(
                    reference.finding(format!("{target} `{}` is not in the file; ignored", excerpt(id))),
                );
                continue;
            }
            list.push(Self {
                id: reference.keep(id)?,
                allowed: SlotRanges::of(reference, &format!("AllowedIn{places}"))?,
                used: SlotRanges::of(reference, &format!("UsedIn{places}"))?,
                fixed: SlotRanges::of(reference, &format!("FixedIn{places}"))?,
            });
        }
        Ok(list)
    }
}
