//! From the IO-Device of a GSDML to the description that the stack takes.

use device_files::{ChosenIoDevice, ChosenModule, ChosenSubmodule};
use machine::Instant;
use profinet::description::{Description, INTERFACE_SUBSLOT, Identity, Module, Submodule};
use profinet::{Device, DeviceConfig, is_station_name};

use crate::config::{EmulationConfig, EmulationError};
use crate::faults::Alteration;
use crate::image::{DataPlace, Image};
use crate::leak;

/// Makes the IO-Device of a chosen device.
pub(crate) fn open(
    chosen: &ChosenIoDevice,
    alteration: &Alteration,
    config: &EmulationConfig,
    now: Instant,
) -> Result<(Device, Image, Image), EmulationError> {
    let description = describe(chosen, alteration, config.serial_number)?;
    let image = |length: fn(&Submodule) -> u16| {
        let mut places = Vec::new();
        let mut bit = 0;
        for (slot, submodule) in description.submodules().filter(|(_, submodule)| length(submodule) > 0) {
            let bits = 8 * usize::from(length(submodule));
            let place = format!("{slot}.{}", submodule.subslot);
            places.push(DataPlace { name: name_of(chosen, slot, submodule.subslot), place, bit, bits });
            bit += bits;
        }
        Image::new(places, true)
    };
    let (inputs, outputs) = (image(|it| it.input_len), image(|it| it.output_len));
    let station_name = station_name(chosen, config);
    let mut device = Device::new(
        DeviceConfig {
            mac: config.mac,
            station_name,
            // Kept in memory: what DCP sets permanently ends with the program, unless its owner stores it.
            permanent: Some(config.permanent.clone().unwrap_or_default()),
            address: config.address,
            mask: config.mask,
            description,
            controllers: alteration.peers(),
        },
        now,
    );
    device.accept_long_records();
    Ok((device, inputs, outputs))
}

/// Makes the description of a chosen device.
pub(crate) fn describe(
    chosen: &ChosenIoDevice,
    alteration: &Alteration,
    serial_number: u32,
) -> Result<Description, EmulationError> {
    let present = |module: &&ChosenModule| alteration.missing_slot != Some(module.slot) || module.slot == 0;
    let mut extra = alteration.extra_input_bytes();
    let mut modules = Vec::new();
    for module in chosen.modules.iter().filter(present) {
        let mut submodules = Vec::new();
        for submodule in &module.submodules {
            let longer = if submodule.input_length > 0 { std::mem::take(&mut extra) } else { 0 };
            submodules.push(part(module.slot, submodule, longer)?);
        }
        modules.push(Module { slot: module.slot, ident: module.ident, submodules: leak::list(submodules) });
    }
    Ok(Description {
        identity: Identity {
            vendor: chosen.vendor_id,
            device: chosen.device_id.wrapping_add(u16::from(alteration.is_other_identity)),
        },
        station_type: leak::text(&leak::ascii(&chosen.name), 25),
        order_id: leak::text(&leak::ascii(&chosen.order_number), 20),
        serial_number: leak::text(&serial_number.to_string(), 16),
        hardware_revision: first_number(&chosen.hardware_release),
        software_revision: release(&chosen.software_release),
        min_device_interval: chosen.min_device_interval,
        modules: leak::list(modules),
    })
}

/// Returns the station name: the given one, or the maker's, if it is one; else none.
fn station_name(chosen: &ChosenIoDevice, config: &EmulationConfig) -> Vec<u8> {
    let of_file = chosen.station_name.to_lowercase();
    let name = config.station_name.clone().unwrap_or_else(|| of_file.into_bytes());
    if is_station_name(&name) { name } else { Vec::new() }
}

fn name_of(chosen: &ChosenIoDevice, slot: u16, subslot: u16) -> String {
    let module = chosen.modules.iter().find(|module| module.slot == slot);
    let submodule = module.and_then(|module| module.submodules.iter().find(|it| it.subslot == subslot));
    let module = module.map_or("", |module| &module.name);
    match submodule.map_or("", |submodule| &submodule.name) {
        "" => module.to_owned(),
        name if name == module => name.to_owned(),
        name => format!("{module}: {name}"),
    }
}

fn part(slot: u16, submodule: &ChosenSubmodule, longer: u16) -> Result<Submodule, EmulationError> {
    let subslot = submodule.subslot;
    if submodule.api != 0 {
        return Err(EmulationError::OtherApi { slot, subslot, api: submodule.api });
    }
    if submodule.has_data() && submodule.status_lengths != (1, 1) {
        return Err(EmulationError::StatusLength { slot, subslot });
    }
    let records = submodule.records.iter().map(|record| record.index);
    // The stack has the records of interface and ports itself.
    let own = if subslot >= INTERFACE_SUBSLOT { Vec::new() } else { records.collect() };
    Ok(Submodule {
        subslot,
        ident: submodule.ident,
        input_len: submodule.input_length.saturating_add(longer),
        output_len: submodule.output_length,
        parameters: leak::list(own),
    })
}

/// Returns the first number of a release such as `V1.2.3`; 0 without one.
fn first_number(release: &str) -> u16 {
    let digits: String =
        release.chars().skip_while(|it| !it.is_ascii_digit()).take_while(char::is_ascii_digit).collect();
    digits.parse().unwrap_or(0)
}

fn release(release: &str) -> [u8; 3] {
    let mut numbers = [0; 3];
    let parts = release.split(|it: char| !it.is_ascii_digit()).filter(|part| !part.is_empty());
    numbers.iter_mut().zip(parts).for_each(|(number, part)| *number = part.parse().unwrap_or(0));
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_release_in_any_form_has_its_numbers() {
        assert_eq!(release("V1.2.3"), [1, 2, 3]);
        assert_eq!(release("V04.00"), [4, 0, 0]);
        assert_eq!((release("x"), release("V999.1")), ([0; 3], [0, 1, 0]));
        assert_eq!((first_number("FS 12"), first_number(""), first_number("99999")), (12, 0, 0));
    }
}
