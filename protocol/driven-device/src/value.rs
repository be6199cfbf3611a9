//! Values of signals: read from bits, parsed from text, checked against the signal's type.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::signal::{Signal, SignalType};

/// Value of a signal.
#[derive(Clone, PartialEq, Debug)]
pub enum SignalValue {
    /// One bit.
    Bool(bool),
    /// Number from 0.
    Unsigned(u64),
    /// Number with a sign.
    Signed(i64),
    /// Floating-point number.
    Real(f64),
    /// Bytes.
    Bytes(Vec<u8>),
}

/// Value in the engineering units of the file.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ScaledValue {
    /// Value in the signal's unit.
    pub value: f64,
    decimal_places: usize,
}

impl fmt::Display for ScaledValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.*}", self.decimal_places, self.value)
    }
}

/// Reason why a value does not fit a signal.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{signal}: `{value}`: must be {expected}")]
pub struct ValueError {
    signal: String,
    value: String,
    expected: String,
}

impl SignalValue {
    /// Parses a value of a signal: a number, decimal or hexadecimal after `0x`, `true` or `false`, the text of a value in the
    /// file, or the hexadecimal digits of bytes. A decimal number of a scaled signal is in its unit and is rounded to the nearest
    /// raw value; after `0x` it is the raw value itself.
    ///
    /// # Errors
    ///
    /// It is not of the signal's type, or out of its range.
    pub fn parse(signal: &Signal, text: &str) -> Result<Self, ValueError> {
        let refused = || refusal(signal, text);
        if let Some((value, _)) = signal.texts.iter().find(|(_, known)| known == text) {
            return Self::whole(signal, i128::from(*value)).ok_or_else(refused);
        }
        let parsed = match signal.kind {
            SignalType::Bool => match text {
                "1" | "true" => Some(Self::Bool(true)),
                "0" | "false" => Some(Self::Bool(false)),
                _ => None,
            },
            SignalType::Unsigned | SignalType::Signed => {
                let is_scaled = signal.scale.is_some() && !text.starts_with("0x") && !text.starts_with("0X");
                let number = match is_scaled {
                    true => finite(text).map(|number| raw(signal, number).round() as i128),
                    false => whole_number(text),
                };
                number.and_then(|number| Self::whole(signal, number))
            }
            SignalType::Real => {
                let number =
                    finite(text).map(|number| raw(signal, number)).filter(|number| number.is_finite());
                number.filter(|number| signal.bits == 64 || (*number as f32).is_finite()).map(Self::Real)
            }
            SignalType::Bytes => {
                bytes(text).filter(|bytes| bytes.len() == signal.bits.div_ceil(8)).map(Self::Bytes)
            }
        };
        parsed.ok_or_else(refused)
    }

    /// Makes the value of a number, such as one of a script.
    ///
    /// # Errors
    ///
    /// The signal does not take it.
    pub(crate) fn from_number(signal: &Signal, number: f64) -> Result<Self, ValueError> {
        Self::from_raw(signal, raw(signal, number)).map_err(|_| refusal(signal, &number.to_string()))
    }

    fn from_raw(signal: &Signal, number: f64) -> Result<Self, ValueError> {
        let made = match signal.kind {
            SignalType::Bool => Some(Self::Bool(number != 0.0)),
            // A number of 64 bits loses its lowest bits, as f64 has 53.
            SignalType::Unsigned | SignalType::Signed => Self::whole(signal, number.round() as i128),
            SignalType::Real => Some(Self::Real(number)),
            SignalType::Bytes => None,
        };
        made.ok_or_else(|| refusal(signal, &number.to_string()))
    }

    /// Makes the value of a number; a whole one wraps around at the end of the signal's type.
    ///
    /// # Errors
    ///
    /// The signal takes no number.
    pub(crate) fn wrapped(signal: &Signal, number: f64) -> Result<Self, ValueError> {
        let number = raw(signal, number);
        match (signal.kind, range(signal)) {
            (SignalType::Unsigned | SignalType::Signed, Some((least, most))) => {
                let range = most - least + 1;
                let whole = (number.round() as i128).saturating_sub(least).rem_euclid(range) + least;
                Self::whole(signal, whole).ok_or_else(|| refusal(signal, &number.to_string()))
            }
            _ => Self::from_raw(signal, number),
        }
    }

    fn whole(signal: &Signal, number: i128) -> Option<Self> {
        let (least, most) = range(signal)?;
        (least..=most).contains(&number).then_some(match signal.kind {
            SignalType::Bool => Self::Bool(number != 0),
            SignalType::Signed => Self::Signed(number as i64),
            _ => Self::Unsigned(number as u64),
        })
    }

    pub(crate) fn from_bits(kind: SignalType, number: u64, bits: usize) -> Self {
        match kind {
            SignalType::Bool => Self::Bool(number != 0),
            SignalType::Signed => {
                let shift = 64_usize.saturating_sub(bits) as u32;
                Self::Signed((number.checked_shl(shift).unwrap_or(0) as i64) >> shift.min(63))
            }
            SignalType::Real if bits == 32 => Self::Real(f64::from(f32::from_bits(number as u32))),
            SignalType::Real => Self::Real(f64::from_bits(number)),
            SignalType::Unsigned | SignalType::Bytes => Self::Unsigned(number),
        }
    }

    pub(crate) fn to_bits(&self, signal: &Signal) -> Result<u64, ValueError> {
        match (self, signal.kind) {
            (Self::Bool(value), SignalType::Bool) => Ok(u64::from(*value)),
            (Self::Unsigned(value), SignalType::Unsigned) => Ok(*value),
            (Self::Signed(value), SignalType::Signed) => Ok(*value as u64),
            (Self::Real(value), SignalType::Real) if signal.bits == 32 => {
                Ok(u64::from((*value as f32).to_bits()))
            }
            (Self::Real(value), SignalType::Real) => Ok(value.to_bits()),
            _ => Err(refusal(signal, &self.to_string())),
        }
    }

    /// Returns the value in the signal's unit, if the file scales it.
    #[must_use]
    pub fn scaled(&self, signal: &Signal) -> Option<ScaledValue> {
        let scale = signal.scale?;
        let raw = match self {
            Self::Unsigned(value) => *value as f64,
            Self::Signed(value) => *value as f64,
            Self::Real(value) => *value,
            Self::Bool(_) | Self::Bytes(_) => return None,
        };
        let value = (raw + scale.offset) * scale.factor / scale.divisor;
        Some(ScaledValue { value, decimal_places: scale.decimal_places.into() })
    }

    /// Returns the text that the file has for this value.
    #[must_use]
    pub fn text<'s>(&self, signal: &'s Signal) -> Option<&'s str> {
        let number = match self {
            Self::Bool(value) => i64::from(*value),
            Self::Unsigned(value) => i64::try_from(*value).ok()?,
            Self::Signed(value) => *value,
            Self::Real(_) | Self::Bytes(_) => return None,
        };
        signal.texts.iter().find(|(value, _)| *value == number).map(|(_, text)| text.as_str())
    }
}

/// Returns the raw value of a number in the signal's unit.
fn raw(signal: &Signal, number: f64) -> f64 {
    signal.scale.map_or(number, |scale| number * scale.divisor / scale.factor - scale.offset)
}

fn finite(text: &str) -> Option<f64> {
    text.parse::<f64>().ok().filter(|number| number.is_finite())
}

/// Returns the smallest and the largest whole number of a signal.
fn range(signal: &Signal) -> Option<(i128, i128)> {
    let bits = u32::try_from(signal.bits).ok().filter(|bits| (1..=64).contains(bits))?;
    match signal.kind {
        SignalType::Bool => Some((0, 1)),
        SignalType::Unsigned => Some((0, (1_i128 << bits) - 1)),
        SignalType::Signed => Some((-(1_i128 << (bits - 1)), (1_i128 << (bits - 1)) - 1)),
        SignalType::Real | SignalType::Bytes => None,
    }
}

fn refusal(signal: &Signal, value: &str) -> ValueError {
    let expected = match (signal.kind, range(signal)) {
        (SignalType::Bool, _) => "0 or 1".to_owned(),
        (_, Some((least, most))) => {
            let raw = format!("{}, {least} to {most}", signal.type_name());
            let ends = [least, most].map(|end| SignalValue::Real(end as f64).scaled(signal));
            match ends {
                [Some(one), Some(other)] if one.value <= other.value => {
                    format!("{one} to {other} (raw {raw})")
                }
                [Some(one), Some(other)] => format!("{other} to {one} (raw {raw})"),
                _ => raw,
            }
        }
        (SignalType::Bytes, None) => format!("{} in hexadecimal digits", signal.type_name()),
        (_, None) => signal.type_name(),
    };
    let known: Vec<_> = signal.texts.iter().take(6).map(|(_, text)| format!("`{text}`")).collect();
    let expected = if known.is_empty() { expected } else { format!("{expected}, or {}", known.join(", ")) };
    ValueError { signal: signal.name.clone(), value: device_files::excerpt(value), expected }
}

fn whole_number(text: &str) -> Option<i128> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u64::from_str_radix(digits, 16).ok().map(i128::from),
        None => text.parse().ok(),
    }
}

/// Parses hexadecimal digits, two for each byte.
pub(crate) fn bytes(text: &str) -> Option<Vec<u8>> {
    let digits = text.strip_prefix("0x").unwrap_or(text);
    let pair = |at: usize| digits.get(at..at + 2).and_then(|pair| u8::from_str_radix(pair, 16).ok());
    digits.len().is_multiple_of(2).then(|| (0..digits.len()).step_by(2).map(pair).collect())?
}

impl fmt::Display for SignalValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(value) => write!(f, "{}", u8::from(*value)),
            Self::Unsigned(value) => write!(f, "{value}"),
            Self::Signed(value) => write!(f, "{value}"),
            Self::Real(value) => write!(f, "{value}"),
            Self::Bytes(bytes) => bytes.iter().try_for_each(|byte| write!(f, "{byte:02x}")),
        }
    }
}

impl Serialize for SignalValue {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Bool(value) => serializer.serialize_bool(*value),
            Self::Unsigned(value) => serializer.serialize_u64(*value),
            Self::Signed(value) => serializer.serialize_i64(*value),
            Self::Real(value) => serializer.serialize_f64(*value),
            Self::Bytes(_) => serializer.collect_str(self),
        }
    }
}

#[cfg(test)]
mod tests {
    use device_files::EdsScale;

    use super::*;

    #[test]
    fn a_value_of_another_type_or_range_is_refused_with_what_the_signal_takes() {
        let signal = |kind, bits| Signal::new("Speed", "1", kind, 0, bits);
        for (kind, bits, text, said) in [
            (SignalType::Unsigned, 16, "65536", "Speed: `65536`: must be uint16, 0 to 65535"),
            (SignalType::Unsigned, 16, "-1", "Speed: `-1`: must be uint16, 0 to 65535"),
            (SignalType::Signed, 8, "fast", "Speed: `fast`: must be int8, -128 to 127"),
            (SignalType::Bool, 1, "2", "Speed: `2`: must be 0 or 1"),
            (SignalType::Real, 32, "1e39", "Speed: `1e39`: must be real32"),
            (SignalType::Real, 64, "nan", "Speed: `nan`: must be real64"),
            (SignalType::Bytes, 32, "0102", "Speed: `0102`: must be 4 bytes in hexadecimal digits"),
            (SignalType::Bytes, 16, "01é", "Speed: `01é`: must be 2 bytes in hexadecimal digits"),
        ] {
            assert_eq!(SignalValue::parse(&signal(kind, bits), text).unwrap_err().to_string(), said);
        }
        let mut named = signal(SignalType::Unsigned, 8);
        named.texts = vec![(0, "Off".to_owned()), (8, "On".to_owned())];
        assert_eq!(SignalValue::parse(&named, "On"), Ok(SignalValue::Unsigned(8)));
        assert_eq!(SignalValue::Unsigned(8).text(&named), Some("On"));
        let said = SignalValue::parse(&named, "on").unwrap_err().to_string();
        assert_eq!(said, "Speed: `on`: must be uint8, 0 to 255, or `Off`, `On`");
    }
    #[test]
    fn a_scaled_signal_takes_values_in_its_unit_and_raw_values_after_0x() {
        let mut signal = Signal::new("Speed", "1", SignalType::Signed, 0, 16);
        // (raw + 100) x 3 x 2 / (4 x 10)
        signal.scale = Some(EdsScale { offset: 100.0, factor: 6.0, divisor: 40.0, decimal_places: 1 });
        for (text, raw, shown) in
            [("15", 0, "15.0"), ("-0.3", -102, "-0.3"), ("15.08", 1, "15.2"), ("0x10", 16, "17.4")]
        {
            let value = SignalValue::parse(&signal, text).unwrap();
            assert_eq!(value, SignalValue::Signed(raw), "{text}");
            assert_eq!(value.scaled(&signal).unwrap().to_string(), shown);
        }
        assert_eq!(SignalValue::from_number(&signal, 15.15), Ok(SignalValue::Signed(1)));
        let said = SignalValue::parse(&signal, "5000").unwrap_err().to_string();
        assert_eq!(said, "Speed: `5000`: must be -4900.2 to 4930.1 (raw int16, -32768 to 32767)");
        signal.scale = Some(EdsScale { factor: -6.0, ..signal.scale.unwrap() });
        let said = SignalValue::parse(&signal, "x").unwrap_err().to_string();
        assert_eq!(said, "Speed: `x`: must be -4930.1 to 4900.2 (raw int16, -32768 to 32767)");
    }

    #[test]
    fn a_number_of_any_size_wraps_into_the_type() {
        for kind in [SignalType::Unsigned, SignalType::Signed] {
            for bits in [1, 8, 63, 64] {
                let signal = Signal::new("Count", "1", kind, 0, bits);
                for number in [f64::MAX, f64::MIN, f64::INFINITY, f64::NAN, -1.0, 1e18] {
                    assert!(SignalValue::wrapped(&signal, number).is_ok(), "{kind:?} {bits} {number}");
                }
            }
        }
        let signal = Signal::new("Count", "1", SignalType::Signed, 0, 8);
        assert_eq!(SignalValue::wrapped(&signal, 130.0), Ok(SignalValue::Signed(-126)));
    }
}
