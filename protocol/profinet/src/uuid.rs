//! UUIDs. They are encoded in two forms: inside blocks most significant byte first, inside RPC headers in the
//! header's byte order.

use core::fmt;

use machine::wire::{ByteOrder, Reader, Truncated, Writer};

/// A UUID, most significant byte first, as in its text form.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Uuid(pub [u8; 16]);

impl Uuid {
    /// All zero: no object.
    pub const NIL: Self = Self([0; 16]);

    /// Reads a UUID whose first three fields have the reader's byte order.
    pub fn read<O: ByteOrder>(reader: &mut Reader<'_, O>) -> Result<Self, Truncated> {
        let time_low = reader.u32()?.to_be_bytes();
        let time_mid = reader.u16()?.to_be_bytes();
        let time_high = reader.u16()?.to_be_bytes();
        let rest: [u8; 8] = reader.array()?;
        let mut bytes = [0; 16];
        let fields = time_low.iter().chain(&time_mid).chain(&time_high).chain(&rest);
        for (byte, field) in bytes.iter_mut().zip(fields) {
            *byte = *field;
        }
        Ok(Self(bytes))
    }

    /// Writes the UUID with its first three fields in the writer's byte order.
    pub fn write<O: ByteOrder>(&self, writer: &mut Writer<'_, O>) {
        let [a, b, c, d, e, f, g, h, rest @ ..] = self.0;
        writer.u32(u32::from_be_bytes([a, b, c, d]));
        writer.u16(u16::from_be_bytes([e, f]));
        writer.u16(u16::from_be_bytes([g, h]));
        writer.bytes(&rest);
    }

    /// Returns whether all bits are zero.
    #[must_use]
    pub fn is_nil(&self) -> bool {
        *self == Self::NIL
    }
}

impl fmt::Debug for Uuid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = u128::from_be_bytes(self.0);
        write!(
            f,
            "{:08x}-{:04x}-{:04x}-{:04x}-{:012x}",
            number >> 96,
            (number >> 80) & 0xFFFF,
            (number >> 64) & 0xFFFF,
            (number >> 48) & 0xFFFF,
            number & 0xFFFF_FFFF_FFFF
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::wire::{BigEndian, LittleEndian};

    const INTERFACE: Uuid = Uuid(0xDEA0_0001_6C97_11D1_8271_00A0_2442_DF7D_u128.to_be_bytes());

    #[test]
    fn the_byte_order_applies_to_the_first_three_fields_only() {
        let mut buf = [0; 16];
        INTERFACE.write(&mut Writer::<LittleEndian>::new(&mut buf));
        assert_eq!(
            buf,
            [1, 0, 0xA0, 0xDE, 0x97, 0x6C, 0xD1, 0x11, 0x82, 0x71, 0, 0xA0, 0x24, 0x42, 0xDF, 0x7D]
        );
        assert_eq!(Uuid::read(&mut Reader::<LittleEndian>::new(&buf)), Ok(INTERFACE));

        INTERFACE.write(&mut Writer::<BigEndian>::new(&mut buf));
        assert_eq!(buf, INTERFACE.0);
        assert_eq!(format!("{INTERFACE:?}"), "dea00001-6c97-11d1-8271-00a02442df7d");
    }
}
