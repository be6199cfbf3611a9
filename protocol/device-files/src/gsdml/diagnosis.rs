//! Diagnosis in the device's words.

use serde::Serialize;

use super::names::GsdmlNames;
use crate::fault::FileFault;
use crate::xml::Element;

/// Error of a channel, by its error type, or by the extended one within it.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ChannelDiagnosis {
    /// ChannelErrorType.
    pub error_type: u16,
    /// ExtChannelErrorType, for an extended error.
    pub extended_type: Option<u16>,
    /// API of a profile's error; none for errors of the device.
    pub api: Option<u32>,
    /// Name.
    pub name: String,
    /// Remedy, if the file gives one.
    pub help: Option<String>,
}

/// Diagnosis in a format of the manufacturer.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct UnitDiagnosis {
    /// UserStructureIdentifier.
    pub identifier: u16,
    /// Name, if the file gives one.
    pub name: Option<String>,
    /// Fields.
    pub fields: Vec<UnitDiagnosisField>,
}

/// Field of manufacturer's diagnosis.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct UnitDiagnosisField {
    /// Name.
    pub name: String,
    /// Data type.
    pub data_type: String,
    /// Byte.
    pub byte_offset: u32,
    /// First bit in the byte.
    pub bit_offset: u16,
    /// Bits of a bit area.
    pub bit_length: u16,
    /// ID of the texts of its values.
    pub values: Option<String>,
}

/// Reads the errors of channels.
pub(super) fn channels(
    context: &mut GsdmlNames<'_>,
    process: Element<'_>,
) -> Result<Vec<ChannelDiagnosis>, FileFault> {
    let mut list = Vec::new();
    let Some(within) = process.child("ChannelDiagList") else { return Ok(list) };
    for item in within.children() {
        if !matches!(
            item.name(),
            "ChannelDiagItem" | "SystemDefinedChannelDiagItem" | "ProfileChannelDiagItem"
        ) {
            continue;
        }
        let error_type = item.required_number("ErrorType")?;
        list.push(channel(context, item, error_type, None)?);
        let extended = ["ExtChannelDiagList", "ProfileExtChannelDiagList"];
        for inner in extended.iter().filter_map(|name| item.child(name)).flat_map(Element::children) {
            let extended_type = inner.required_number("ErrorType")?;
            list.push(channel(context, inner, error_type, Some(extended_type))?);
        }
    }
    Ok(list)
}

fn channel(
    context: &mut GsdmlNames<'_>,
    item: Element<'_>,
    error_type: u16,
    extended_type: Option<u16>,
) -> Result<ChannelDiagnosis, FileFault> {
    item.charge(size_of::<ChannelDiagnosis>())?;
    let help = item.child("Help").map(|help| context.text_of(help)).transpose()?;
    let name = match item.child("Name") {
        Some(name) => context.text_of(name)?,
        None => String::new(),
    };
    Ok(ChannelDiagnosis { error_type, extended_type, api: item.number("API")?, name, help })
}

/// Reads the diagnosis in formats of the manufacturer.
pub(super) fn units(
    context: &mut GsdmlNames<'_>,
    process: Element<'_>,
) -> Result<Vec<UnitDiagnosis>, FileFault> {
    let Some(within) = process.child("UnitDiagTypeList") else { return Ok(Vec::new()) };
    within.list("UnitDiagTypeItem", |item| {
        let fields = item.list("Ref", |field| {
            Ok(UnitDiagnosisField {
                name: context.text_of(field)?,
                data_type: field.keep(field.attribute("DataType").unwrap_or("Unsigned8"))?,
                byte_offset: field.number("ByteOffset")?.unwrap_or(0),
                bit_offset: field.number("BitOffset")?.unwrap_or(0),
                bit_length: field.number("BitLength")?.unwrap_or(1),
                values: field.keep_some(field.attribute("ValueItemTarget"))?,
            })
        })?;
        let name = item.child("Name").map(|name| context.text_of(name)).transpose()?;
        Ok(UnitDiagnosis { identifier: item.required_number("UserStructureIdentifier")?, name, fields })
    })
}
