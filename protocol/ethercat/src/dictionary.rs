//! The object dictionary: the objects that SDOs read and write, and that the SDO information service lists.
//!
//! The value of an entry that is mapped into process data is in the process data; the other entries have values of their
//! own.

mod mapped;
mod pdo_configuration;
mod synchronisation;

use alloc::borrow::Cow;
use alloc::vec;
use alloc::vec::Vec;

use crate::abort_code::AbortCode;
use crate::al::AlState;
use crate::description::{Access, DataType, Description, Entry, Object, ObjectCode};
use crate::layout::Usage;

pub use pdo_configuration::PdoConfiguration;
pub(crate) use pdo_configuration::configures;

/// Where a value is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Value {
    /// In the dictionary: start, and length in bytes now.
    Stored { start: usize, len: usize },
    /// In the inputs, from this bit.
    Input { bit: usize },
    /// In the outputs, from this bit.
    Output { bit: usize },
}

/// An entry of an object.
#[derive(Clone, Debug)]
pub(crate) struct DictionaryEntry {
    pub(crate) subindex: u8,
    pub(crate) name: Cow<'static, str>,
    pub(crate) data_type: DataType,
    pub(crate) bits: usize,
    pub(crate) access: Access,
    value: Value,
    /// Where its value is while it is not mapped.
    unmapped: Value,
    /// Whether it can be mapped into the inputs, and whether into the outputs.
    pub(crate) mappable: (bool, bool),
}

/// An object.
#[derive(Clone, Debug)]
pub(crate) struct DictionaryObject {
    pub(crate) index: u16,
    pub(crate) name: &'static str,
    pub(crate) code: ObjectCode,
    pub(crate) entries: Vec<DictionaryEntry>,
}

impl DictionaryObject {
    pub(crate) fn entry(&self, subindex: u8) -> Option<&DictionaryEntry> {
        self.entries.iter().find(|entry| entry.subindex == subindex)
    }
}

impl DictionaryEntry {
    /// Returns the length in bytes of its longest value.
    pub(crate) const fn capacity(&self) -> usize {
        self.bits.div_ceil(8)
    }
}

/// Process data as they are now.
#[derive(Debug)]
pub(crate) struct ProcessData<'a> {
    pub(crate) inputs: &'a [u8],
    pub(crate) outputs: &'a mut [u8],
}

/// The objects of a device, and their values.
#[derive(Clone, Debug)]
pub(crate) struct Dictionary {
    description: &'static Description,
    configuration: PdoConfiguration,
    /// Indices ascending.
    objects: Vec<DictionaryObject>,
    values: Vec<u8>,
    /// Set while process data have the described entries in their order.
    is_as_described: bool,
    /// Set once the MainDevice has chosen process data, until they are applied.
    is_rechosen: bool,
}

impl Dictionary {
    pub(crate) fn new(
        description: &'static Description,
        configuration: PdoConfiguration,
        serial_number: u32,
    ) -> Self {
        let mut dictionary = Self {
            description,
            configuration,
            objects: Vec::new(),
            values: Vec::new(),
            is_as_described: true,
            is_rechosen: false,
        };
        dictionary.add_device(description, serial_number);
        dictionary.add_pdos(Usage::Outputs, 0x1C12, "RxPDO assign");
        dictionary.add_pdos(Usage::Inputs, 0x1C13, "TxPDO assign");
        description.objects.iter().for_each(|object| dictionary.add_described(object));
        dictionary.add_synchronisation();
        dictionary.add_mapped(Usage::Outputs);
        dictionary.add_mapped(Usage::Inputs);
        dictionary.objects.sort_by_key(|object| object.index);
        for object in &mut dictionary.objects {
            object.entries.sort_by_key(|entry| entry.subindex);
        }
        dictionary.map_process_data();
        dictionary
    }

    pub(crate) const fn description(&self) -> &'static Description {
        self.description
    }

    pub(crate) const fn configuration(&self) -> PdoConfiguration {
        self.configuration
    }

    pub(crate) fn values(&self) -> &[u8] {
        &self.values
    }

    /// Returns whether the MainDevice has chosen process data since the last call.
    pub(crate) const fn take_choice(&mut self) -> bool {
        core::mem::replace(&mut self.is_rechosen, false)
    }

    /// Sets all values to what [`values`](Self::values) returned before.
    pub(crate) fn restore(&mut self, values: &[u8]) {
        if values.len() == self.values.len() {
            self.values.copy_from_slice(values);
        }
    }

    fn entry_mut(&mut self, index: u16, subindex: u8) -> Option<&mut DictionaryEntry> {
        let at = self.objects.binary_search_by_key(&index, |object| object.index).ok()?;
        self.objects.get_mut(at)?.entries.iter_mut().find(|entry| entry.subindex == subindex)
    }

    /// Adds the objects of every device (ETG.1000.6, CoE communication area).
    fn add_device(&mut self, description: &Description, serial_number: u32) {
        use DataType::{Unsigned8, Unsigned32};
        self.add_variable(0x1000, "Device type", Unsigned32, &description.device_type.to_le_bytes());
        self.add_variable(0x1001, "Error register", Unsigned8, &[0]);
        for (index, name, text) in [
            (0x1008, "Device name", description.order_code),
            (0x1009, "Hardware version", description.hardware_version),
            (0x100A, "Software version", description.software_version),
        ] {
            // The description may have an object of its own.
            if description.objects.iter().all(|object| object.index != index) {
                self.add_variable(index, name, DataType::VisibleString, text.as_bytes());
            }
        }
        let identity = [
            ("Vendor ID", description.vendor_id),
            ("Product code", description.product_code),
            ("Revision", description.revision),
            ("Serial number", serial_number),
        ];
        let values = identity.map(|(name, value)| (name, value.to_le_bytes()));
        let values: Vec<(&'static str, &[u8])> =
            values.iter().map(|(name, value)| (*name, &value[..])).collect();
        self.add_list(0x1018, "Identity", ObjectCode::Record, Unsigned32, &values);
        let usages: Vec<(&'static str, &[u8])> =
            [&[1], &[2], &[3], &[4]].map(|usage: &[u8; 1]| ("Sync manager type", &usage[..])).into();
        self.add_list(0x1C00, "Sync manager types", ObjectCode::Array, Unsigned8, &usages);
    }

    fn store(&mut self, bytes: &[u8], capacity: usize) -> Value {
        let start = self.values.len();
        self.values.extend_from_slice(bytes);
        self.values.resize(start + capacity.max(bytes.len()), 0);
        Value::Stored { start, len: bytes.len() }
    }

    fn entry_of(
        &mut self,
        subindex: u8,
        name: &'static str,
        data_type: DataType,
        value: &[u8],
    ) -> DictionaryEntry {
        let bits = value.len() * 8;
        let value = self.store(value, value.len());
        DictionaryEntry {
            subindex,
            name: name.into(),
            data_type,
            bits,
            access: Access::ReadOnly,
            value,
            unmapped: value,
            mappable: (false, false),
        }
    }

    fn add_variable(&mut self, index: u16, name: &'static str, data_type: DataType, value: &[u8]) {
        let entries = vec![self.entry_of(0, name, data_type, value)];
        self.objects.push(DictionaryObject { index, name, code: ObjectCode::Variable, entries });
    }

    /// Adds an array or record of values that cannot be written.
    fn add_list(
        &mut self,
        index: u16,
        name: &'static str,
        code: ObjectCode,
        data_type: DataType,
        values: &[(&'static str, &[u8])],
    ) {
        let count = values.len().min(255) as u8;
        let mut entries = vec![self.entry_of(0, "Highest subindex", DataType::Unsigned8, &[count])];
        for (subindex, (name, value)) in (1..=255).zip(values) {
            entries.push(self.entry_of(subindex, name, data_type, value));
        }
        self.objects.push(DictionaryObject { index, name, code, entries });
    }

    fn add_described(&mut self, object: &Object) {
        let entries = object.entries.iter().map(|entry| self.described(entry)).collect();
        let Object { index, name, code, .. } = *object;
        self.objects.push(DictionaryObject { index, name, code, entries });
    }

    fn described(&mut self, entry: &Entry) -> DictionaryEntry {
        let Entry { subindex, name, data_type, access, capacity, default } = *entry;
        let default = default.get(..default.len().min(capacity)).unwrap_or_default();
        let mut value = self.store(default, capacity);
        if let Value::Stored { len, .. } = &mut value
            && !data_type.is_string()
        {
            *len = capacity;
        }
        let bits = capacity * 8;
        let (unmapped, mappable) = (value, (false, false));
        DictionaryEntry { subindex, name: name.into(), data_type, bits, access, value, unmapped, mappable }
    }

    /// Returns all objects, indices ascending.
    pub(crate) fn objects(&self) -> &[DictionaryObject] {
        &self.objects
    }

    pub(crate) fn object(&self, index: u16) -> Result<&DictionaryObject, AbortCode> {
        let found = self.objects.binary_search_by_key(&index, |object| object.index);
        found.ok().and_then(|at| self.objects.get(at)).ok_or(AbortCode::NO_OBJECT)
    }

    pub(crate) fn entry(&self, index: u16, subindex: u8) -> Result<&DictionaryEntry, AbortCode> {
        self.object(index)?.entry(subindex).ok_or(AbortCode::NO_SUBINDEX)
    }

    /// Appends an entry's value to `target`.
    pub(crate) fn read(&self, entry: &DictionaryEntry, process: &ProcessData<'_>, target: &mut Vec<u8>) {
        let start = target.len();
        let (source, bit) = match entry.value {
            Value::Stored { start, len } => {
                target.extend_from_slice(self.values.get(start..start + len).unwrap_or_default());
                return;
            }
            Value::Input { bit } => (process.inputs, bit),
            Value::Output { bit } => (&*process.outputs, bit),
        };
        target.resize(start + entry.capacity(), 0);
        if let Some(target) = target.get_mut(start..) {
            crate::esc::copy_bits(source, bit, target, 0, entry.bits);
        }
    }

    /// Writes an entry by SDO: one that is mapped into the outputs, too, until process data overwrite it in OP.
    pub(crate) fn write(
        &mut self,
        index: u16,
        subindex: u8,
        data: &[u8],
        state: AlState,
        outputs: &mut [u8],
    ) -> Result<(), AbortCode> {
        if let Some(configured) = self.configure(index, subindex, data, state) {
            return configured;
        }
        let entry = self.entry(index, subindex)?;
        match entry.access {
            Access::ReadOnly => return Err(AbortCode::READ_ONLY),
            Access::WriteInPreOp if state != AlState::PreOp => return Err(AbortCode::WRONG_STATE),
            _ => {}
        }
        let capacity = entry.capacity();
        if data.len() > capacity {
            return Err(AbortCode::TOO_LONG);
        }
        if data.len() < capacity && !entry.data_type.is_string() {
            return Err(AbortCode::TOO_SHORT);
        }
        if let Access::WriteOneOf(numbers) = entry.access
            && !numbers.iter().any(|number| number.to_le_bytes().get(..data.len()) == Some(data))
        {
            return Err(AbortCode::VALUE_RANGE);
        }
        match entry.value {
            Value::Stored { .. } => self.set(index, subindex, data).ok_or(AbortCode::GENERAL),
            Value::Output { bit } if state != AlState::Op => {
                crate::esc::copy_bits(data, 0, outputs, bit, entry.bits);
                Ok(())
            }
            Value::Output { .. } | Value::Input { .. } => Err(AbortCode::WRONG_STATE),
        }
    }

    /// Sets a value, even one that the MainDevice may not write. `None` if there is no such value, or no room, or if the
    /// object configures process data.
    pub(crate) fn set(&mut self, index: u16, subindex: u8, data: &[u8]) -> Option<()> {
        if configures(index) { None } else { self.store_value(index, subindex, data) }
    }

    pub(crate) fn store_value(&mut self, index: u16, subindex: u8, data: &[u8]) -> Option<()> {
        let at = self.objects.binary_search_by_key(&index, |object| object.index).ok()?;
        let object = self.objects.get_mut(at)?;
        let entry = object.entries.iter_mut().find(|entry| entry.subindex == subindex)?;
        let capacity = entry.capacity();
        let Value::Stored { start, len } = &mut entry.value else { return None };
        let fits = data.len() == capacity || (entry.data_type.is_string() && data.len() < capacity);
        let room = self.values.get_mut(*start..*start + data.len()).filter(|_| fits)?;
        room.copy_from_slice(data);
        *len = data.len();
        Some(())
    }

    /// Returns the value of an entry that is not mapped.
    pub(crate) fn get(&self, index: u16, subindex: u8) -> Option<&[u8]> {
        match self.entry(index, subindex).ok()?.value {
            Value::Stored { start, len } => self.values.get(start..start + len),
            _ => None,
        }
    }
}
