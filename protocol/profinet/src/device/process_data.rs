//! Where the process image is in the cyclic frames, and which statuses go with it.
//!
//! The image of a direction is the data of all submodules in that direction, one after another by slot and subslot.

use alloc::vec::Vec;

use crate::IoData;
use crate::connect::{DiffModule, ExpectedModule, Iocr, Object};
use crate::description::Description;
use crate::rt::IoxStatus;

/// A submodule's data in a frame and in the image.
#[derive(Clone, Copy, Debug)]
struct Part {
    image: usize,
    frame: usize,
    len: usize,
}

/// A status that this side writes.
#[derive(Clone, Copy, Debug)]
struct StatusByte {
    frame: usize,
    /// Whether the submodule is there as expected.
    usable: bool,
}

/// The mapping between image and C_SDU for one AR.
#[derive(Debug)]
pub(super) struct ProcessData {
    to_controller: Vec<Part>,
    from_controller: Vec<Part>,
    statuses: Vec<StatusByte>,
}

impl ProcessData {
    /// The mapping for two IOCRs that were admitted with these expected modules.
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
        let mut mapping =
            Self { to_controller: Vec::new(), from_controller: Vec::new(), statuses: Vec::new() };
        let (mut input_at, mut output_at) = (0, 0);
        for (slot, submodule) in description.submodules() {
            let place = |iocr: &Iocr, len: u16, image: usize| {
                let here = |object: &&_| at(object) == (slot, submodule.subslot);
                let object = iocr.objects.iter().find(here)?;
                let part = Part { image, frame: usize::from(object.offset), len: usize::from(len) };
                (part.len > 0 && usable(slot, submodule.subslot)).then_some(part)
            };
            mapping.to_controller.extend(place(input, submodule.input_len, input_at));
            mapping.from_controller.extend(place(output, submodule.output_len, output_at));
            input_at += usize::from(submodule.input_len);
            output_at += usize::from(submodule.output_len);
        }
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

    /// Copies the image into the frame to the controller.
    pub(super) fn write_image(&self, image: &IoData, c_sdu: &mut [u8]) {
        for Part { image: image_at, frame, len } in &self.to_controller {
            let from = image.get(*image_at..image_at + len);
            let to = c_sdu.get_mut(*frame..frame + len);
            if let (Some(from), Some(to)) = (from, to) {
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

    /// Copies the frame from the controller into the image, if it marks every part of it as good.
    pub(super) fn read_image(&self, c_sdu: &[u8], image: &mut IoData) -> bool {
        let good = self
            .from_controller
            .iter()
            .all(|part| c_sdu.get(part.frame + part.len).is_some_and(|status| IoxStatus(*status).is_good()));
        if self.from_controller.is_empty() || !good {
            return false;
        }
        for Part { image: image_at, frame, len } in &self.from_controller {
            let from = c_sdu.get(*frame..frame + len);
            let to = image.get_mut(*image_at..image_at + len);
            if let (Some(from), Some(to)) = (from, to) {
                to.copy_from_slice(from);
            }
        }
        true
    }
}

const fn at(object: &Object) -> (u16, u16) {
    (object.slot, object.subslot)
}
