//! The records that every device has: who it is, and which modules it has.
//!
//! ```text
//! Real-, ExpectedIdentificationData   version 1.1; with 1.0 the API has another place
//! I&M0FilterData                      version 1.0, the same layout
//!   NumberOfAPIs u16 · each: API u32 · NumberOfSlots u16
//!     each: slot u16 · ModuleIdentNumber u32 · NumberOfSubslots u16 · each: subslot u16 · SubmoduleIdentNumber u32
//! APIData   NumberOfAPIs u16 · each: API u32
//! I&M0      VendorID u16 · OrderID 20 · SerialNumber 16 · hardware revision u16 · V u8 · software revision 3
//!           RevisionCounter u16 · ProfileID u16 · ProfileSpecificType u16 · I&M version 2 · I&M_Supported u16
//! ```

use crate::block::{self, BlockType, BlockWriter};
use crate::connect::{API, ExpectedModule};
use crate::description::Description;

/// Length in bytes of the block of I&M0.
pub const IM0_LEN: usize = 60;

/// BlockVersionLow of Real- and ExpectedIdentificationData that begin with NumberOfAPIs.
const WITH_API_COUNT: u8 = 1;

/// Writes I&M0 of a device, which is the same for each of its submodules. `supported` is I&M_Supported: bit 1 for I&M1, and so
/// on.
pub fn emit_im0(description: &Description, supported: u16, writer: &mut BlockWriter<'_>) {
    block::write(writer, BlockType::IdentificationAndMaintenance0, |w| {
        w.u16(description.identity.vendor);
        padded(description.order_id, 20, w);
        padded(description.serial_number, 16, w);
        w.u16(description.hardware_revision);
        w.u8(b'V');
        w.bytes(&description.software_revision);
        // Revision counter, profile and profile-specific type: no profile.
        w.zeros(6);
        // Version 1.1 of I&M.
        w.bytes(&[1, 1]);
        w.u16(supported);
    });
}

/// Writes RealIdentificationData of the submodules that `wanted` picks by slot and subslot.
pub fn emit_real_identification(
    description: &Description,
    wanted: impl Fn(u16, u16) -> bool,
    writer: &mut BlockWriter<'_>,
) {
    block::write_version(writer, BlockType::RealIdentification, WITH_API_COUNT, |w| {
        emit_real_modules(description, wanted, w);
    });
}

/// Writes ExpectedIdentificationData of the submodules that `wanted` picks by slot and subslot.
pub fn emit_expected_identification(
    expected: &[ExpectedModule],
    wanted: impl Fn(u16, u16) -> bool,
    writer: &mut BlockWriter<'_>,
) {
    let modules = expected.iter().map(|module| {
        let submodules = module.submodules.iter().map(|submodule| (submodule.subslot, submodule.ident));
        (module.slot, module.ident, submodules)
    });
    block::write_version(writer, BlockType::ExpectedIdentification, WITH_API_COUNT, |w| {
        emit_modules(modules, wanted, w);
    });
}

/// Writes I&M0FilterData: the first submodule of the first slot, the access point, has the device's I&M0. No other
/// submodule or module has its own.
pub fn emit_im0_filter_data(description: &Description, writer: &mut BlockWriter<'_>) {
    let access_point = description.submodules().next().map(|(slot, submodule)| (slot, submodule.subslot));
    for block_type in
        [BlockType::Im0FilterDataSubmodule, BlockType::Im0FilterDataModule, BlockType::Im0FilterDataDevice]
    {
        block::write(writer, block_type, |w| {
            emit_real_modules(description, |slot, subslot| Some((slot, subslot)) == access_point, w);
        });
    }
}

/// Writes APIData: the device has the one API without a profile.
pub fn emit_api_data(writer: &mut BlockWriter<'_>) {
    block::write(writer, BlockType::ApiData, |w| {
        w.u16(1);
        w.u32(API);
    });
}

fn emit_real_modules(description: &Description, wanted: impl Fn(u16, u16) -> bool, w: &mut BlockWriter<'_>) {
    let modules = description.modules.iter().map(|module| {
        let submodules = module.submodules.iter().map(|submodule| (submodule.subslot, submodule.ident));
        (module.slot, module.ident, submodules)
    });
    emit_modules(modules, wanted, w);
}

/// Writes the modules, each as slot, ident and submodules, with the submodules that `wanted` picks. All are in one API.
fn emit_modules<S: Iterator<Item = (u16, u32)> + Clone>(
    modules: impl Iterator<Item = (u16, u32, S)>,
    wanted: impl Fn(u16, u16) -> bool,
    w: &mut BlockWriter<'_>,
) {
    w.u16(1);
    w.u32(API);
    let count_at = w.len();
    w.u16(0);
    let mut slots = 0;
    for (slot, ident, submodules) in modules {
        let picked = submodules.filter(|(subslot, _)| wanted(slot, *subslot));
        let count = picked.clone().count();
        if count == 0 {
            continue;
        }
        slots += 1;
        w.u16(slot);
        w.u32(ident);
        w.u16(u16::try_from(count).unwrap_or(u16::MAX));
        for (subslot, ident) in picked {
            w.u16(subslot);
            w.u32(ident);
        }
    }
    w.patch_u16(count_at, slots);
}

/// Writes a text into a field of fixed length, filled up with spaces.
fn padded(text: &str, length: usize, writer: &mut BlockWriter<'_>) {
    let text = text.as_bytes();
    let text = text.get(..length).unwrap_or(text);
    writer.bytes(text);
    for _ in text.len()..length {
        writer.u8(b' ');
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::BlockReader;
    use crate::record::ReadResponse;
    use crate::rpc::{Header, ResponseArgs};
    use crate::samples::emitted;
    use crate::{captured, samples};

    #[test]
    fn im0_has_the_same_layout_as_the_captured_one() {
        let datagram = captured::datagram(captured::IM0_READ_RES);
        let (header, body) = Header::parse(&datagram).unwrap();
        let blocks = ResponseArgs::parse(&header, body).unwrap().blocks;
        let captured = ReadResponse::parse(&mut BlockReader::new(blocks)).unwrap().record;
        let ours = emitted(|w| emit_im0(&samples::DEVICE, 0, w));
        assert_eq!(ours[..6], captured[..6]);
        assert_eq!((ours.len(), captured.len()), (IM0_LEN, IM0_LEN));
        assert_eq!(&ours[8..28], b"sample-device       ");
    }

    #[test]
    fn real_identification_lists_the_modules_asked_for() {
        let whole = emitted(|w| emit_real_identification(&samples::DEVICE, |_, _| true, w));
        assert_eq!(whole.len(), 6 + 8 + (8 + 3 * 6) + (8 + 6));
        let one = emitted(|w| emit_real_identification(&samples::DEVICE, |slot, _| slot == 1, w));
        assert_eq!(one[4..6], [1, 1], "the version that begins with NumberOfAPIs");
        assert_eq!(one[6..], [0, 1, 0, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 1, 1]);
    }
}
