//! The IO-Device of a GSDML: an access point, and modules and submodules in their places.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::config::{DeviceChoice, ModulePlace};
use super::error::{ChoiceError, refuse};
use crate::fault::excerpt;
use crate::gsdml::{
    AccessPoint, Gsdml, GsdmlModule, GsdmlSubmodule, ParameterRecord, Placement, SystemSubmodule,
};

/// PROFINET IO-Device with its modules.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ChosenIoDevice {
    /// ID of the access point.
    pub access_point: String,
    /// Vendor ID.
    pub vendor_id: u16,
    /// Device ID.
    pub device_id: u16,
    /// Name of the access point.
    pub name: String,
    /// Station name that the maker proposes.
    pub station_name: String,
    /// Order number.
    pub order_number: String,
    /// Hardware release, such as `1`.
    pub hardware_release: String,
    /// Software release, such as `V1.2.3`.
    pub software_release: String,
    /// Shortest interval in units of 31.25 µs.
    pub min_device_interval: u16,
    /// Modules by ascending slot; the first one is the access point.
    pub modules: Vec<ChosenModule>,
    /// Modules that the user could plug into free slots.
    pub has_free_slots: bool,
}

/// Module in a slot.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ChosenModule {
    /// Slot.
    pub slot: u16,
    /// ID.
    pub id: String,
    /// ModuleIdentNumber.
    pub ident: u32,
    /// Name.
    pub name: String,
    /// Submodules by ascending subslot.
    pub submodules: Vec<ChosenSubmodule>,
}

/// Submodule in a subslot.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ChosenSubmodule {
    /// Subslot.
    pub subslot: u16,
    /// ID; empty for an interface or port without one.
    pub id: String,
    /// SubmoduleIdentNumber.
    pub ident: u32,
    /// Application process identifier.
    pub api: u32,
    /// Name.
    pub name: String,
    /// Bytes from the device.
    pub input_length: u16,
    /// Bytes to the device.
    pub output_length: u16,
    /// Bytes of provider and consumer status.
    pub status_lengths: (u8, u8),
    /// True if its data are PROFIsafe.
    pub is_safety: bool,
    /// True if the user plugged it.
    pub is_pluggable: bool,
    /// Records in the order in which they are written.
    pub records: Vec<ParameterRecord>,
}

const MODULE: &str = "--module";

/// Largest number of modules and submodules of a device. Slots and subslots of a file may be ranges of 65,536.
const MOST_SUBMODULES: usize = 4096;

/// Makes the device of a choice.
pub(super) fn choose(gsdml: &Gsdml, choice: &DeviceChoice) -> Result<ChosenIoDevice, ChoiceError> {
    make(gsdml, choice, true)
}

/// Makes the device; one without data only if it may have none.
pub(super) fn make(
    gsdml: &Gsdml,
    choice: &DeviceChoice,
    needs_data: bool,
) -> Result<ChosenIoDevice, ChoiceError> {
    const FORMAT: &str = "a GSDML";
    refuse("--connection", choice.connection.is_some(), FORMAT)?;
    refuse("--device-name", choice.device_name.is_some(), FORMAT)?;
    refuse("--revision", choice.revision.is_some(), FORMAT)?;
    refuse("--pdo", choice.pdos.is_some(), FORMAT)?;
    let access_point = find_access_point(gsdml, choice.access_point.as_deref())?;
    let head_slot = access_point.fixed_in_slots.iter().next().unwrap_or(0);
    let mut modules = vec![build(gsdml, &access_point.module, head_slot, choice)?];
    for (slot, id) in plugged(access_point, head_slot, choice)? {
        let module = gsdml.module(&id).ok_or_else(|| unknown(access_point, slot, &id))?;
        modules.push(build(gsdml, module, slot, choice)?);
        check_size(&modules)?;
    }
    modules.sort_by_key(|module| module.slot);
    for place in choice.modules.keys() {
        let is_used = modules.iter().any(|module| module.slot == place.slot);
        if place.subslot.is_some() && !is_used {
            let fault = format!("slot {} is empty; plug a module there first", place.slot);
            return Err(ChoiceError::new(MODULE, fault).with(modules_of(gsdml, access_point)));
        }
    }
    check_lengths(access_point, &modules)?;
    let has_data = modules.iter().flat_map(|module| &module.submodules).any(ChosenSubmodule::has_data);
    if needs_data && !has_data && !access_point.modules.is_empty() {
        let fault = "no module with data is plugged; plug one, as in --module 1=ID";
        return Err(ChoiceError::new(MODULE, fault).with(modules_of(gsdml, access_point)));
    }
    let text = |text: &Option<String>| text.clone().unwrap_or_default();
    let head = &access_point.module;
    Ok(ChosenIoDevice {
        access_point: head.id.clone(),
        vendor_id: gsdml.vendor_id,
        device_id: gsdml.device_id,
        name: head.name.clone(),
        station_name: access_point.dns_compatible_name.clone(),
        order_number: text(&head.order_number),
        hardware_release: text(&head.hardware_release),
        software_release: text(&head.software_release),
        min_device_interval: access_point.min_device_interval,
        modules,
        has_free_slots: !access_point.modules.is_empty(),
    })
}

pub(super) fn find_access_point<'g>(
    gsdml: &'g Gsdml,
    wanted: Option<&str>,
) -> Result<&'g AccessPoint, ChoiceError> {
    const OPTION: &str = "--access-point";
    let list = || {
        let all = gsdml.access_points.iter().map(|it| &it.module);
        all.map(|module| (module.id.clone(), module.name.clone()))
    };
    match (wanted, gsdml.access_points.as_slice()) {
        (Some(id), _) => gsdml.access_point(id).ok_or_else(|| {
            ChoiceError::new(OPTION, format!("`{}` is not in the file; choose one", excerpt(id))).with(list())
        }),
        (None, [only]) => Ok(only),
        (None, []) => Err(ChoiceError::new(OPTION, "the file has none; use another file")),
        (None, all) => {
            Err(ChoiceError::new(OPTION, format!("the file has {}; choose one", all.len())).with(list()))
        }
    }
}

/// Returns what a new configuration has at each place: what is used there, and what is fixed.
fn preset(placements: &[Placement]) -> BTreeMap<u16, String> {
    let mut places = BTreeMap::new();
    for placement in placements {
        for place in placement.used.iter().chain(placement.fixed.iter()).take(MOST_SUBMODULES) {
            places.entry(place).or_insert_with(|| placement.id.clone());
        }
    }
    places
}

/// Returns the modules by their slots: those that are fixed, and the chosen ones over those of a new configuration.
fn plugged(
    access_point: &AccessPoint,
    head_slot: u16,
    choice: &DeviceChoice,
) -> Result<BTreeMap<u16, String>, ChoiceError> {
    let mut slots = preset(&access_point.modules);
    let chosen = choice.modules.iter().filter(|(place, _)| place.subslot.is_none());
    for (ModulePlace { slot, .. }, id) in chosen {
        let fixed = access_point.modules.iter().find(|it| it.fixed.contains(*slot));
        if let Some(fixed) = fixed.filter(|fixed| fixed.id != *id) {
            let fault = format!("slot {slot} always has `{}`; leave it out", excerpt(&fixed.id));
            return Err(ChoiceError::new(MODULE, fault));
        }
        if id == DeviceChoice::EMPTY {
            slots.remove(slot);
            continue;
        }
        let is_slot = access_point.physical_slots.0.is_empty() || access_point.physical_slots.contains(*slot);
        if *slot == head_slot || !is_slot {
            let fault = format!("slot {slot} takes no module; slots are {}", access_point.physical_slots);
            return Err(ChoiceError::new(MODULE, fault));
        }
        let mut placements = access_point.modules.iter().filter(|placement| placement.id == *id);
        if !placements.any(|placement| placement.fits(*slot)) {
            return Err(unknown(access_point, *slot, id));
        }
        slots.insert(*slot, id.clone());
    }
    slots.remove(&head_slot);
    Ok(slots)
}

fn unknown(access_point: &AccessPoint, slot: u16, id: &str) -> ChoiceError {
    let fitting = access_point.modules.iter().filter(|placement| placement.fits(slot));
    let list = fitting.map(|placement| (placement.id.clone(), String::new()));
    ChoiceError::new(MODULE, format!("`{}` does not fit into slot {slot}; choose one", excerpt(id)))
        .with(list)
}

fn modules_of(gsdml: &Gsdml, access_point: &AccessPoint) -> Vec<(String, String)> {
    let name = |placement: &Placement| {
        let name = gsdml.module(&placement.id).map(|module| module.name.clone()).unwrap_or_default();
        (placement.id.clone(), format!("slots {}: {name}", placement.allowed))
    };
    access_point.modules.iter().map(name).collect()
}

/// Builds a module in its slot, with what is plugged into its subslots.
fn build(
    gsdml: &Gsdml,
    module: &GsdmlModule,
    slot: u16,
    choice: &DeviceChoice,
) -> Result<ChosenModule, ChoiceError> {
    let mut subslots = BTreeMap::new();
    let taken = |subslot: u16| {
        let fault = format!("slot {slot}: subslot {subslot} is taken twice; choose another place");
        ChoiceError::new(MODULE, fault)
    };
    for submodule in &module.submodules {
        let fixed: Vec<u16> = submodule.fixed_in_subslots.iter().take(MOST_SUBMODULES).collect();
        for subslot in if fixed.is_empty() { vec![1] } else { fixed } {
            if subslots.insert(subslot, ChosenSubmodule::of(submodule, subslot, false)).is_some() {
                return Err(taken(subslot));
            }
        }
    }
    for system in &module.system_submodules {
        if subslots.insert(system.subslot, ChosenSubmodule::of_system(system)).is_some() {
            return Err(taken(system.subslot));
        }
    }
    for (subslot, id) in plugged_submodules(module, slot, choice)? {
        let not_known = || unknown_submodule(module, slot, subslot, &id);
        let submodule = gsdml.submodule(&id).ok_or_else(not_known)?;
        if subslots.insert(subslot, ChosenSubmodule::of(submodule, subslot, true)).is_some() {
            return Err(taken(subslot));
        }
    }
    Ok(ChosenModule {
        slot,
        id: module.id.clone(),
        ident: module.ident,
        name: module.name.clone(),
        submodules: subslots.into_values().collect(),
    })
}

fn plugged_submodules(
    module: &GsdmlModule,
    slot: u16,
    choice: &DeviceChoice,
) -> Result<BTreeMap<u16, String>, ChoiceError> {
    let mut subslots = preset(&module.pluggable);
    let chosen = choice.modules.iter().filter_map(|(place, id)| {
        (place.slot == slot).then_some(())?;
        Some((place.subslot?, id))
    });
    for (subslot, id) in chosen {
        if id == DeviceChoice::EMPTY {
            if module.pluggable.iter().any(|it| it.fixed.contains(subslot)) {
                let fault = format!("subslot {slot}.{subslot} always has its submodule; leave it out");
                return Err(ChoiceError::new(MODULE, fault));
            }
            subslots.remove(&subslot);
            continue;
        }
        if !module.pluggable.iter().any(|placement| placement.id == *id && placement.fits(subslot)) {
            return Err(unknown_submodule(module, slot, subslot, id));
        }
        subslots.insert(subslot, id.clone());
    }
    Ok(subslots)
}

fn unknown_submodule(module: &GsdmlModule, slot: u16, subslot: u16, id: &str) -> ChoiceError {
    let fitting = module.pluggable.iter().filter(|placement| placement.fits(subslot));
    let list = fitting.map(|placement| (placement.id.clone(), String::new()));
    let fault = format!("`{}` does not fit into subslot {slot}.{subslot}; choose one", excerpt(id));
    ChoiceError::new(MODULE, fault).with(list)
}

fn check_size(modules: &[ChosenModule]) -> Result<(), ChoiceError> {
    let submodules: usize = modules.iter().map(|module| module.submodules.len()).sum();
    if modules.len().max(submodules) <= MOST_SUBMODULES {
        return Ok(());
    }
    let fault = format!("more than {MOST_SUBMODULES} submodules; leave slots empty by SLOT=none");
    Err(ChoiceError::new(MODULE, fault))
}

/// Checks the sum of the data, with a status byte for each submodule, against the limits of the access point.
fn check_lengths(access_point: &AccessPoint, modules: &[ChosenModule]) -> Result<(), ChoiceError> {
    let sum = |length: fn(&ChosenSubmodule) -> (u16, u8)| -> u32 {
        let submodules = modules.iter().flat_map(|module| &module.submodules);
        submodules
            .map(length)
            .filter(|(bytes, _)| *bytes > 0)
            .map(|(bytes, status)| u32::from(bytes) + u32::from(status))
            .sum()
    };
    let inputs = sum(|it| (it.input_length, it.status_lengths.0));
    let outputs = sum(|it| (it.output_length, it.status_lengths.0));
    for (name, bytes, most) in [
        ("input", inputs, access_point.max_input_length),
        ("output", outputs, access_point.max_output_length),
        ("input and output", inputs + outputs, access_point.max_data_length),
    ] {
        if let Some(most) = most.filter(|most| bytes > *most) {
            let fault = format!("{bytes} bytes of {name} data: the access point has {most}; plug less");
            return Err(ChoiceError::new(MODULE, fault));
        }
    }
    Ok(())
}

impl ChosenSubmodule {
    fn of(submodule: &GsdmlSubmodule, subslot: u16, is_pluggable: bool) -> Self {
        // The reader refuses data that do not fit into a frame.
        let length = |bytes: u32| u16::try_from(bytes).unwrap_or(u16::MAX);
        Self {
            subslot,
            id: submodule.id.clone(),
            ident: submodule.ident,
            api: submodule.api,
            name: submodule.name.clone(),
            input_length: length(submodule.inputs.length),
            output_length: length(submodule.outputs.length),
            status_lengths: (submodule.iops_length, submodule.iocs_length),
            is_safety: submodule.is_safety,
            is_pluggable,
            records: submodule.records.clone(),
        }
    }

    fn of_system(system: &SystemSubmodule) -> Self {
        Self {
            subslot: system.subslot,
            id: system.id.clone(),
            ident: system.ident,
            api: 0,
            name: system.name.clone(),
            input_length: 0,
            output_length: 0,
            status_lengths: (1, 1),
            is_safety: false,
            is_pluggable: false,
            records: system.records.clone(),
        }
    }

    /// Returns whether it has data in either direction.
    #[must_use]
    pub fn has_data(&self) -> bool {
        self.input_length > 0 || self.output_length > 0
    }
}

impl ChosenIoDevice {
    pub(super) fn choice(&self) -> DeviceChoice {
        let mut modules = BTreeMap::new();
        for (number, module) in self.modules.iter().enumerate() {
            // The head module is the access point.
            if number > 0 || module.id != self.access_point {
                modules.insert(ModulePlace { slot: module.slot, subslot: None }, module.id.clone());
            }
            for submodule in module.submodules.iter().filter(|submodule| submodule.is_pluggable) {
                let place = ModulePlace { slot: module.slot, subslot: Some(submodule.subslot) };
                modules.insert(place, submodule.id.clone());
            }
        }
        modules.retain(|_, id| *id != self.access_point);
        DeviceChoice { access_point: Some(self.access_point.clone()), modules, ..DeviceChoice::default() }
    }
}
