//! Parameters of a device that are read and written by name: attributes, records and objects.

use device_files::excerpt;

use crate::config::DriveError;
use crate::signal::{Signal, SignalType};
use crate::table::SignalTable;
use crate::value::{ScaledValue, SignalValue};

/// DeviceParameter of a device.
#[derive(Clone, PartialEq, Debug)]
pub struct DeviceParameter {
    /// Name in the file, unit and type; its bits are those of the parameter alone.
    pub signal: Signal,
    /// True if the file says that it cannot be written.
    pub is_read_only: bool,
    pub(crate) target: ParameterTarget,
    /// True if numbers have their highest byte first.
    pub(crate) is_big_endian: bool,
}

/// Place of a parameter in the device.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum ParameterTarget {
    /// Attribute by its padded path.
    Attribute(Vec<u8>),
    /// Record by slot, subslot and index.
    Record(u16, u16, u16),
    /// Object by index and subindex.
    Object(u16, u8),
    /// All entries of an object, by complete access.
    WholeObject(u16),
}

/// Access to a parameter: a read, or a write of these bytes.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ParameterAccess {
    pub(crate) parameter: DeviceParameter,
    pub(crate) written: Option<Vec<u8>>,
    /// True for a read of the controller's own, which looks for what was wrong before the connection.
    pub(crate) is_diagnosis: bool,
}

/// Faults and differences that an answer to a read of the controller's own reports, and the reads that follow it.
#[derive(Default, Debug)]
pub(crate) struct Earlier {
    pub(crate) words: Vec<String>,
    pub(crate) differences: Vec<String>,
    pub(crate) reads: Vec<ParameterAccess>,
}

impl From<Vec<String>> for Earlier {
    fn from(words: Vec<String>) -> Self {
        Self { words, ..Self::default() }
    }
}

/// Answer of the device about a parameter.
#[derive(Clone, PartialEq, Debug)]
pub struct ParameterAnswer {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// True if it was written, false if it was read.
    pub is_write: bool,
    /// Value read or written, or why not.
    pub result: Result<ParameterValue, String>,
}

/// Value of a parameter.
#[derive(Clone, PartialEq, Debug)]
pub struct ParameterValue {
    /// Value as the device has it.
    pub raw: SignalValue,
    /// Value in the parameter's unit, if the file scales it.
    pub scaled: Option<ScaledValue>,
    /// Text that the file has for it.
    pub text: Option<String>,
}

impl DeviceParameter {
    /// Reads the value from bytes of the device. Those of another length than the file's are shown as bytes.
    fn decode(&self, bytes: &[u8]) -> ParameterValue {
        if bytes.len() != self.signal.bits.div_ceil(8) || self.signal.kind == SignalType::Bytes {
            return ParameterValue { raw: SignalValue::Bytes(bytes.to_vec()), scaled: None, text: None };
        }
        let mut table = SignalTable::new(vec![self.signal.clone()], bytes.len(), self.is_big_endian);
        table.copy(0, bytes);
        let raw = table.value(&self.signal);
        let text = raw.text(&self.signal).map(str::to_owned);
        ParameterValue { scaled: raw.scaled(&self.signal), raw, text }
    }

    pub(crate) fn encode(&self, text: &str) -> Result<Vec<u8>, DriveError> {
        // Bytes of any length where the file does not give one.
        if self.signal.bits == 0 {
            let bytes = crate::value::bytes(text).filter(|bytes| !bytes.is_empty());
            return bytes.ok_or_else(|| DriveError::NotWritable {
                kind: "parameter",
                name: self.signal.name.clone(),
                reason: "the value must be hexadecimal digits, two for each byte",
            });
        }
        let value = SignalValue::parse(&self.signal, text)?;
        let mut table =
            SignalTable::new(vec![self.signal.clone()], self.signal.bits.div_ceil(8), self.is_big_endian);
        table.set(&self.signal, &value)?;
        Ok(table.bytes().to_vec())
    }
}

impl ParameterAccess {
    /// Makes a read of the controller's own, of a parameter by its place.
    pub(crate) fn of_diagnosis(parameter: DeviceParameter) -> Self {
        Self { parameter, written: None, is_diagnosis: true }
    }

    /// Makes the answer of what the device said.
    pub(crate) fn answered(&self, result: Result<Vec<u8>, String>) -> ParameterAnswer {
        let DeviceParameter { signal, .. } = &self.parameter;
        ParameterAnswer {
            name: signal.name.clone(),
            unit: signal.unit.clone(),
            is_write: self.written.is_some(),
            result: result.map(|read| self.parameter.decode(self.written.as_deref().unwrap_or(&read))),
        }
    }
}

/// Finds a parameter: by its name, in other case where only one parameter has it, or by its place in the form of the bus.
pub(crate) fn find(
    parameters: &[DeviceParameter],
    name: &str,
    by_place: impl FnOnce(&str) -> Option<DeviceParameter>,
) -> Result<DeviceParameter, DriveError> {
    let exact = parameters.iter().find(|known| known.signal.name == name || known.signal.place == name);
    let alike = || {
        let mut alike = parameters.iter().filter(|known| known.signal.name.eq_ignore_ascii_case(name));
        alike.next().filter(|_| alike.next().is_none())
    };
    exact.or_else(alike).cloned().or_else(|| by_place(name)).ok_or_else(|| {
        DriveError::unknown("parameter", name, parameters.iter().map(|known| known.signal.name.as_str()))
    })
}

/// Makes a parameter that the file does not name: its bytes.
pub(crate) fn unnamed(name: &str, target: ParameterTarget) -> DeviceParameter {
    DeviceParameter {
        signal: Signal::new(&excerpt(name), &excerpt(name), SignalType::Bytes, 0, 0),
        is_read_only: false,
        target,
        is_big_endian: false,
    }
}
