//! Modules or connections of a robot's device file that carry the process image: 256 bytes each way.

use device_files::{
    AccessPoint, ChosenDevice, ConnectionUse, DeviceChoice, DeviceFile, Eds, Esi, Gsdml, GsdmlModule,
    Placement, choose, excerpt,
};
use protocol::image::IMAGE_LEN;

use crate::BusKind;

/// Most ways that are listed: a catalogue may have hundreds of modules that fit.
const MOST_LISTED: usize = 20;

/// Why the robot of a file cannot exchange the image.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum UnfitRobotFile {
    /// The file is of another bus than the setup.
    #[error(
        "the file describes a device of {found}, and the setup has {wanted}; use the robot's file for {wanted}"
    )]
    OtherBus {
        /// Bus of the file.
        found: &'static str,
        /// Bus of the setup.
        wanted: &'static str,
    },
    /// No device of an ESI is long enough.
    #[error(
        "no device with its default process data carries {IMAGE_LEN} bytes each way: at most {inputs} from and {outputs} to the robot; choose longer process data, or use another file"
    )]
    ShortProcessData {
        /// Longest data from the robot in bytes.
        inputs: u32,
        /// Longest data to the robot.
        outputs: u32,
    },
    /// No module of a GSDML is long enough.
    #[error(
        "no module carries {IMAGE_LEN} bytes each way: at most {inputs} from and {outputs} to the robot; use a file or option of the robot with longer modules"
    )]
    ShortModules {
        /// Longest input data of a submodule in bytes.
        inputs: u32,
        /// Longest output data.
        outputs: u32,
    },
    /// No connection of an EDS is long enough.
    #[error(
        "no exclusive-owner connection carries {IMAGE_LEN} bytes each way: at most {inputs} from and {outputs} to the robot; use a file with longer assemblies"
    )]
    ShortConnections {
        /// Longest data from the robot in bytes.
        inputs: u32,
        /// Longest data to the robot.
        outputs: u32,
    },
}

/// Returns what to plug or to choose in the engineering project, one way a line.
///
/// # Errors
///
/// The file is of another bus, or nothing in it carries the image.
pub fn ways_to_plug(file: &DeviceFile, bus: &BusKind) -> Result<Vec<String>, UnfitRobotFile> {
    match (file, bus) {
        (DeviceFile::Gsdml(gsdml), BusKind::Profinet(..)) => of_gsdml(gsdml).map(listed),
        (DeviceFile::Eds(eds), BusKind::EthernetIp(..)) => of_eds(eds).map(listed),
        (DeviceFile::Esi(esi), BusKind::Ethercat(_)) => of_esi(file, esi).map(listed),
        _ => Err(UnfitRobotFile::OtherBus { found: file.bus(), wanted: bus.name() }),
    }
}

fn listed(mut ways: Vec<String>) -> Vec<String> {
    let more = ways.len().saturating_sub(MOST_LISTED);
    ways.truncate(MOST_LISTED);
    if more > 0 {
        ways.push(format!("{more} more ways, which `plc-node describe` lists"));
    }
    ways
}

/// A submodule with data: length from and to the robot in bytes, and where it is plugged.
struct CarryingSubmodule {
    inputs: u32,
    outputs: u32,
    /// Module and submodule.
    names: String,
    slots: String,
}

const LEN: u32 = IMAGE_LEN as u32;

/// Returns the slots of a placement, for people.
fn places(placement: &Placement) -> String {
    let of = [&placement.fixed, &placement.used, &placement.allowed].map(ToString::to_string);
    let mut places: Vec<_> = of.into_iter().filter(|ranges| !ranges.is_empty()).collect();
    places.dedup();
    places.join(" ")
}

/// Returns the submodules of a module with their lengths.
fn carrying(gsdml: &Gsdml, module: &GsdmlModule, slots: &str) -> Vec<CarryingSubmodule> {
    let fixed = module.submodules.iter().map(|submodule| (submodule, String::new()));
    let pluggable = module.pluggable.iter().filter_map(|placement| {
        Some((gsdml.submodule(&placement.id)?, format!(" in subslot {}", places(placement))))
    });
    fixed
        .chain(pluggable)
        .filter(|(submodule, _)| !submodule.is_safety)
        .map(|(submodule, subslot)| CarryingSubmodule {
            inputs: submodule.inputs.length,
            outputs: submodule.outputs.length,
            names: format!(
                "`{}` (module 0x{:08X}, submodule 0x{:08X}{subslot})",
                excerpt(&module.name),
                module.ident,
                submodule.ident
            ),
            slots: slots.to_owned(),
        })
        .collect()
}

fn of_gsdml(gsdml: &Gsdml) -> Result<Vec<String>, UnfitRobotFile> {
    let mut ways = Vec::new();
    let (mut inputs, mut outputs) = (0, 0);
    for point in &gsdml.access_points {
        let mut all = carrying(gsdml, &point.module, &point.fixed_in_slots.to_string());
        for placement in &point.modules {
            let module = gsdml.module(&placement.id);
            all.extend(module.map(|module| carrying(gsdml, module, &places(placement))).unwrap_or_default());
        }
        inputs = inputs.max(all.iter().map(|one| one.inputs).max().unwrap_or(0));
        outputs = outputs.max(all.iter().map(|one| one.outputs).max().unwrap_or(0));
        if exceeds(point) {
            continue;
        }
        let name = excerpt(&point.module.name);
        ways.extend(ways_of(&all).into_iter().map(|way| format!("{name}: {way}")));
    }
    if ways.is_empty() { Err(UnfitRobotFile::ShortModules { inputs, outputs }) } else { Ok(ways) }
}

/// Returns whether two images are more than the access point exchanges.
fn exceeds(point: &AccessPoint) -> bool {
    let is_short = |most: Option<u32>, wanted: u32| most.is_some_and(|most| most < wanted);
    is_short(point.max_input_length, LEN)
        || is_short(point.max_output_length, LEN)
        || is_short(point.max_data_length, 2 * LEN)
}

/// Returns the modules that carry both directions, or else pairs of which each carries one.
fn ways_of(all: &[CarryingSubmodule]) -> Vec<String> {
    let lengths = |one: &CarryingSubmodule| {
        format!(
            "slot {}: {}, {} bytes from and {} to the robot",
            one.slots, one.names, one.inputs, one.outputs
        )
    };
    let both = all.iter().filter(|one| one.inputs >= LEN && one.outputs >= LEN);
    // The shortest ones first: bytes beyond the image stay unused.
    let mut both: Vec<_> = both.collect();
    both.sort_by_key(|one| one.inputs + one.outputs);
    if !both.is_empty() {
        return both.into_iter().map(lengths).collect();
    }
    let shortest = |length: fn(&CarryingSubmodule) -> u32| {
        all.iter().filter(|one| length(one) >= LEN).min_by_key(|one| one.inputs + one.outputs)
    };
    let pair = shortest(|one| one.inputs).zip(shortest(|one| one.outputs));
    pair.map(|(from, to)| format!("{}; and {}", lengths(from), lengths(to))).into_iter().collect()
}

fn of_eds(eds: &Eds) -> Result<Vec<String>, UnfitRobotFile> {
    let owners = eds.connections.iter().filter(|one| one.uses.contains(&ConnectionUse::ExclusiveOwner));
    // Without a size the originator chooses it.
    let carries = |size: Option<u32>| size.is_none_or(|size| size >= LEN);
    let mut ways = Vec::new();
    let (mut inputs, mut outputs) = (0, 0);
    for connection in owners {
        let (from, to) = (connection.t_to_o.size, connection.o_to_t.size);
        (inputs, outputs) = (inputs.max(from.unwrap_or(0)), outputs.max(to.unwrap_or(0)));
        if carries(from) && carries(to) {
            let bytes = |size: Option<u32>| {
                size.map_or_else(|| format!("{LEN} of any number of"), |size| size.to_string())
            };
            ways.push(format!(
                "connection {} `{}`, path {}: {} bytes from and {} to the robot",
                connection.number,
                excerpt(&connection.name),
                excerpt(&connection.path),
                bytes(from),
                bytes(to)
            ));
        }
    }
    if ways.is_empty() { Err(UnfitRobotFile::ShortConnections { inputs, outputs }) } else { Ok(ways) }
}

/// Returns the devices whose default process data carry both directions. Those of modules are not read.
fn of_esi(file: &DeviceFile, esi: &Esi) -> Result<Vec<String>, UnfitRobotFile> {
    let mut ways = Vec::new();
    let (mut inputs, mut outputs) = (0, 0);
    for device in &esi.devices {
        let choice = DeviceChoice {
            device_name: Some(device.kind.clone()),
            revision: Some(device.revision),
            ..DeviceChoice::default()
        };
        let Ok(ChosenDevice::Esi(chosen)) = choose(file, &choice) else { continue };
        let (to, from) = chosen.lengths();
        (inputs, outputs) = (inputs.max(from), outputs.max(to));
        if from >= LEN && to >= LEN {
            let (kind, revision) = (excerpt(&device.kind), device.revision);
            ways.push(format!(
                "device `{kind}`, revision 0x{revision:08X}: {from} bytes from and {to} to the robot"
            ));
        }
    }
    if ways.is_empty() { Err(UnfitRobotFile::ShortProcessData { inputs, outputs }) } else { Ok(ways) }
}
