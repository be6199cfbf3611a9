//! Parameter records with their defaults.

use serde::{Deserialize, Serialize};

use super::data::fixed_length;
use super::names::GsdmlNames;
use crate::fault::{FileFault, excerpt};
use crate::xml::{Element, number};

/// Record that the controller writes at start-up.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ParameterRecord {
    /// Index.
    pub index: u16,
    /// Name.
    pub name: String,
    /// Position among the records of the submodule; records of 0 may come in any order.
    pub transfer_sequence: u16,
    /// Content with the defaults of all values.
    #[serde(with = "crate::hex")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub default: Vec<u8>,
    /// Values that the user may change.
    pub values: Vec<RecordValue>,
    /// True if these are parameters of PROFIsafe, which this program does not make.
    pub is_safety: bool,
}

/// Value in a record.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RecordValue {
    /// Name.
    pub name: String,
    /// Data type, such as `Unsigned16`, `Bit` or `BitArea`.
    pub data_type: String,
    /// First byte.
    pub byte_offset: u32,
    /// Lowest bit of a `Bit` or `BitArea` in its bytes.
    pub bit_offset: u16,
    /// Bits of a `BitArea`.
    pub bit_length: u16,
    /// Default as the file writes it.
    pub default: String,
    /// Allowed values as the file writes them; none if all are allowed.
    pub allowed: Option<String>,
    /// True if the user may change it.
    pub is_changeable: bool,
    /// ID of the texts of its values.
    pub values: Option<String>,
}

/// Texts of the values of a type.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ValueTexts {
    /// ID that values name.
    pub id: String,
    /// Text of each value.
    pub texts: Vec<ValueText>,
}

/// Text of a value.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ValueText {
    /// Value.
    pub value: i64,
    /// Text.
    pub text: String,
}

/// Longest record that the reader accepts: a record's length is 32 bits wide, and one request carries less than 64 kB.
const LONGEST_RECORD: u32 = 65_535;

/// Reads the texts of values.
pub(super) fn value_texts(
    context: &mut GsdmlNames<'_>,
    process: Element<'_>,
) -> Result<Vec<ValueTexts>, FileFault> {
    let Some(within) = process.child("ValueList") else { return Ok(Vec::new()) };
    within.list("ValueItem", |item| {
        let mut texts = Vec::new();
        for assigned in
            item.child("Assignments").into_iter().flat_map(|within| within.children_named("Assign"))
        {
            assigned.charge(size_of::<ValueText>())?;
            let content = assigned.required("Content")?;
            // A value may also be text of another form, such as a float or "0x00,0x01", which no enumeration needs.
            let Some(value) = number(content) else { continue };
            texts.push(ValueText { value, text: context.text_of(assigned)? });
        }
        Ok(ValueTexts { id: item.keep(item.required("ID")?)?, texts })
    })
}

/// Reads the records of a submodule.
pub(super) fn read(
    context: &mut GsdmlNames<'_>,
    submodule: Element<'_>,
) -> Result<Vec<ParameterRecord>, FileFault> {
    let Some(within) = submodule.child("RecordDataList") else { return Ok(Vec::new()) };
    let mut records = within.list("ParameterRecordDataItem", |record| read_record(context, record))?;
    records.extend(within.list("F_ParameterRecordDataItem", |record| {
        Ok(ParameterRecord {
            index: record.required_number("Index")?,
            name: "PROFIsafe parameters".to_owned(),
            transfer_sequence: record.number("TransferSequence")?.unwrap_or(0),
            default: Vec::new(),
            values: Vec::new(),
            is_safety: true,
        })
    })?);
    records.sort_by_key(|record| record.transfer_sequence);
    Ok(records)
}

fn read_record(context: &mut GsdmlNames<'_>, record: Element<'_>) -> Result<ParameterRecord, FileFault> {
    let length: u32 = record.required_number("Length")?;
    if length > LONGEST_RECORD {
        return Err(record.finding(format!("Length {length}: must be at most {LONGEST_RECORD} bytes")));
    }
    record.charge(length as usize)?;
    let mut default = vec![0; length as usize];
    for constant in record.children_named("Const") {
        let bytes = octets(constant.required("Data")?)
            .ok_or_else(|| constant.finding("Data must be bytes such as `0x01,0x02`"))?;
        let at = constant.number("ByteOffset")?.unwrap_or(0);
        put(&mut default, at, &bytes).ok_or_else(|| too_short(constant, at, bytes.len(), length))?;
    }
    let values = record.list("Ref", |value| read_value(context, value, &mut default))?;
    let name = record.child("Name").map(|name| context.text_of(name)).transpose()?.unwrap_or_default();
    Ok(ParameterRecord {
        index: record.required_number("Index")?,
        name,
        transfer_sequence: record.number("TransferSequence")?.unwrap_or(0),
        default,
        values,
        is_safety: false,
    })
}

fn too_short(element: Element<'_>, at: usize, bytes: usize, length: u32) -> FileFault {
    element.finding(format!("{bytes} bytes at byte {at} of a record of {length} bytes; enlarge its Length"))
}

fn put(record: &mut [u8], at: usize, bytes: &[u8]) -> Option<()> {
    record.get_mut(at..at.checked_add(bytes.len())?)?.copy_from_slice(bytes);
    Some(())
}

/// Parses bytes such as `0x01,0x02`.
fn octets(text: &str) -> Option<Vec<u8>> {
    text.split(',').map(str::trim).filter(|byte| !byte.is_empty()).map(number).collect()
}

fn read_value(
    context: &mut GsdmlNames<'_>,
    value: Element<'_>,
    record: &mut [u8],
) -> Result<RecordValue, FileFault> {
    let read = RecordValue {
        name: context.text_of(value)?,
        data_type: value.keep(value.required("DataType")?)?,
        byte_offset: value.required_number("ByteOffset")?,
        bit_offset: value.number("BitOffset")?.unwrap_or(0),
        bit_length: value.number("BitLength")?.unwrap_or(1),
        default: value.keep(value.attribute("DefaultValue").unwrap_or_default())?,
        allowed: value.keep_some(value.attribute("AllowedValues"))?,
        is_changeable: value.attribute("Changeable") != Some("false"),
        values: value.keep_some(value.attribute("ValueItemTarget"))?,
    };
    if let Some(target) = read.values.as_deref().filter(|target| !context.has_values(target)) {
        context.warn(
            value.finding(format!("ValueItemTarget `{}` is not in the file; ignored", excerpt(target))),
        );
    }
    let declared: Option<u32> = value.number("Length")?;
    put_default(&read, declared, record).map_err(|fault| value.finding(fault))?;
    Ok(read)
}

/// Writes the default of a value into its record, in big-endian order (IEC 61158-6-10).
fn put_default(value: &RecordValue, declared: Option<u32>, record: &mut [u8]) -> Result<(), String> {
    let at = value.byte_offset as usize;
    let length = record.len();
    let short = |bytes: usize| {
        format!("{bytes} bytes at byte {at} of a record of {length} bytes; enlarge its Length")
    };
    let wrong = || {
        let (default, data_type) = (excerpt(&value.default), excerpt(&value.data_type));
        format!("DefaultValue `{default}` does not fit DataType `{data_type}`; correct it")
    };
    let whole = || match value.default.as_str() {
        "" | "false" => Some(0),
        "true" => Some(1),
        text => number::<i64>(text),
    };
    let bits = match value.data_type.as_str() {
        "Bit" => Some(1),
        "BitArea" => Some(value.bit_length),
        _ => None,
    };
    if let Some(bits) = bits {
        let end = value.bit_offset.saturating_add(bits);
        let width = usize::from(end.div_ceil(8));
        if bits == 0 || end > 64 {
            return Err(format!("bits {} to {end}: must be within 64 bits", value.bit_offset));
        }
        let bytes = record.get_mut(at..at.saturating_add(width)).ok_or_else(|| short(width))?;
        let set = whole().ok_or_else(wrong)? as u64;
        let mask = u64::MAX >> (64 - bits);
        if set & !mask != 0 {
            return Err(wrong());
        }
        for (index, byte) in bytes.iter_mut().rev().enumerate() {
            let shift = 8 * index as u32;
            *byte &= !((mask << value.bit_offset) >> shift) as u8;
            *byte |= ((set << value.bit_offset) >> shift) as u8;
        }
        return Ok(());
    }
    let bytes = match value.data_type.as_str() {
        "Float32" => {
            float(&value.default).ok_or_else(wrong)?.map_or(vec![0; 4], |it| (it as f32).to_be_bytes().into())
        }
        "Float64" => {
            float(&value.default).ok_or_else(wrong)?.map_or(vec![0; 8], |it| it.to_be_bytes().into())
        }
        "VisibleString" | "OctetString" | "UnicodeString8" | "61131_STRING" | "61131_WSTRING" => {
            let text = value.default.as_str();
            let mut bytes = octets(text).filter(|_| text.contains("0x")).unwrap_or_else(|| text.into());
            // A text may be shorter than its field; the rest are zeros.
            let width =
                declared.map_or(bytes.len(), |declared| declared as usize).min(length.saturating_sub(at));
            bytes.resize(width, 0);
            bytes
        }
        data_type => match fixed_length(data_type) {
            Some(width @ 1..=8) => {
                let set = whole().ok_or_else(wrong)?;
                let bytes = set.to_be_bytes();
                let (cut, kept) = bytes.split_at(8 - width as usize);
                if cut.iter().any(|byte| !matches!(byte, 0 | 0xFF)) {
                    return Err(wrong());
                }
                kept.to_vec()
            }
            // Times have no default that a user writes.
            _ => return Ok(()),
        },
    };
    put(record, at, &bytes).ok_or_else(|| short(bytes.len()))
}

/// Parses a float, if one is given.
fn float(text: &str) -> Option<Option<f64>> {
    if text.is_empty() { Some(None) } else { text.replace(',', ".").parse().ok().map(Some) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(data_type: &str, byte: u32, bit: u16, bits: u16, default: &str) -> RecordValue {
        RecordValue {
            name: String::new(),
            data_type: data_type.to_owned(),
            byte_offset: byte,
            bit_offset: bit,
            bit_length: bits,
            default: default.to_owned(),
            allowed: None,
            is_changeable: true,
            values: None,
        }
    }

    #[test]
    fn each_default_is_at_its_place_in_the_record() {
        let mut record = [0xFF; 4];
        put_default(&value("Bit", 0, 3, 1, "0"), None, &mut record).unwrap();
        put_default(&value("BitArea", 1, 2, 3, "5"), None, &mut record).unwrap();
        assert_eq!(record, [0xF7, 0xF7, 0xFF, 0xFF]);
        put_default(&value("BitArea", 0, 4, 8, "0x5A"), None, &mut record).unwrap();
        assert_eq!(
            record,
            [0xF5, 0xA7, 0xFF, 0xFF],
            "12 bits are two bytes, the first of which is the higher"
        );
        put_default(&value("Integer16", 0, 0, 1, "-2"), None, &mut record).unwrap();
        put_default(&value("Unsigned16", 2, 0, 1, "258"), None, &mut record).unwrap();
        assert_eq!(record, [0xFF, 0xFE, 1, 2]);
        put_default(&value("Float32", 0, 0, 1, "1.5"), None, &mut record).unwrap();
        assert_eq!(record, 1.5_f32.to_be_bytes());
        put_default(&value("VisibleString", 0, 0, 1, "ab"), Some(4), &mut record).unwrap();
        assert_eq!(&record, b"ab\0\0");
        put_default(&value("OctetString", 2, 0, 1, "0x01,0xFF"), None, &mut record).unwrap();
        assert_eq!(record, [b'a', b'b', 1, 0xFF]);
    }

    #[test]
    fn a_default_outside_of_its_record_or_type_is_refused() {
        for (wrong, expected) in [
            (
                value("Unsigned32", 1, 0, 1, "0"),
                "4 bytes at byte 1 of a record of 4 bytes; enlarge its Length",
            ),
            (
                value("Unsigned8", u32::MAX, 0, 1, "0"),
                "1 bytes at byte 4294967295 of a record of 4 bytes; enlarge its Length",
            ),
            (
                value("Unsigned8", 0, 0, 1, "256"),
                "DefaultValue `256` does not fit DataType `Unsigned8`; correct it",
            ),
            (value("BitArea", 0, 0, 2, "4"), "DefaultValue `4` does not fit DataType `BitArea`; correct it"),
            (value("BitArea", 0, 60, 9, "0"), "bits 60 to 69: must be within 64 bits"),
            (value("Float32", 0, 0, 1, "x"), "DefaultValue `x` does not fit DataType `Float32`; correct it"),
        ] {
            assert_eq!(put_default(&wrong, None, &mut [0; 4]).unwrap_err(), expected);
        }
    }
}
