//! Signal: a named value in the inputs or outputs of a device.

use std::collections::{BTreeMap, BTreeSet};

use device_files::EdsScale;
use serde::Serialize;

/// Named value in the data of one direction.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Signal {
    /// Name, which no other signal of its direction has.
    pub name: String,
    /// Submodule, assembly or entry that it belongs to, such as `1.2`, `100` or `0x6000:01`.
    pub place: String,
    /// Unit; empty if the file gives none.
    pub unit: String,
    /// Type.
    #[serde(rename = "type")]
    pub kind: SignalType,
    /// Bits.
    pub bits: usize,
    /// First bit in the data of its direction, each byte from its lowest bit.
    pub bit: usize,
    /// Texts of its values.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub texts: Vec<(i64, String)>,
    /// Scale of its numbers into engineering units, if the file gives one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<EdsScale>,
    /// True for data of PROFIsafe or FSoE, which are shown as bytes and never sent.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_safety: bool,
}

/// Type of a signal.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SignalType {
    /// One bit.
    Bool,
    /// Number from 0.
    Unsigned,
    /// Number in two's complement.
    Signed,
    /// Floating-point number of 32 or 64 bits.
    Real,
    /// Bytes.
    Bytes,
}

impl Signal {
    /// Makes a signal without unit and texts.
    pub(crate) fn new(name: &str, place: &str, kind: SignalType, bit: usize, bits: usize) -> Self {
        Self {
            name: name.to_owned(),
            place: place.to_owned(),
            unit: String::new(),
            // A number has at most 64 bits, and a real number 32 or 64.
            kind: match kind {
                SignalType::Bool if bits != 1 => SignalType::Unsigned,
                SignalType::Real if bits != 32 && bits != 64 => SignalType::Bytes,
                SignalType::Unsigned | SignalType::Signed if bits > 64 => SignalType::Bytes,
                kind => kind,
            },
            bits,
            bit,
            texts: Vec::new(),
            scale: None,
            is_safety: false,
        }
    }

    /// Returns whether it has bits, and all of them are in data of this many bytes.
    pub(crate) fn fits(&self, bytes: usize) -> bool {
        self.bits > 0 && self.bit.checked_add(self.bits).is_some_and(|end| end <= 8 * bytes)
    }

    /// Returns the type in words, such as `uint16`.
    #[must_use]
    pub fn type_name(&self) -> String {
        match self.kind {
            SignalType::Bool => "bool".to_owned(),
            SignalType::Unsigned => format!("uint{}", self.bits),
            SignalType::Signed => format!("int{}", self.bits),
            SignalType::Real => format!("real{}", self.bits),
            SignalType::Bytes => format!("{} bytes", self.bits.div_ceil(8)),
        }
    }
}

/// Appends a number to each name that an earlier signal has, as in `Speed#2`.
pub(crate) fn number_duplicates<'s>(signals: impl Iterator<Item = &'s mut Signal>) {
    let mut names = BTreeSet::new();
    let mut counts = BTreeMap::<String, u32>::new();
    for signal in signals {
        if names.contains(&signal.name) {
            let count = counts.entry(signal.name.clone()).or_insert(1);
            signal.name = loop {
                *count += 1;
                let name = format!("{}#{count}", signal.name);
                if !names.contains(&name) {
                    break name;
                }
            };
        }
        names.insert(signal.name.clone());
    }
}
