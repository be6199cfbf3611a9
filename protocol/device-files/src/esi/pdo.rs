//! Process data objects.

use serde::{Deserialize, Serialize};

use super::names::{Warnings, name_of};
use crate::fault::{FileFault, excerpt};
use crate::xml::Element;

/// Process data object.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EsiPdo {
    /// Index, such as 0x1A00.
    pub index: u16,
    /// True if the index of a module's PDO moves with its slot.
    pub depends_on_slot: bool,
    /// Name.
    pub name: String,
    /// Sync manager to which it is assigned in a new configuration; none if the user assigns it.
    pub sync_manager: Option<u8>,
    /// True if its entries cannot be changed.
    pub is_fixed: bool,
    /// True if it must be assigned.
    pub is_mandatory: bool,
    /// PDOs that cannot be assigned beside it.
    pub excludes: Vec<u16>,
    /// Sync managers to which it cannot be assigned.
    pub excluded_sync_managers: Vec<u8>,
    /// Bits of all entries.
    pub bits: u32,
    /// Entries in their order.
    pub entries: Vec<EsiPdoEntry>,
}

/// Entry of a process data object.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EsiPdoEntry {
    /// Index of the object; 0 for bits without meaning.
    pub index: u16,
    /// True if the index of a module's object moves with its slot.
    pub depends_on_slot: bool,
    /// Subindex.
    pub subindex: u8,
    /// Bits.
    pub bits: u16,
    /// Name.
    pub name: String,
    /// Data type.
    pub data_type: String,
}

impl EsiPdo {
    /// Reads the PDOs of one direction.
    pub(super) fn list(
        within: Element<'_>,
        name: &str,
        warnings: &mut Warnings,
    ) -> Result<Vec<Self>, FileFault> {
        let mut list = Vec::new();
        for pdo in within.children_named(name) {
            pdo.charge(size_of::<Self>())?;
            if let (Some(reference), None) = (pdo.attribute("Ref"), pdo.child("Index")) {
                let fault = format!("`{}` is a PDO of another file; ignored", excerpt(reference));
                warnings.add(pdo.finding(fault));
                continue;
            }
            list.push(Self::read(pdo)?);
        }
        Ok(list)
    }

    fn read(pdo: Element<'_>) -> Result<Self, FileFault> {
        let entries = pdo.list("Entry", |entry| {
            let bits = entry.child_number("BitLen")?;
            let data_type = entry.child_text("DataType").unwrap_or_default();
            Ok(EsiPdoEntry {
                index: entry.child_number("Index")?.unwrap_or(0),
                depends_on_slot: depends_on_slot(entry)?,
                subindex: entry.child_number("SubIndex")?.unwrap_or(0),
                bits: bits.ok_or_else(|| entry.finding("element BitLen is missing; add it"))?,
                name: name_of(entry)?,
                data_type: entry.keep(data_type)?,
            })
        })?;
        let index = pdo.child_number("Index")?;
        Ok(Self {
            index: index.ok_or_else(|| pdo.finding("element Index is missing; add it"))?,
            depends_on_slot: depends_on_slot(pdo)?,
            name: name_of(pdo)?,
            sync_manager: pdo.number("Sm")?,
            is_fixed: pdo.is("Fixed")?,
            is_mandatory: pdo.is("Mandatory")?,
            excludes: numbers(pdo, "Exclude")?,
            excluded_sync_managers: numbers(pdo, "ExcludedSm")?,
            bits: entries.iter().map(|entry| u32::from(entry.bits)).fold(0, u32::saturating_add),
            entries,
        })
    }
}

/// Returns whether the index of a PDO, entry, object or command moves with the slot of its module (ETG.2000, DependOnSlot).
pub(super) fn depends_on_slot(within: Element<'_>) -> Result<bool, FileFault> {
    within.child("Index").map_or(Ok(false), |index| index.is("DependOnSlot"))
}

fn numbers<N: TryFrom<i64>>(pdo: Element<'_>, name: &str) -> Result<Vec<N>, FileFault> {
    let list = pdo.list(name, Element::text_number)?;
    Ok(list.into_iter().flatten().collect())
}
