//! Object dictionary: objects, entries, types and defaults.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use super::mailbox::hex_bytes;
use super::names::{Warnings, name_of};
use super::pdo::depends_on_slot;
use crate::fault::{FileFault, excerpt};
use crate::xml::{Element, number};

/// Object dictionary of a device.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ObjectDictionary {
    /// Objects.
    pub objects: Vec<DictionaryObject>,
}

/// Object of a dictionary.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DictionaryObject {
    /// Index.
    pub index: u16,
    /// True if the index of a module's object moves with its slot.
    pub depends_on_slot: bool,
    /// Name.
    pub name: String,
    /// Data type; that of its own, if it has entries.
    pub data_type: String,
    /// Bits.
    pub bits: u32,
    /// Access, such as `ro`; empty if each entry has its own.
    pub access: String,
    /// Default, in the byte order of the wire; empty if the file gives none.
    #[serde(with = "crate::hex")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub default: Vec<u8>,
    /// Entries.
    pub entries: Vec<DictionaryEntry>,
}

/// Entry of an object.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DictionaryEntry {
    /// Subindex.
    pub subindex: u8,
    /// Name.
    pub name: String,
    /// Data type.
    pub data_type: String,
    /// Bits.
    pub bits: u32,
    /// Access, such as `rw`.
    pub access: String,
    /// Default, in the byte order of the wire; empty if the file gives none.
    #[serde(with = "crate::hex")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub default: Vec<u8>,
}

/// Type of a dictionary. What is looked up for each object is looked up once here, so that many objects of a large type
/// take no longer than the file is long.
#[derive(Clone, Copy)]
struct DataType<'d> {
    element: Element<'d>,
    bits: Option<u32>,
    base: &'d str,
    array: Option<Element<'d>>,
}

/// Types of a dictionary, by name.
type DataTypes<'d> = HashMap<&'d str, DataType<'d>>;

/// Arrays within types; a type that goes deeper names itself.
const MOST_DEPTH: usize = 8;

impl ObjectDictionary {
    /// Reads a dictionary.
    pub(super) fn read(dictionary: Element<'_>, warnings: &mut Warnings) -> Result<Self, FileFault> {
        let mut types = DataTypes::new();
        for data_type in
            dictionary.at(&["DataTypes"]).into_iter().flat_map(|it| it.children_named("DataType"))
        {
            let Some(name) = data_type.child_text("Name") else { continue };
            types.entry(name).or_insert(DataType {
                element: data_type,
                bits: data_type.child_number("BitSize")?,
                base: data_type.child_text("BaseType").unwrap_or_default(),
                array: data_type.child("ArrayInfo"),
            });
        }
        let Some(objects) = dictionary.child("Objects") else { return Ok(Self::default()) };
        let objects = objects.list("Object", |object| {
            let name = object.child_text("Type").unwrap_or_default();
            let data_type = types.get(name).copied();
            let mut entries = Vec::new();
            if let Some(data_type) = data_type {
                entries = sub_items(data_type, &types, warnings)?;
                set_defaults(object, &mut entries, warnings)?;
            }
            let own = object.child_number("BitSize")?;
            let index = object.child_number("Index")?;
            Ok(DictionaryObject {
                index: index.ok_or_else(|| object.finding("element Index is missing; add it"))?,
                depends_on_slot: depends_on_slot(object)?,
                name: name_of(object)?,
                data_type: object.keep(name)?,
                bits: own.or(data_type.and_then(|it| it.bits)).unwrap_or(0),
                access: access(object)?,
                default: default_data(object, own.unwrap_or(0), warnings)?,
                entries,
            })
        })?;
        Ok(Self { objects })
    }
}

fn access(element: Element<'_>) -> Result<String, FileFault> {
    element.keep(element.at(&["Flags", "Access"]).map_or("", Element::text))
}

/// Returns the default of an object or an entry.
fn default_data(element: Element<'_>, bits: u32, warnings: &mut Warnings) -> Result<Vec<u8>, FileFault> {
    let Some(info) = element.child("Info") else { return Ok(Vec::new()) };
    for name in ["DefaultData", "DefaultString", "DefaultValue"] {
        let Some(given) = info.child(name).filter(|given| !given.text().is_empty()) else { continue };
        let text = given.text();
        given.charge(text.len())?;
        return match name {
            // Files of several makers have half a byte here. The device has its own default anyway.
            "DefaultData" => hex_bytes(given).or_else(|fault| {
                warnings
                    .add(FileFault { fault: format!("{}; the default is left out", fault.fault), ..fault });
                Ok(Vec::new())
            }),
            "DefaultValue" => match number::<i64>(text) {
                Some(value) => {
                    let width = (bits.div_ceil(8) as usize).min(8);
                    Ok(value.to_le_bytes().into_iter().take(width).collect())
                }
                // A float or a date, which the wire does not carry in this form.
                None => Ok(Vec::new()),
            },
            _ => Ok(text.as_bytes().to_vec()),
        };
    }
    Ok(Vec::new())
}

/// Returns the entries of a type: its sub-items, of which one may be an array of equal entries.
fn sub_items(
    data_type: DataType<'_>,
    types: &DataTypes<'_>,
    warnings: &mut Warnings,
) -> Result<Vec<DictionaryEntry>, FileFault> {
    let mut entries = Vec::new();
    for item in data_type.element.children() {
        // Each object of the type costs as much as the type is long.
        item.charge(size_of::<DictionaryEntry>())?;
        if item.name() != "SubItem" {
            continue;
        }
        let name = item.child_text("Type").unwrap_or_default();
        let subindex: Option<u8> = item.child_number("SubIdx")?;
        let inner = types.get(name).copied().filter(|inner| inner.array.is_some());
        if let (None, Some(inner)) = (subindex, inner) {
            entries.extend(array(item, inner, types)?);
            continue;
        }
        let Some(subindex) = subindex else {
            warnings.add(item.finding("element SubIdx is missing; the entry is ignored"));
            continue;
        };
        entries.push(DictionaryEntry {
            subindex,
            name: name_of(item)?,
            data_type: item.keep(name)?,
            bits: item.child_number("BitSize")?.unwrap_or(0),
            access: access(item)?,
            default: default_data(item, item.child_number("BitSize")?.unwrap_or(0), warnings)?,
        });
    }
    Ok(entries)
}

/// Returns the entries of an array type, each as wide as its base type.
fn array(
    item: Element<'_>,
    array: DataType<'_>,
    types: &DataTypes<'_>,
) -> Result<Vec<DictionaryEntry>, FileFault> {
    let mut base = array.base;
    let mut depth = 0;
    while let Some(inner) = types.get(base).filter(|inner| inner.array.is_some()) {
        depth += 1;
        if depth > MOST_DEPTH {
            let name = excerpt(array.element.child_text("Name").unwrap_or_default());
            return Err(array
                .element
                .finding(format!("type `{name}` names itself through others; remove the ring")));
        }
        base = inner.base;
    }
    let of_array = |name: &str| array.array.and_then(|info| info.child(name));
    let number_of = |name: &str| of_array(name).map_or(Ok(None), Element::text_number::<u32>);
    let (first, count) = (number_of("LBound")?.unwrap_or(1), number_of("Elements")?.unwrap_or(0));
    let bits = array.bits.unwrap_or(0);
    let mut entries = Vec::new();
    for subindex in first..first.saturating_add(count) {
        // An object has 255 entries at most (ETG.1000.6, 5.6).
        let Ok(subindex) = u8::try_from(subindex) else {
            return Err(array
                .element
                .finding(format!("{count} elements from {first}: an object has 255 entries at most")));
        };
        item.charge(size_of::<DictionaryEntry>() + base.len())?;
        entries.push(DictionaryEntry {
            subindex,
            name: format!("SubIndex {subindex:03}"),
            data_type: base.to_owned(),
            bits: bits / count.max(1),
            access: access(item)?,
            default: Vec::new(),
        });
    }
    Ok(entries)
}

/// Takes names and defaults over that the object gives for its entries, in their order.
fn set_defaults(
    object: Element<'_>,
    entries: &mut [DictionaryEntry],
    warnings: &mut Warnings,
) -> Result<(), FileFault> {
    let Some(info) = object.child("Info") else { return Ok(()) };
    for (entry, item) in entries.iter_mut().zip(info.children_named("SubItem")) {
        if let Some(name) = item.child_text("Name") {
            entry.name = item.keep(name)?;
        }
        let default = default_data(item, entry.bits, warnings)?;
        if !default.is_empty() {
            entry.default = default;
        }
    }
    Ok(())
}
