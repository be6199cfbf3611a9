//! Parameters and the texts of their values.

use serde::Serialize;

use super::syntax::{Sheet, SheetSection};
use crate::fault::FileFault;

/// Parameter: a value that an attribute has, or that a connection takes.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EdsParameter {
    /// Number by which others name it.
    pub number: u32,
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Help.
    pub help: String,
    /// Path of its attribute, if it has one.
    pub path: String,
    /// Descriptor: bits such as read-only.
    pub descriptor: u32,
    /// CIP data type, such as 0xC7 for UINT.
    pub data_type: u16,
    /// Bytes.
    pub size: Option<u32>,
    /// Smallest value as the file writes it.
    pub minimum: String,
    /// Largest value as the file writes it.
    pub maximum: String,
    /// Default as the file writes it.
    pub default: String,
    /// Multiplier, divisor, base and offset of the scale; a 0 is a field that the file leaves out.
    pub scaling: Option<[i64; 4]>,
    /// True if another parameter gives one of these numbers.
    #[serde(skip)]
    pub has_scaling_links: bool,
    /// Decimal places of the scaled value.
    pub decimal_places: u8,
    /// Texts of its values.
    pub texts: Vec<ParameterText>,
}

/// Text of a parameter's value.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ParameterText {
    /// Value.
    pub value: i64,
    /// Text.
    pub text: String,
}

/// Scale of a parameter: value = (raw + offset) × factor ÷ divisor (CIP volume 1, 5-14).
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct EdsScale {
    /// Added to the raw value.
    pub offset: f64,
    /// Multiplier times base; not 0.
    pub factor: f64,
    /// Divisor times ten to the power of the decimal places; not 0.
    pub divisor: f64,
    /// Decimal places of the scaled value.
    pub decimal_places: u8,
}

/// Bit of a parameter's descriptor: it is scaled (CIP volume 1, table 7-3.14).
const IS_SCALED: u32 = 0x04;

/// Most decimal places that a double-precision number has.
const MOST_DECIMAL_PLACES: u8 = 15;

impl EdsParameter {
    /// Returns the scale; `None` if the parameter is not scaled, other parameters give its numbers, or it has more than 15
    /// decimal places.
    #[must_use]
    pub fn scale(&self) -> Option<EdsScale> {
        let is_scaled = self.descriptor & IS_SCALED != 0 && !self.has_scaling_links;
        let [multiplier, divisor, base, offset] = self.scaling.filter(|_| is_scaled)?;
        let factor_of = |number: i64| if number == 0 { 1.0 } else { number as f64 };
        (self.decimal_places <= MOST_DECIMAL_PLACES).then(|| EdsScale {
            offset: offset as f64,
            factor: factor_of(multiplier) * factor_of(base),
            divisor: factor_of(divisor) * 10_f64.powi(i32::from(self.decimal_places)),
            decimal_places: self.decimal_places,
        })
    }

    /// Returns the default as a whole number, if it is one.
    #[must_use]
    pub fn default_number(&self) -> Option<u32> {
        crate::xml::number(&self.default)
    }
}

/// Reads the parameters (CIP volume 1, 7-3.6.6).
pub(super) fn read(sheet: &Sheet<'_>, section: &SheetSection<'_>) -> Result<Vec<EdsParameter>, FileFault> {
    let mut parameters = Vec::new();
    for (number, entry) in section.numbered("Param") {
        sheet.charge(size_of::<EdsParameter>())?;
        let keep = |index: usize| sheet.keep(entry.field(index));
        let scaling = [12, 13, 14, 15].map(|index| entry.number::<i64>(index).ok().flatten());
        parameters.push(EdsParameter {
            number,
            path: keep(2)?,
            descriptor: entry.number(3)?.unwrap_or(0),
            data_type: entry.number(4)?.unwrap_or(0),
            size: entry.number(5)?,
            name: keep(6)?,
            unit: keep(7)?,
            help: keep(8)?,
            minimum: keep(9)?,
            maximum: keep(10)?,
            default: keep(11)?,
            scaling: scaling.iter().any(Option::is_some).then(|| scaling.map(|it| it.unwrap_or(0))),
            has_scaling_links: (16..20).any(|index| !matches!(entry.field(index), "" | "0")),
            decimal_places: entry.number(20).ok().flatten().unwrap_or(0),
            texts: Vec::new(),
        });
    }
    parameters.sort_by_key(|parameter| parameter.number);
    for (number, entry) in section.numbered("Enum") {
        let at = parameters.binary_search_by_key(&number, |parameter| parameter.number);
        let parameter = at.ok().and_then(|at| parameters.get_mut(at));
        let fault =
            || entry.finding(0, format!("Param{number} is not in the file; add it or remove its texts"));
        let parameter = parameter.ok_or_else(fault)?;
        for pair in 0..entry.count() / 2 {
            sheet.charge(size_of::<ParameterText>())?;
            let Some(value) = entry.number(2 * pair)? else { continue };
            parameter.texts.push(ParameterText { value, text: sheet.keep(entry.field(2 * pair + 1))? });
        }
    }
    Ok(parameters)
}
