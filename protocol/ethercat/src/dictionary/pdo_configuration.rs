//! Process data that the MainDevice chooses in PRE-OP (ETG.1000.6, CoE communication area): which process data objects it
//! assigns to a sync manager, and which entries it maps into an object.
//!
//! ```text
//! 0x1C12, 0x1C13                 assigned objects of outputs, of inputs
//! 0x1600..0x1800, 0x1A00..0x1C00 entries of an object, each u32: index << 16 | subindex << 8 | bits; index 0 is a gap
//! subindex 0                     how many of the following count; 0 while they are changed
//! ```
//!
//! The chosen process data must not be longer than the described ones with all optional entries, because the buffers of the
//! sync managers have fixed places.

use alloc::vec::Vec;

use crate::abort_code::AbortCode;
use crate::al::AlState;
use crate::description::PdoEntry;
use crate::layout::Usage;

use super::Dictionary;

/// Which parts of a device's process data the MainDevice may choose.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum PdoConfiguration {
    /// Nothing: they are as described.
    #[default]
    Fixed,
    /// Which of the described objects are assigned, and in which order.
    Assignable,
    /// Besides, which of the described and optional entries of its direction each object has, and in which order.
    Mappable,
}

/// How an object of the dictionary configures process data.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Role {
    Assignment,
    Mapping,
}

const ASSIGNED_OUTPUTS: u16 = 0x1C12;
const ASSIGNED_INPUTS: u16 = 0x1C13;

/// Returns direction and role of an object that configures process data; `None` for another one.
const fn role_of(index: u16) -> Option<(Usage, Role)> {
    match index {
        ASSIGNED_OUTPUTS => Some((Usage::Outputs, Role::Assignment)),
        ASSIGNED_INPUTS => Some((Usage::Inputs, Role::Assignment)),
        0x1600..=0x17FF => Some((Usage::Outputs, Role::Mapping)),
        0x1A00..=0x1BFF => Some((Usage::Inputs, Role::Mapping)),
        _ => None,
    }
}

/// Returns whether an object configures process data.
pub(crate) const fn configures(index: u16) -> bool {
    role_of(index).is_some()
}

/// An entry as a mapping object names it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Mapping {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    pub(crate) bits: u8,
}

impl Mapping {
    const fn of([bits, subindex, low, high]: [u8; 4]) -> Self {
        Self { index: u16::from_le_bytes([low, high]), subindex, bits }
    }

    pub(crate) fn is(self, entry: &PdoEntry) -> bool {
        (self.index, self.subindex, self.bits) == (entry.index, entry.subindex, entry.bits)
    }
}

impl Dictionary {
    /// Writes an object that configures process data. Returns `None` for another object.
    pub(crate) fn configure(
        &mut self,
        index: u16,
        subindex: u8,
        data: &[u8],
        state: AlState,
    ) -> Option<Result<(), AbortCode>> {
        let (usage, role) = role_of(index)?;
        Some(match (self.is_chosen_by_main_device(index), state) {
            (false, _) => self.entry(index, subindex).and(Err(AbortCode::READ_ONLY)),
            (true, AlState::PreOp) => self.choose((usage, role), index, subindex, data),
            (true, _) => Err(AbortCode::WRONG_STATE),
        })
    }

    /// Returns whether an object configures process data, and the MainDevice may write it.
    pub(crate) fn is_chosen_by_main_device(&self, index: u16) -> bool {
        role_of(index).is_some_and(|(_, role)| match self.configuration() {
            PdoConfiguration::Fixed => false,
            PdoConfiguration::Assignable => role == Role::Assignment,
            PdoConfiguration::Mappable => true,
        })
    }

    /// Writes all entries from a subindex on: they take effect once the last one is written. If they are refused, the
    /// entries before them stay.
    pub(crate) fn configure_whole(
        &mut self,
        index: u16,
        values: &[(u8, &[u8])],
        state: AlState,
    ) -> Result<(), AbortCode> {
        let before = self.values().to_vec();
        let write = |dictionary: &mut Self| {
            dictionary.configure(index, 0, &[0], state).unwrap_or(Err(AbortCode::GENERAL))?;
            let is_chosen =
                |(number, value): &&(u8, &[u8])| *number > 0 && value.iter().any(|byte| *byte != 0);
            for (number, value) in values.iter().filter(is_chosen) {
                dictionary.configure(index, *number, value, state).unwrap_or(Err(AbortCode::GENERAL))?;
            }
            let count = values.iter().find(|(number, _)| *number == 0);
            let (_, count) = count.ok_or(AbortCode::NO_COMPLETE_ACCESS)?;
            dictionary.configure(index, 0, count, state).unwrap_or(Err(AbortCode::GENERAL))
        };
        let written = write(self);
        if written.is_err() {
            self.restore(&before);
        }
        written
    }

    fn choose(
        &mut self,
        (usage, role): (Usage, Role),
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        let capacity = self.entry(index, subindex)?.capacity();
        match data.len() {
            len if len > capacity => return Err(AbortCode::TOO_LONG),
            len if len < capacity => return Err(AbortCode::TOO_SHORT),
            _ => {}
        }
        if subindex > 0 {
            if self.count(index) > 0 {
                return Err(AbortCode::COUNT_NOT_ZERO);
            }
            self.check_choice(usage, role, data)?;
            self.is_rechosen = true;
            return self.store_value(index, subindex, data).ok_or(AbortCode::GENERAL);
        }
        let before = self.count(index);
        self.is_rechosen = true;
        self.store_value(index, 0, data).ok_or(AbortCode::GENERAL)?;
        let checked = self.check_count(usage, role, index);
        if checked.is_err() {
            self.store_value(index, 0, &[before]).ok_or(AbortCode::GENERAL)?;
        }
        checked
    }

    /// Checks that an object is one of this direction, or an entry one that can be mapped in it.
    fn check_choice(&self, usage: Usage, role: Role, data: &[u8]) -> Result<(), AbortCode> {
        let (pdos, optional) = self.description().mappable(usage);
        let known = match (role, data) {
            (Role::Assignment, [low, high]) => {
                pdos.iter().any(|pdo| pdo.index == u16::from_le_bytes([*low, *high]))
            }
            (Role::Mapping, [a, b, c, d]) => {
                let mapping = Mapping::of([*a, *b, *c, *d]);
                // Index 0 is a gap; so are, in outputs, the dummy entries 1 to 7, which are numbers of data types (CiA 301).
                let gaps = if usage == Usage::Outputs { 0..=7 } else { 0..=0 };
                let is_gap = gaps.contains(&mapping.index) && mapping.subindex == 0 && mapping.bits > 0;
                let mut entries = pdos.iter().flat_map(|pdo| pdo.entries).chain(optional);
                is_gap || entries.any(|entry| mapping.is(entry))
            }
            _ => false,
        };
        if known { Ok(()) } else { Err(AbortCode::NOT_MAPPABLE) }
    }

    /// Checks that what is chosen now is not empty, contains no object twice, and fits.
    fn check_count(&self, usage: Usage, role: Role, index: u16) -> Result<(), AbortCode> {
        let count = self.count(index);
        if self.object(index)?.entry(count).is_none() {
            return Err(AbortCode::TOO_MUCH_TO_MAP);
        }
        let chosen: Vec<&[u8]> = (1..=count).filter_map(|subindex| self.get(index, subindex)).collect();
        let is_empty = |value: &&[u8]| value.iter().all(|byte| *byte == 0);
        let is_twice = |at: usize, value: &&[u8]| {
            role == Role::Assignment && chosen.iter().take(at).any(|one| one == value)
        };
        if chosen.iter().enumerate().any(|(at, value)| is_empty(value) || is_twice(at, value)) {
            return Err(AbortCode::NOT_MAPPABLE);
        }
        let room = self.description().room(usage);
        if self.process_data_len(usage) > room { Err(AbortCode::TOO_MUCH_TO_MAP) } else { Ok(()) }
    }

    /// Returns how many objects are assigned, or how many entries an object has: the value at subindex 0.
    pub(crate) fn count(&self, index: u16) -> u8 {
        self.get(index, 0).and_then(<[u8]>::first).copied().unwrap_or(0)
    }

    /// Returns the process data of a direction as the MainDevice has chosen them, in the order of their bits.
    pub(crate) fn mappings(&self, usage: Usage) -> impl Iterator<Item = Mapping> + '_ {
        let assignment = if usage == Usage::Outputs { ASSIGNED_OUTPUTS } else { ASSIGNED_INPUTS };
        let pdos = (1..=self.count(assignment)).filter_map(move |number| {
            let pdo = self.get(assignment, number)?.first_chunk().copied()?;
            Some(u16::from_le_bytes(pdo))
        });
        pdos.flat_map(move |pdo| {
            (1..=self.count(pdo))
                .filter_map(move |number| Some(Mapping::of(self.get(pdo, number)?.first_chunk().copied()?)))
        })
    }

    /// Returns their length in bytes.
    pub(crate) fn process_data_len(&self, usage: Usage) -> u16 {
        let bits: u32 = self.mappings(usage).map(|mapping| u32::from(mapping.bits)).sum();
        u16::try_from(bits.div_ceil(8)).unwrap_or(u16::MAX)
    }
}
