//! Cyclic data of a submodule.

use serde::Serialize;

use super::names::GsdmlNames;
use crate::fault::{FileFault, excerpt};
use crate::xml::Element;

/// Cyclic data of one direction.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct IoDirection {
    /// Bytes, without the status.
    pub length: u32,
    /// Consistency, such as `All items consistency`.
    pub consistency: String,
    /// Items in their order.
    pub items: Vec<DataItem>,
}

/// Item of cyclic data.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DataItem {
    /// Name.
    pub name: String,
    /// Data type, such as `Unsigned16`.
    pub data_type: String,
    /// Bytes.
    pub length: u32,
    /// Named bits.
    pub bits: Vec<DataBit>,
}

/// Named bit of an item.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DataBit {
    /// Offset from the lowest bit.
    pub offset: u16,
    /// Name.
    pub name: String,
}

impl IoDirection {
    /// Reads `Input` or `Output` of a submodule's `IOData`.
    pub(super) fn read(
        context: &mut GsdmlNames<'_>,
        submodule: Element<'_>,
        name: &str,
    ) -> Result<Self, FileFault> {
        let Some(direction) = submodule.at(&["IOData", name]) else { return Ok(Self::default()) };
        let items = direction.list("DataItem", |item| read_item(context, item))?;
        let length = items.iter().map(|item| item.length).fold(0, u32::saturating_add);
        if length > LONGEST_DATA {
            let fault = format!("{length} bytes of cyclic data; at most {LONGEST_DATA} fit into a frame");
            return Err(direction.finding(fault));
        }
        let consistency = direction.attribute("Consistency").unwrap_or("Item consistency");
        Ok(Self { length, consistency: direction.keep(consistency)?, items })
    }
}

/// Bytes of cyclic data in a frame of RT class 1 with status (IEC 61158-6-10, C_SDU).
const LONGEST_DATA: u32 = 1_440;

fn read_item(context: &mut GsdmlNames<'_>, item: Element<'_>) -> Result<DataItem, FileFault> {
    let data_type = item.required("DataType")?;
    let given: Option<u32> = item.number("Length")?;
    let length = match (fixed_length(data_type), given) {
        (Some(length), _) | (None, Some(length)) => length,
        (None, None) => {
            let fault = format!("DataType `{}` is unknown and has no Length; add it", excerpt(data_type));
            return Err(item.finding(fault));
        }
    };
    let bits = item.list("BitDataItem", |bit| {
        Ok(DataBit { offset: bit.required_number("BitOffset")?, name: context.text_of(bit)? })
    })?;
    Ok(DataItem { name: context.text_of(item)?, data_type: item.keep(data_type)?, length, bits })
}

/// Returns the bytes of a data type whose length is fixed (GSDML, DataItem/@DataType).
pub(super) fn fixed_length(data_type: &str) -> Option<u32> {
    let length = match data_type {
        "Integer8" | "Unsigned8" | "Boolean" | "Unsigned8_S" | "Integer8_S" | "V1" => 1,
        "Integer16"
        | "Unsigned16"
        | "Unsigned8+Unsigned8"
        | "N2"
        | "V2"
        | "L2"
        | "R2"
        | "T2"
        | "D2"
        | "E2"
        | "Unsigned16_Status" => 2,
        "Unsigned16_S" | "Integer16_S" | "OctetString2+Unsigned8" => 3,
        "Integer32"
        | "Unsigned32"
        | "Float32"
        | "N4"
        | "T4"
        | "C4"
        | "X4"
        | "F_MessageTrailer4Byte"
        | "TimeDifferenceWithoutDate"
        | "TimeDifference without date indication"
        | "TimeOfDay without date indication" => 4,
        "Float32+Unsigned8" | "Float32+Status8" | "F_MessageTrailer5Byte" | "Integer32_S" => 5,
        "TimeOfDay with date indication" | "TimeDifference with date indication" => 6,
        "Date" => 7,
        "Integer64"
        | "Unsigned64"
        | "Float64"
        | "NetworkTime"
        | "NetworkTimeDifference"
        | "TimeStampDifferenceShort" => 8,
        "TimeStamp" | "TimeStampDifference" => 12,
        _ => return None,
    };
    Some(length)
}
