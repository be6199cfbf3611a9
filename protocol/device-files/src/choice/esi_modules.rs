//! Modules of an ESI: which one is in which slot, and what it adds to its device (ETG.5001.1, modular device profile).

use serde::{Deserialize, Serialize};

use super::config::{DeviceChoice, ModulePlace};
use super::error::ChoiceError;
use crate::esi::{DictionaryObject, Esi, EsiDevice, EsiModule, EsiPdo, EsiSlot, StartupCommand};
use crate::fault::excerpt;
use crate::xml::number;

/// Module in a slot of a SubDevice.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct ChosenEsiModule {
    /// Slot, from 1: its entry in the objects 0xF030 and 0xF050.
    pub slot: u8,
    /// ModuleIdent.
    pub ident: u32,
    /// Type.
    pub kind: String,
    /// Name.
    pub name: String,
}

/// Module in a slot, and how far the slot moves its indices.
pub(super) struct PlacedModule<'e> {
    pub(super) slot: u8,
    pub(super) module: &'e EsiModule,
    index_offset: u32,
    pdo_offset: u32,
}

/// Place for one module.
struct NumberedSlot<'e> {
    number: u8,
    slot: &'e EsiSlot,
    is_mandatory: bool,
}

const MODULE: &str = "--module";

/// Returns the places of a device: a slot of the file stands for as many as it has instances. The objects of module lists have 255
/// entries at most.
fn slots(device: &EsiDevice) -> Vec<NumberedSlot<'_>> {
    let places = device.slots.iter().flat_map(|slot| {
        let most = slot.max_instances.max(slot.min_instances);
        (0..most).map(move |instance| (slot, instance < slot.min_instances))
    });
    let numbered = (1..=u8::MAX).zip(places);
    numbered.map(|(number, (slot, is_mandatory))| NumberedSlot { number, slot, is_mandatory }).collect()
}

/// Returns the number of places for modules.
pub(super) fn slot_count(device: &EsiDevice) -> u8 {
    slots(device).last().map_or(0, |slot| slot.number)
}

impl NumberedSlot<'_> {
    fn fits(&self, module: &EsiModule) -> bool {
        self.slot.module_idents.contains(&module.ident)
            || module.class.as_ref().is_some_and(|class| self.slot.module_classes.contains(class))
    }

    fn list(&self, esi: &Esi) -> Vec<(String, String)> {
        let fitting = esi.modules.iter().filter(|module| self.fits(module));
        fitting.map(|it| (format!("{}=0x{:08X}", self.number, it.ident), it.kind.clone())).collect()
    }

    /// Returns the module of an ident, type or name.
    fn find<'m>(&self, esi: &'m Esi, id: &str) -> Result<&'m EsiModule, ChoiceError> {
        let ident = number::<u32>(id);
        let is_it = |it: &&EsiModule| ident == Some(it.ident) || it.kind == id || it.name == id;
        let found = esi.modules.iter().find(|it| is_it(it) && self.fits(it));
        found.ok_or_else(|| {
            let known = esi.modules.iter().any(|it| is_it(&it));
            let fault = if known { "does not fit into it" } else { "is not in the file" };
            let fault = format!("slot {}: `{}` {fault}; choose one", self.number, excerpt(id));
            ChoiceError::new(MODULE, fault).with(self.list(esi))
        })
    }

    /// Returns the module without a choice: a slot that needs one has that of the file, or the only one that fits.
    fn preset<'m>(&self, esi: &'m Esi) -> Result<Option<&'m EsiModule>, ChoiceError> {
        if !self.is_mandatory {
            return Ok(None);
        }
        let default = self.slot.default_ident.and_then(|ident| esi.module(ident));
        let mut fitting = esi.modules.iter().filter(|module| self.fits(module));
        let only = fitting.next().filter(|_| fitting.next().is_none());
        default.or(only).map(Some).ok_or_else(|| {
            let fault = format!("slot {} needs a module; choose one", self.number);
            ChoiceError::new(MODULE, fault).with(self.list(esi))
        })
    }
}

/// Returns the choice with the modules that a device detects, by slot and ModuleIdent, and says which of them the file does not have
/// there; these are left out.
pub(super) fn with_detected(
    esi: &Esi,
    device: &EsiDevice,
    choice: &DeviceChoice,
    detected: &[(u8, u32)],
) -> (DeviceChoice, Vec<String>) {
    let mut choice = choice.clone();
    let mut unknown = Vec::new();
    for slot in slots(device) {
        let place = ModulePlace { slot: slot.number.into(), subslot: None };
        let ident = detected.iter().find(|(number, _)| *number == slot.number).map(|(_, ident)| *ident);
        let is_known = |ident: &u32| esi.modules.iter().any(|it| it.ident == *ident && slot.fits(it));
        match ident {
            None => choice.modules.insert(place, DeviceChoice::EMPTY.to_owned()),
            Some(ident) if is_known(&ident) => choice.modules.insert(place, format!("0x{ident:08X}")),
            Some(ident) => {
                unknown.push(foreign_module(slot.number, ident));
                choice.modules.insert(place, DeviceChoice::EMPTY.to_owned())
            }
        };
    }
    let last = slot_count(device);
    unknown.extend(detected.iter().filter(|(slot, _)| *slot > last).map(|it| foreign_module(it.0, it.1)));
    (choice, unknown)
}

fn foreign_module(slot: u8, ident: u32) -> String {
    format!(
        "slot {slot}: the device has module 0x{ident:08X}, which the file does not have there; it is left out"
    )
}

/// Chooses the modules of a device.
pub(super) fn choose<'e>(
    esi: &'e Esi,
    device: &'e EsiDevice,
    choice: &DeviceChoice,
) -> Result<Vec<PlacedModule<'e>>, ChoiceError> {
    let slots = slots(device);
    let fault = |fault: String| Err(ChoiceError::new(MODULE, fault));
    for (place, id) in &choice.modules {
        if place.subslot.is_some() {
            return fault(format!("{place}={}: an ESI has no subslots; give SLOT=ID", excerpt(id)));
        }
        if slots.is_empty() {
            return fault("the device has no slots for modules; leave it out".to_owned());
        }
        if !slots.iter().any(|slot| u16::from(slot.number) == place.slot) {
            return fault(format!("slot {}: the device has slots 1 to {}", place.slot, slots.len()));
        }
    }
    let mut placed = Vec::new();
    for slot in slots {
        let place = ModulePlace { slot: slot.number.into(), subslot: None };
        let module = match choice.modules.get(&place).map(String::as_str) {
            Some(DeviceChoice::EMPTY) if slot.is_mandatory => {
                let fault = format!("slot {} needs a module; choose one", slot.number);
                return Err(ChoiceError::new(MODULE, fault).with(slot.list(esi)));
            }
            Some(DeviceChoice::EMPTY) => None,
            Some(id) => Some(slot.find(esi, id)?),
            None => slot.preset(esi)?,
        };
        let steps = u32::from(slot.number) - 1;
        placed.extend(module.map(|module| PlacedModule {
            slot: slot.number,
            module,
            index_offset: steps * u32::from(slot.slot.index_increment),
            pdo_offset: steps * u32::from(slot.slot.pdo_increment),
        }));
    }
    Ok(placed)
}

impl PlacedModule<'_> {
    pub(super) fn chosen(&self) -> ChosenEsiModule {
        let EsiModule { ident, kind, name, .. } = self.module;
        ChosenEsiModule { slot: self.slot, ident: *ident, kind: kind.clone(), name: name.clone() }
    }

    /// Returns an index where the slot moves it.
    fn moved(&self, index: u16, depends_on_slot: bool, offset: u32) -> Result<u16, ChoiceError> {
        let moved = if depends_on_slot { u32::from(index) + offset } else { index.into() };
        u16::try_from(moved).map_err(|_| {
            let fault = format!("slot {} moves index 0x{index:04X} beyond 0xFFFF; leave it empty", self.slot);
            ChoiceError::new(MODULE, fault)
        })
    }

    /// Returns PDOs of the module as they are in its slot.
    pub(super) fn pdos(&self, pdos: &[EsiPdo]) -> Result<Vec<EsiPdo>, ChoiceError> {
        let of_slot = |pdo: &EsiPdo| {
            let mut own = pdo.clone();
            own.index = self.moved(pdo.index, pdo.depends_on_slot, self.pdo_offset)?;
            for excluded in &mut own.excludes {
                *excluded = self.moved(*excluded, pdo.depends_on_slot, self.pdo_offset)?;
            }
            for entry in &mut own.entries {
                entry.index = self.moved(entry.index, entry.depends_on_slot, self.index_offset)?;
            }
            Ok(own)
        };
        pdos.iter().map(of_slot).collect()
    }

    /// Returns the objects of the module as they are in its slot.
    pub(super) fn objects(&self) -> Result<Vec<DictionaryObject>, ChoiceError> {
        let objects = self.module.dictionary.iter().flat_map(|dictionary| &dictionary.objects);
        let of_slot = |object: &DictionaryObject| {
            let index = self.moved(object.index, object.depends_on_slot, self.index_offset)?;
            Ok(DictionaryObject { index, ..object.clone() })
        };
        objects.map(of_slot).collect()
    }

    /// Returns the commands for the start of the module as they are in its slot.
    pub(super) fn commands(&self) -> Result<Vec<StartupCommand>, ChoiceError> {
        let coe = self.module.mailbox.iter().filter_map(|mailbox| mailbox.coe.as_ref());
        let of_slot = |command: &StartupCommand| {
            let index = self.moved(command.index, command.depends_on_slot, self.index_offset)?;
            Ok(StartupCommand { index, ..command.clone() })
        };
        coe.flat_map(|coe| &coe.init_commands).map(of_slot).collect()
    }
}
