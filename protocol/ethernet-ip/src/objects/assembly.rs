//! Assembly, class 04: the data of the connections (volume 1, 5-5).

use super::super::Writer;
use super::super::cip::Violation;
use super::super::description::Role;
use super::{Device, Object};

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
        let data: &[u8] = match assembly.role {
            Role::Produced => &device.produced,
            Role::Consumed => &device.consumed,
            _ => &[],
        };
        match attribute {
            3 => writer.bytes(data.get(..usize::from(assembly.size)).unwrap_or_default()),
            4 => writer.u16(assembly.size),
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }

    /// An arm moves by the will of the one owner of its outputs, never by that of whoever sends a message; and the
    /// other assemblies hold nothing that could be set.
    fn set(device: &mut Device, instance: u32, attribute: u16, data: &[u8]) -> Result<(), Violation> {
        let role = device.description.assembly(instance).map(|assembly| assembly.role);
        match (role, attribute) {
            (Some(Role::Configuration), 3) if data.is_empty() => Ok(()),
            (Some(Role::Configuration), 3) => Err(Violation::TooLong),
            _ => Err(Violation::NotSettable),
        }
    }
}
