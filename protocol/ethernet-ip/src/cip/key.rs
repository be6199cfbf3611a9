//! The electronic key: the device that a connection is intended for (volume 1, C-1.4.2.5).
//!
//! ```text
//! 0      segment type    0x34
//! 1      key format      4
//! 2..4   vendor          u16  0 is any
//! 4..6   device type     u16  0 is any
//! 6..8   product code    u16  0 is any
//! 8      major revision  bits 0..7, 0 is any; bit 7: a compatible revision is accepted
//! 9      minor revision  u8   0 is any; behind major revision 0 with bit 7 it does not count
//! ```

use super::super::{Reader, Writer};
use super::violation::Violation;
use machine::wire::Truncated;

/// A device's revision.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Revision {
    /// 1 to 127; devices with different major revisions behave differently.
    pub major: u8,
    /// 1 to 255.
    pub minor: u8,
}

/// The device that a connection is intended for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ElectronicKey {
    /// ODVA vendor number, 0 for any.
    pub vendor: u16,
    /// Device type (profile), 0 for any.
    pub device_type: u16,
    /// The vendor's product code, 0 for any.
    pub product_code: u16,
    /// Revision, 0 for any.
    pub revision: Revision,
    /// Whether a device that is compatible with this revision is accepted.
    pub compatible: bool,
}

/// Which property of a device does not match the key, in the order of the checks.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum KeyMismatch {
    /// Vendor or product code.
    VendorOrProduct,
    /// Device type.
    DeviceType,
    /// Revision.
    Revision,
}

impl From<KeyMismatch> for Violation {
    fn from(mismatch: KeyMismatch) -> Self {
        match mismatch {
            KeyMismatch::VendorOrProduct => Self::VendorOrProductMismatch,
            KeyMismatch::DeviceType => Self::DeviceTypeMismatch,
            KeyMismatch::Revision => Self::RevisionMismatch,
        }
    }
}

impl ElectronicKey {
    /// The key format that every device supports.
    pub const FORMAT: u8 = 4;

    /// Parses the key behind the key format.
    pub fn parse(reader: &mut Reader<'_>) -> Result<Self, Truncated> {
        let (vendor, device_type, product_code) = (reader.u16()?, reader.u16()?, reader.u16()?);
        let (major, minor) = (reader.u8()?, reader.u8()?);
        let revision = Revision { major: major & 0x7F, minor };
        Ok(Self { vendor, device_type, product_code, revision, compatible: major & 0x80 != 0 })
    }

    /// Writes the whole segment.
    pub fn emit(&self, writer: &mut Writer<'_>) {
        writer.bytes(&[0x34, Self::FORMAT]);
        writer.u16(self.vendor);
        writer.u16(self.device_type);
        writer.u16(self.product_code);
        writer.u8(self.revision.major & 0x7F | u8::from(self.compatible) << 7);
        writer.u8(self.revision.minor);
    }

    /// Checks `device`, which contains no zeros, against this key.
    pub fn check(&self, device: &Self) -> Result<(), KeyMismatch> {
        let fits = |wanted: u16, there: u16| wanted == 0 || wanted == there;
        if !fits(self.vendor, device.vendor) || !fits(self.product_code, device.product_code) {
            return Err(KeyMismatch::VendorOrProduct);
        }
        if !fits(self.device_type, device.device_type) {
            return Err(KeyMismatch::DeviceType);
        }
        let (wanted, there) = (self.revision, device.revision);
        let fits = if self.compatible {
            // A newer minor revision can replace an older one. The device decides what it is compatible with, and a key
            // that leaves a revision out asks for none.
            wanted.major == 0 || wanted.major == there.major && wanted.minor <= there.minor
        } else {
            (wanted.major == 0 || wanted.major == there.major)
                && (wanted.minor == 0 || wanted.minor == there.minor)
        };
        if fits { Ok(()) } else { Err(KeyMismatch::Revision) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEVICE: ElectronicKey = ElectronicKey {
        vendor: 7,
        device_type: 43,
        product_code: 9,
        revision: Revision { major: 2, minor: 5 },
        compatible: false,
    };

    #[test]
    fn a_key_of_zeros_matches_every_device() {
        let any = ElectronicKey {
            vendor: 0,
            device_type: 0,
            product_code: 0,
            revision: Revision { major: 0, minor: 0 },
            compatible: false,
        };
        assert_eq!(any.check(&DEVICE), Ok(()));
        assert_eq!(ElectronicKey { compatible: true, ..any }.check(&DEVICE), Ok(()));
    }

    #[test]
    fn each_field_that_does_not_match_is_reported() {
        assert_eq!(ElectronicKey { vendor: 8, ..DEVICE }.check(&DEVICE), Err(KeyMismatch::VendorOrProduct));
        assert_eq!(
            ElectronicKey { product_code: 8, ..DEVICE }.check(&DEVICE),
            Err(KeyMismatch::VendorOrProduct)
        );
        assert_eq!(ElectronicKey { device_type: 12, ..DEVICE }.check(&DEVICE), Err(KeyMismatch::DeviceType));
        let revision = Revision { major: 2, minor: 4 };
        assert_eq!(ElectronicKey { revision, ..DEVICE }.check(&DEVICE), Err(KeyMismatch::Revision));
    }

    #[test]
    fn the_compatibility_bit_accepts_a_newer_minor_revision_but_no_other_major_one() {
        let key =
            |major, minor| ElectronicKey { revision: Revision { major, minor }, compatible: true, ..DEVICE };
        assert_eq!(key(2, 4).check(&DEVICE), Ok(()));
        assert_eq!(key(2, 6).check(&DEVICE), Err(KeyMismatch::Revision));
        assert_eq!(key(1, 5).check(&DEVICE), Err(KeyMismatch::Revision));
        assert_eq!(key(1, 0).check(&DEVICE), Err(KeyMismatch::Revision));
    }

    #[test]
    fn with_the_compatibility_bit_each_zero_is_a_wildcard_and_the_other_fields_still_count() {
        let key = |bytes: [u8; 8]| ElectronicKey::parse(&mut Reader::new(&bytes)).unwrap();
        let any = [[0, 0, 0, 0, 0, 0, 0x80, 0], [0, 0, 0, 0, 0, 0, 0x80, 9], [0, 0, 0, 0, 0, 0, 0x82, 0]];
        let of_one_field =
            [[7, 0, 0, 0, 0, 0, 0x80, 0], [0, 0, 43, 0, 0, 0, 0x80, 0], [0, 0, 0, 0, 9, 0, 0x80, 0]];
        for bytes in any.into_iter().chain(of_one_field) {
            assert_eq!(key(bytes).check(&DEVICE), Ok(()), "{bytes:02X?}");
        }
        let vendor = key([8, 0, 0, 0, 0, 0, 0x80, 0]);
        assert_eq!(vendor.check(&DEVICE), Err(KeyMismatch::VendorOrProduct));
        assert_eq!(key([0, 0, 44, 0, 0, 0, 0x82, 0]).check(&DEVICE), Err(KeyMismatch::DeviceType));
    }

    #[test]
    fn without_the_compatibility_bit_all_that_is_not_zero_must_be_equal() {
        let key = |major, minor| ElectronicKey { revision: Revision { major, minor }, ..DEVICE };
        for (major, minor) in [(0, 0), (2, 0), (0, 5), (2, 5)] {
            assert_eq!(key(major, minor).check(&DEVICE), Ok(()), "{major}.{minor}");
        }
        for (major, minor) in [(3, 0), (0, 4), (2, 6)] {
            assert_eq!(key(major, minor).check(&DEVICE), Err(KeyMismatch::Revision), "{major}.{minor}");
        }
    }

    #[test]
    fn a_key_without_the_compatibility_bit_wants_the_revision_itself() {
        let parse = |major| ElectronicKey::parse(&mut Reader::new(&[7, 0, 43, 0, 9, 0, major, 4])).unwrap();
        let revision = Revision { major: 2, minor: 4 };
        assert_eq!(parse(0x02), ElectronicKey { revision, compatible: false, ..DEVICE });
        assert_eq!(parse(0x82), ElectronicKey { revision, compatible: true, ..DEVICE });
    }

    #[test]
    fn a_written_key_is_parsed_unchanged() {
        let mut buf = [0; 10];
        let mut writer = Writer::new(&mut buf);
        let key = ElectronicKey { compatible: true, ..DEVICE };
        key.emit(&mut writer);
        assert_eq!(writer.finish(), Ok(10));
        assert_eq!(buf, [0x34, 4, 7, 0, 43, 0, 9, 0, 0x82, 5]);
        assert_eq!(ElectronicKey::parse(&mut Reader::new(&buf[2..])), Ok(key));
    }
}
