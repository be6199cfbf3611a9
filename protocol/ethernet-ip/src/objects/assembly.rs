//! Assembly, class 04: the data of the connections (volume 1, 5-5).

use super::super::Writer;
use super::super::cip::Violation;
use super::super::data::DataError;
use super::super::description::{Description, Role};
use super::{Device, Object};
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use core::cmp::Ordering;

/// Replaces data by others of the same length. Returns whether they changed.
fn replace(place: &mut [u8], data: &[u8]) -> bool {
    let is_changed = *place != *data;
    place.copy_from_slice(data);
    is_changed
}

/// Data of the assemblies that connections carry, and of those that configure the device.
#[derive(Debug)]
pub(in super::super) struct AssemblyData {
    all: Vec<CarriedAssembly>,
}

#[derive(Debug)]
struct CarriedAssembly {
    instance: u32,
    role: Role,
    data: Box<[u8]>,
}

impl AssemblyData {
    /// Creates assemblies full of zeros.
    pub(super) fn new(description: &Description) -> Self {
        let carried = description
            .assemblies
            .iter()
            .filter(|a| a.role.is_produced() || a.role.is_consumed() || a.role == Role::Configuration);
        let zeros = |size: u16| vec![0; usize::from(size)].into_boxed_slice();
        let carry = |a: &super::super::description::Assembly| CarriedAssembly {
            instance: a.instance,
            role: a.role,
            data: zeros(a.size),
        };
        Self { all: carried.map(carry).collect() }
    }

    /// Returns the data of an assembly; empty for an assembly without data.
    pub(in super::super) fn get(&self, instance: u32) -> &[u8] {
        self.all.iter().find(|found| found.instance == instance).map_or(&[], |found| &found.data)
    }

    /// Sets the data of an assembly that is sent. Returns whether they changed.
    pub(in super::super) fn set(&mut self, instance: u32, data: &[u8]) -> Result<bool, DataError> {
        let found = self.produced(instance)?;
        if found.len() != data.len() {
            return Err(DataError::Length { expected: found.len(), found: data.len() });
        }
        Ok(replace(found, data))
    }

    /// Sets the first data of an assembly that the device produces. Returns whether they changed.
    pub(in super::super) fn set_start(&mut self, instance: u32, data: &[u8]) -> Result<bool, DataError> {
        let found = self.produced(instance)?;
        let expected = found.len();
        let start = found.get_mut(..data.len()).ok_or(DataError::Length { expected, found: data.len() })?;
        Ok(replace(start, data))
    }

    fn produced(&mut self, instance: u32) -> Result<&mut [u8], DataError> {
        let is_it = |found: &&mut CarriedAssembly| found.instance == instance && found.role.is_produced();
        let found = self.all.iter_mut().find(is_it).ok_or(DataError::NotProduced { instance })?;
        Ok(&mut found.data)
    }

    /// Returns the data of a configuration assembly.
    pub(in super::super) fn configuration(&self, instance: u32) -> Option<&[u8]> {
        let is_it =
            |found: &&CarriedAssembly| found.instance == instance && found.role == Role::Configuration;
        self.all.iter().find(is_it).map(|found| &*found.data)
    }

    /// Sets the data of the configuration assemblies to zeros.
    pub(super) fn restore_defaults(&mut self) {
        let all = self.all.iter_mut();
        all.filter(|found| found.role == Role::Configuration).for_each(|found| found.data.fill(0));
    }

    /// Takes the data of an assembly from its owner; data of another length are ignored.
    pub(in super::super) fn consume(&mut self, instance: u32, data: &[u8]) {
        let place = self.all.iter_mut().find(|found| found.instance == instance).map(|found| &mut found.data);
        if let Some(place) = place.filter(|place| place.len() == data.len()) {
            place.copy_from_slice(data);
        }
    }
}

pub(super) struct Assembly;

impl Object for Assembly {
    const REVISION: u16 = 2;
    const ATTRIBUTES: &'static [u16] = &[3, 4];
    const HAS_ALL: bool = false;

    fn max_instance(device: &Device) -> u32 {
        device.description.assemblies.iter().map(|assembly| assembly.instance).max().unwrap_or(0)
    }

    fn instances(device: &Device) -> usize {
        device.description.assemblies.len()
    }

    fn has(device: &Device, instance: u32) -> bool {
        device.description.assembly(instance).is_some()
    }

    fn get(device: &Device, instance: u32, attribute: u16, writer: &mut Writer<'_>) -> Result<(), Violation> {
        let assembly = device.description.assembly(instance).ok_or(Violation::UnknownInstance)?;
        match attribute {
            3 => writer.bytes(device.assemblies.get(instance)),
            4 => writer.u16(assembly.size),
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }

    /// Sets the data of a configuration assembly while no connection depends on them. Refuses every other change by a
    /// message: only the owner of the outputs may set them, and the other assemblies hold nothing that could be set.
    fn set(device: &mut Device, instance: u32, attribute: u16, data: &[u8]) -> Result<(), Violation> {
        let role = device.description.assembly(instance).map(|assembly| assembly.role);
        let (Some(Role::Configuration), 3) = (role, attribute) else { return Err(Violation::NotSettable) };
        let found = device.assemblies.get(instance);
        match data.len().cmp(&found.len()) {
            Ordering::Less => Err(Violation::TooShort),
            Ordering::Greater => Err(Violation::TooLong),
            Ordering::Equal if device.io.connections > 0 && found != data => Err(Violation::InUse),
            Ordering::Equal => {
                device.assemblies.consume(instance, data);
                Ok(())
            }
        }
    }
}
