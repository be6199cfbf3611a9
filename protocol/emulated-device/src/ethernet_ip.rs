//! From the adapter of an EDS to the description that the stack takes.

use device_files::{ChosenAdapter, ChosenAssembly, HeartbeatUse};
use ethernet_ip::cip::Revision;
use ethernet_ip::description::{Assembly, Description, Role};
use ethernet_ip::{Adapter, AdapterConfig};

use crate::config::{EmulationConfig, EmulationError};
use crate::faults::Alteration;
use crate::image::{DataPlace, Image};
use crate::leak;

/// Shortest packet interval of a file without one, in µs: what a process on Linux keeps.
const SHORTEST_RPI_US: u32 = 1_000;

/// Longest packet interval of a file without one, in µs.
const LONGEST_RPI_US: u32 = 10_000_000;

/// Longest product name (CIP volume 1, 5-2.2.1.7).
const LONGEST_NAME: usize = 32;

/// Makes the adapter of a chosen device.
pub(crate) fn open(
    chosen: &ChosenAdapter,
    alteration: &Alteration,
    config: &EmulationConfig,
) -> Result<(Adapter, Image, Image), EmulationError> {
    let address = config.address.ok_or(EmulationError::NoAddress)?;
    let description = describe(chosen, alteration);
    let produced = altered(&chosen.produced, alteration.extra_input_bytes());
    let adapter = Adapter::new(AdapterConfig {
        description: Box::leak(Box::new(description)),
        serial_number: config.serial_number,
        address,
        mask: config.mask,
        gateway: config.gateway,
        mac: config.mac.0,
        first_id: config.first_id.wrapping_add(alteration.generation << 16),
        originators: alteration.peers(),
    });
    let place = |it: &ChosenAssembly| DataPlace {
        place: it.instance.to_string(),
        name: it.name.clone(),
        bit: 0,
        bits: 8 * usize::from(it.size),
    };
    let inputs = Image::new(vec![place(&produced)], false);
    let outputs = Image::new(chosen.consumed.iter().map(place).collect(), false);
    Ok((adapter, inputs, outputs))
}

/// Makes the description of a chosen device.
pub(crate) fn describe(chosen: &ChosenAdapter, alteration: &Alteration) -> Description {
    let produced = altered(&chosen.produced, alteration.extra_input_bytes());
    let role = if produced.has_header { Role::ProducedWithHeader } else { Role::Produced };
    let mut assemblies = vec![assembly(&produced, role)];
    if let Some(consumed) = &chosen.consumed {
        let role = if consumed.has_header { Role::Consumed } else { Role::ConsumedModeless };
        assemblies.push(assembly(consumed, role));
    }
    assemblies.extend(chosen.configuration.as_ref().map(|it| assembly(it, Role::Configuration)));
    for (instance, heartbeat) in &chosen.heartbeats {
        let (role, name) = match heartbeat {
            HeartbeatUse::InputOnly => (Role::InputOnlyHeartbeat, "Input-only heartbeat"),
            HeartbeatUse::ListenOnly => (Role::ListenOnlyHeartbeat, "Listen-only heartbeat"),
        };
        assemblies.push(Assembly { instance: *instance, role, size: 0, name });
    }
    // Instances of several roles are one assembly, of the first role.
    let mut seen = Vec::new();
    assemblies.retain(|it| {
        !seen.contains(&it.instance) && {
            seen.push(it.instance);
            true
        }
    });
    Description {
        vendor: chosen.vendor_id,
        vendor_name: leak::text(&chosen.vendor, usize::MAX),
        device_type: chosen.device_type,
        product_code: chosen.product_code.wrapping_add(u16::from(alteration.is_other_identity)),
        revision: Revision { major: chosen.revision.0, minor: chosen.revision.1 },
        product_name: leak::text(&leak::ascii(&chosen.product_name), LONGEST_NAME),
        assemblies: leak::list(assemblies),
        min_rpi_us: chosen.min_rpi_us.unwrap_or(SHORTEST_RPI_US),
        max_rpi_us: chosen.max_rpi_us.unwrap_or(LONGEST_RPI_US),
        exclusive_owners: 1,
        input_only: 8,
        listen_only: 8,
        explicit: 8,
        sessions: 16,
    }
}

fn altered(assembly: &ChosenAssembly, extra: u16) -> ChosenAssembly {
    ChosenAssembly { size: assembly.size.saturating_add(extra), ..assembly.clone() }
}

fn assembly(chosen: &ChosenAssembly, role: Role) -> Assembly {
    let name = leak::text(&chosen.name, usize::MAX);
    Assembly { instance: chosen.instance, role, size: chosen.size, name }
}
