//! Positions of each submodule's data and statuses in the cyclic frames.

use alloc::vec::Vec;
use core::ops::Range;

use crate::connect::{DiffModule, ExpectedModule, Iocr, Object};
use crate::description::{Description, Submodule};
use crate::provided::Provided;
use crate::rt::IoxStatus;

/// A submodule's data in a frame; its status is the byte behind them.
#[derive(Clone, Debug)]
struct Part {
    slot: u16,
    subslot: u16,
    data: Range<usize>,
}

/// A status that the device writes.
#[derive(Clone, Copy, Debug)]
struct StatusByte {
    frame: usize,
    /// Whether the submodule is plugged as expected.
    usable: bool,
}

/// The layout of both C_SDUs for one AR.
#[derive(Debug)]
pub(super) struct ProcessData {
    to_controller: Vec<Part>,
    from_controller: Vec<Part>,
    statuses: Vec<StatusByte>,
    /// Whether data are missing: the device has some, but no submodule with data is as the controller expects it.
    lacks_data: bool,
}

impl ProcessData {
    /// Creates the mapping for two IOCRs that were admitted with these expected modules.
    pub(super) fn new(
        description: &Description,
        expected: &[ExpectedModule],
        diff: &[DiffModule],
        input: &Iocr,
        output: &Iocr,
    ) -> Self {
        let usable = |slot, subslot| {
            let differs = diff
                .iter()
                .filter(|module| module.slot == slot)
                .any(|module| module.submodules.iter().any(|submodule| submodule.subslot == subslot));
            !differs && description.submodule(slot, subslot).is_some()
        };
        let mut mapping = Self {
            to_controller: Vec::new(),
            from_controller: Vec::new(),
            statuses: Vec::new(),
            lacks_data: false,
        };
        for (slot, submodule) in description.submodules() {
            let subslot = submodule.subslot;
            let place = |iocr: &Iocr, len: u16| {
                let object = iocr.objects.iter().find(|object| at(object) == (slot, subslot))?;
                let start = usize::from(object.offset);
                let part = Part { slot, subslot, data: start..start + usize::from(len) };
                (len > 0 && usable(slot, subslot)).then_some(part)
            };
            mapping.to_controller.extend(place(input, submodule.input_len));
            mapping.from_controller.extend(place(output, submodule.output_len));
        }
        let has_data = |(_, submodule): (_, &Submodule)| submodule.input_len > 0 || submodule.output_len > 0;
        mapping.lacks_data = mapping.to_controller.is_empty()
            && mapping.from_controller.is_empty()
            && description.submodules().any(has_data);
        for object in &input.objects {
            let (slot, subslot) = at(object);
            let modules = expected.iter().filter(|module| module.slot == slot);
            let mut submodules = modules.flat_map(|module| &module.submodules);
            let submodule = submodules.find(|submodule| submodule.subslot == subslot);
            let len = submodule.and_then(|submodule| submodule.input_len).unwrap_or(0);
            let frame = usize::from(object.offset) + usize::from(len);
            mapping.statuses.push(StatusByte { frame, usable: usable(slot, subslot) });
        }
        for object in &input.consumer_statuses {
            let (slot, subslot) = at(object);
            mapping
                .statuses
                .push(StatusByte { frame: usize::from(object.offset), usable: usable(slot, subslot) });
        }
        mapping
    }

    /// Writes the data of every submodule into the frame to the controller.
    pub(super) fn write_data(&self, provided: &Provided, c_sdu: &mut [u8]) {
        for Part { slot, subslot, data } in &self.to_controller {
            let from = provided.get(*slot, *subslot).map(|(from, _)| from);
            let to = c_sdu.get_mut(data.clone());
            if let (Some(from), Some(to)) = (from, to)
                && from.len() == to.len()
            {
                to.copy_from_slice(from);
            }
        }
    }

    /// Writes all provider and consumer statuses: good where the submodule is as expected and the device is ready.
    pub(super) fn write_statuses(&self, ready: bool, c_sdu: &mut [u8]) {
        for status in &self.statuses {
            if let Some(byte) = c_sdu.get_mut(status.frame) {
                let good = ready && status.usable;
                *byte = if good { IoxStatus::GOOD.0 } else { IoxStatus::BAD_BY_DEVICE.0 };
            }
        }
    }

    /// Returns the data of every submodule in a frame from the controller, with slot and subslot; `None` for data that it
    /// marks as bad.
    pub(super) fn all_data<'a>(
        &self,
        c_sdu: &'a [u8],
    ) -> impl Iterator<Item = ((u16, u16), Option<&'a [u8]>)> {
        self.from_controller.iter().map(move |Part { slot, subslot, data }| {
            let good = c_sdu.get(data.end).is_some_and(|status| IoxStatus(*status).is_good());
            ((*slot, *subslot), c_sdu.get(data.clone()).filter(|_| good))
        })
    }

    /// Returns whether data are exchanged with this frame from the controller: it marks some of them as good, as each submodule has
    /// a provider status of its own. For a device with inputs only, it has none.
    pub(super) fn is_good(&self, c_sdu: &[u8]) -> bool {
        let mut data = self.all_data(c_sdu).map(|(_, data)| data.is_some());
        !self.lacks_data && (self.from_controller.is_empty() || data.any(|is_good| is_good))
    }
}

const fn at(object: &Object) -> (u16, u16) {
    (object.slot, object.subslot)
}
