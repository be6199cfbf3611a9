//! Identification records as a controller or a tool reads them from a device: I&M0 and RealIdentificationData.

use alloc::vec::Vec;
use core::fmt;

use crate::block::{self, BlockReader, BlockType};
use crate::status::Block;

/// I&M0 of a device (IEC 61158-6-10, 5.2.11): who made it, and which version it is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Identification<'a> {
    /// VendorID.
    pub vendor: u16,
    /// Order number, padded with blanks.
    pub order_id: &'a [u8],
    /// Serial number, padded with blanks.
    pub serial_number: &'a [u8],
    /// Hardware revision.
    pub hardware_revision: u16,
    /// Letter of the software revision: V, R, P, U or T.
    pub software_kind: u8,
    /// Software revision.
    pub software_revision: [u8; 3],
}

/// Returns the body of the record's block, with the low part of its version.
fn body<'a>(record: &'a [u8], wanted: BlockType) -> Option<(BlockReader<'a>, u8)> {
    // Each caller reads the versions that it knows.
    let next = block::next_known(&mut BlockReader::new(record), |_| Block::Record, |_| false);
    let (_, body) = next.ok().filter(|(found, _)| *found == wanted)?;
    // Type, length and the high part of the version come first.
    Some((body, *record.get(5)?))
}

impl<'a> Identification<'a> {
    /// Parses the record; `None` if it is another one or cut.
    #[must_use]
    pub fn parse(record: &'a [u8]) -> Option<Self> {
        let (mut reader, _) = body(record, BlockType::IdentificationAndMaintenance0)?;
        let mut next = || {
            Ok::<_, machine::wire::Truncated>(Self {
                vendor: reader.u16()?,
                order_id: reader.bytes(20)?,
                serial_number: reader.bytes(16)?,
                hardware_revision: reader.u16()?,
                software_kind: reader.u8()?,
                software_revision: reader.array()?,
            })
        };
        next().ok()
    }
}

impl fmt::Display for Identification<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { vendor, order_id, serial_number, hardware_revision, software_kind, software_revision } =
            self;
        let [major, minor, bug_fix] = software_revision;
        let kind = if software_kind.is_ascii_alphabetic() { char::from(*software_kind) } else { '?' };
        write!(
            f,
            "vendor 0x{vendor:04X}, order number `{}`, serial number `{}`, hardware {hardware_revision}, firmware {kind}{major}.{minor}.{bug_fix}",
            order_id.trim_ascii().escape_ascii(),
            serial_number.trim_ascii().escape_ascii()
        )
    }
}

/// A module that is plugged in a device.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct RealModule {
    /// API.
    pub api: u32,
    /// Slot number.
    pub slot: u16,
    /// ModuleIdentNumber.
    pub ident: u32,
    /// Its submodules: subslot and SubmoduleIdentNumber.
    pub submodules: Vec<(u16, u32)>,
}

/// Parses RealIdentificationData, in both versions (IEC 61158-6-10, 5.2.3.9); `None` if it is another record or cut.
#[must_use]
pub fn parse_real_identification(record: &[u8]) -> Option<Vec<RealModule>> {
    let (mut reader, version_low) = body(record, BlockType::RealIdentification)?;
    let mut next = || {
        let mut modules = Vec::new();
        // Version 1.0 has one API, 0, and does not name it.
        let apis = if version_low == 0 { 1 } else { reader.u16()? };
        for _ in 0..apis {
            let api = if version_low == 0 { 0 } else { reader.u32()? };
            for _ in 0..reader.u16()? {
                let (slot, ident) = (reader.u16()?, reader.u32()?);
                let mut submodules = Vec::new();
                for _ in 0..reader.u16()? {
                    submodules.push((reader.u16()?, reader.u32()?));
                }
                modules.push(RealModule { api, slot, ident, submodules });
            }
        }
        Ok::<_, machine::wire::Truncated>(modules)
    };
    next().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{emit_im0, emit_real_identification};
    use crate::samples;
    use machine::wire::Writer;

    fn emitted(write: impl FnOnce(&mut block::BlockWriter<'_>)) -> Vec<u8> {
        let mut buf = [0; 512];
        let mut writer = Writer::new(&mut buf);
        write(&mut writer);
        let len = writer.finish().unwrap();
        buf[..len].to_vec()
    }

    #[test]
    fn i_and_m0_comes_out_again_and_a_cut_one_is_none() {
        let record = emitted(|w| emit_im0(&samples::DEVICE, 0, w));
        let found = Identification::parse(&record).unwrap();
        assert_eq!(found.vendor, samples::DEVICE.identity.vendor);
        assert_eq!(found.order_id.trim_ascii(), samples::DEVICE.order_id.as_bytes());
        assert_eq!(found.serial_number.trim_ascii(), samples::DEVICE.serial_number.as_bytes());
        assert_eq!(found.software_revision, samples::DEVICE.software_revision);
        assert!((0..record.len()).all(|cut| Identification::parse(&record[..cut]).is_none()));
    }

    #[test]
    fn plugged_modules_come_out_again_in_both_versions_and_a_cut_record_is_none() {
        let record = emitted(|w| emit_real_identification(&samples::DEVICE, |_, _| true, w));
        let found = parse_real_identification(&record).unwrap();
        let expected: Vec<_> = samples::DEVICE
            .modules
            .iter()
            .map(|module| RealModule {
                api: 0,
                slot: module.slot,
                ident: module.ident,
                submodules: module.submodules.iter().map(|one| (one.subslot, one.ident)).collect(),
            })
            .collect();
        assert_eq!(found, expected);
        // Version 1.0 has neither the number of APIs nor the API.
        let mut old = [&record[..6], &record[12..]].concat();
        old[5] = 0;
        old[3] -= 6;
        assert_eq!(parse_real_identification(&old).unwrap(), expected);
        assert!((0..record.len()).all(|cut| parse_real_identification(&record[..cut]).is_none()));
        // More modules than the record has.
        let mut wrong = record.clone();
        wrong[12..14].fill(0xFF);
        assert_eq!(parse_real_identification(&wrong), None);
    }
}
