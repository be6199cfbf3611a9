//! The entries that process data show: where their values are now, and the objects that follow from the process data.

use alloc::vec;
use alloc::vec::Vec;

use super::{Dictionary, DictionaryEntry, DictionaryObject, PdoConfiguration, Value, configures};
use crate::description::{Access, DataType, ObjectCode, PdoEntry};
use crate::esc::copy_bits;
use crate::layout::Usage;

/// Entries that a mapping object has room for, where the MainDevice may map other ones than the described (as the drives of
/// several makers).
const MAPPABLE_ENTRIES: usize = 32;

/// Longest value in bytes of those that are handled as numbers.
const NUMBER_LEN: usize = 8;

/// An entry of process data, by index and subindex, with its value.
type Number = (u16, u8, u64);

impl Dictionary {
    /// Adds the mapping objects of process data, and their assignment to a sync manager.
    pub(super) fn add_pdos(&mut self, usage: Usage, assignment: u16, name: &'static str) {
        let (pdos, optional) = self.description().mappable(usage);
        let is_open = self.configuration() == PdoConfiguration::Mappable && !optional.is_empty();
        for pdo in pdos {
            let mut mappings: Vec<[u8; 4]> = pdo
                .entries
                .iter()
                .map(|entry| {
                    let [low, high] = entry.index.to_le_bytes();
                    [entry.bits, entry.subindex, low, high]
                })
                .collect();
            let count = mappings.len().min(255) as u8;
            if is_open {
                mappings.resize(mappings.len().max(MAPPABLE_ENTRIES), [0; 4]);
            }
            let values: Vec<(&'static str, &[u8])> =
                mappings.iter().map(|mapping| ("Mapping", &mapping[..])).collect();
            self.add_list(pdo.index, pdo.name, ObjectCode::Record, DataType::Unsigned32, &values);
            self.store_last_count(count);
        }
        let indices: Vec<[u8; 2]> = pdos.iter().map(|pdo| pdo.index.to_le_bytes()).collect();
        let values: Vec<(&'static str, &[u8])> = indices.iter().map(|index| ("PDO", &index[..])).collect();
        self.add_list(assignment, name, ObjectCode::Array, DataType::Unsigned16, &values);
    }

    /// Sets how many entries of the object that was added last count.
    fn store_last_count(&mut self, count: u8) {
        let first = self.objects.last().and_then(|object| object.entry(0));
        if let Some(Value::Stored { start, .. }) = first.map(|first| first.value)
            && let Some(value) = self.values.get_mut(start)
        {
            *value = count;
        }
    }

    /// Adds the objects that process data name and the description does not have.
    pub(super) fn add_mapped(&mut self, usage: Usage) {
        let (pdos, optional) = self.description().mappable(usage);
        for entry in pdos.iter().flat_map(|pdo| pdo.entries) {
            self.add_mapped_entry(entry, usage);
        }
        if self.configuration() == PdoConfiguration::Mappable {
            optional.iter().for_each(|entry| self.add_mapped_entry(entry, usage));
        }
    }

    fn add_mapped_entry(&mut self, entry: &PdoEntry, usage: Usage) {
        let outputs = usage == Usage::Outputs;
        let access = if outputs { Access::ReadWrite } else { Access::ReadOnly };
        let bits = usize::from(entry.bits);
        // Index 0 is a gap. Files that map a mapping object into itself mean data without an object: the MainDevice reads the mapping.
        if entry.index == 0 || configures(entry.index) {
            return;
        }
        let position = self.objects.iter().position(|object| object.index == entry.index);
        let position = position.unwrap_or_else(|| {
            self.add_mapped_object(entry);
            self.objects.len() - 1
        });
        let entries = self.objects.get_mut(position).map(|object| &mut object.entries);
        let mut entries = entries.into_iter().flatten();
        if let Some(known) = entries.find(|known| known.subindex == entry.subindex) {
            let (input, output) = known.mappable;
            known.mappable = (input || !outputs, output || outputs);
            return;
        }
        let own = self.store(&vec![0; bits.div_ceil(8)], 0);
        let name = self.description().full_name(entry);
        let Some(object) = self.objects.get_mut(position) else { return };
        let mapped = DictionaryEntry {
            subindex: entry.subindex,
            name,
            data_type: entry.data_type,
            bits,
            access,
            value: own,
            unmapped: own,
            mappable: (!outputs, outputs),
        };
        object.entries.push(mapped);
        self.raise_highest_subindex(position, entry.subindex);
    }

    /// Adds the object of an entry. A variable has the name of its entry.
    fn add_mapped_object(&mut self, entry: &PdoEntry) {
        let (code, name, entries) = match entry.subindex {
            0 => (ObjectCode::Variable, entry.name, Vec::new()),
            _ => {
                let first = self.entry_of(0, "Highest subindex", DataType::Unsigned8, &[0]);
                (ObjectCode::Record, "Process data", vec![first])
            }
        };
        self.objects.push(DictionaryObject { index: entry.index, name, code, entries });
    }

    fn raise_highest_subindex(&mut self, position: usize, subindex: u8) {
        let first = self.objects.get(position).and_then(|object| object.entry(0));
        if let Some(Value::Stored { start, len: 1 }) = first.map(|first| first.value)
            && let Some(highest) = self.values.get_mut(start)
        {
            *highest = (*highest).max(subindex);
        }
    }

    /// Connects the entries that are mapped into process data with their place there, and all others with their own values.
    pub(crate) fn map_process_data(&mut self) {
        for entry in self.objects.iter_mut().flat_map(|object| &mut object.entries) {
            entry.value = entry.unmapped;
        }
        self.is_as_described = true;
        for usage in [Usage::Outputs, Usage::Inputs] {
            let mut bit = 0;
            let mappings: Vec<_> = self.mappings(usage).collect();
            let described = self.description().mappable(usage).0.iter().flat_map(|pdo| pdo.entries);
            let same =
                mappings.iter().copied().zip(described.clone()).all(|(mapping, entry)| mapping.is(entry));
            self.is_as_described &= same && mappings.len() == described.count();
            for mapping in mappings {
                let value =
                    if usage == Usage::Outputs { Value::Output { bit } } else { Value::Input { bit } };
                bit += usize::from(mapping.bits);
                if configures(mapping.index) {
                    continue;
                }
                if let Some(entry) = self.entry_mut(mapping.index, mapping.subindex) {
                    (entry.value, entry.bits) = (value, mapping.bits.into());
                }
            }
        }
    }

    /// Returns whether process data have the described entries in their order.
    pub(crate) const fn is_as_described(&self) -> bool {
        self.is_as_described
    }

    /// Returns an entry's value as a number without sign, wherever it is now; `None` if it is longer than 64 bits, or not there.
    pub(crate) fn number(&self, index: u16, subindex: u8, inputs: &[u8], outputs: &[u8]) -> Option<u64> {
        let entry = self.entry(index, subindex).ok()?;
        let mut number = [0; NUMBER_LEN];
        let (source, bit) = match entry.value {
            Value::Stored { start, len } => {
                number.get_mut(..len)?.copy_from_slice(self.values.get(start..start + len)?);
                return Some(u64::from_le_bytes(number));
            }
            Value::Input { bit } => (inputs, bit),
            Value::Output { bit } => (outputs, bit),
        };
        if entry.capacity() > NUMBER_LEN || bit + entry.bits > 8 * source.len() {
            return None;
        }
        copy_bits(source, bit, &mut number, 0, entry.bits);
        Some(u64::from_le_bytes(number))
    }

    /// Sets an entry's value, wherever it is now, to a number, of which the entry takes as many bits as it has. Returns whether
    /// it is in the inputs; `None` for an unknown entry, or one longer than 64 bits.
    pub(crate) fn set_number(
        &mut self,
        (index, subindex, number): Number,
        inputs: &mut [u8],
        outputs: &mut [u8],
    ) -> Option<bool> {
        let entry = self.entry(index, subindex).ok()?;
        let bytes = number.to_le_bytes();
        let (bits, value) = (entry.bits, entry.value);
        let fitting = bytes.get(..entry.capacity())?;
        match value {
            Value::Stored { .. } => self.store_value(index, subindex, fitting)?,
            Value::Input { bit } => copy_bits(fitting, 0, inputs, bit, bits),
            Value::Output { bit } => copy_bits(fitting, 0, outputs, bit, bits),
        }
        Some(matches!(value, Value::Input { .. }))
    }

    /// Returns the values of all entries that can be mapped.
    pub(crate) fn mappable_numbers(&self, inputs: &[u8], outputs: &[u8]) -> Vec<Number> {
        let entries =
            self.objects.iter().flat_map(|object| object.entries.iter().map(|entry| (object.index, entry)));
        entries
            .filter(|(_, entry)| entry.mappable != (false, false))
            .filter_map(|(index, entry)| {
                Some((index, entry.subindex, self.number(index, entry.subindex, inputs, outputs)?))
            })
            .collect()
    }
}
