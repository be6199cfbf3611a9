//! The medium of a port: one list for LLDP, the records of the port and the GSDML file.

/// Declares the types, with the words of RFC 4836.
macro_rules! mau_types {
    ($($(#[$doc:meta])* $variant:ident = $code:literal,)*) => {
        /// MAUType: medium and speed of a port, as dot3MauType (RFC 4836).
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum MauType {
            $($(#[$doc])* $variant,)*
        }

        impl MauType {
            /// Every type that a port of a station may have, in the order of the GSDML file.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// Returns the number in LLDP, PDPortDataReal and the GSDML file.
            #[must_use]
            pub const fn code(self) -> u16 {
                match self {
                    $(Self::$variant => $code,)*
                }
            }
        }
    };
}

mau_types! {
    /// 100BASE-TX, full duplex.
    Copper100 = 16,
    /// 1000BASE-T, full duplex.
    Copper1000 = 30,
    /// A port whose medium the station does not know, or that has none, such as a virtual cable.
    Unknown = 0,
}

impl MauType {
    /// Type of each port of our stations: a machine does not know to what its driver connects it.
    pub(crate) const OF_OUR_PORTS: Self = Self::Unknown;

    /// Returns the speeds that a port of this type offers in LLDP, as ifMauAutoNegCapAdvertisedBits (RFC 4836), of which the
    /// first bit is the highest.
    pub(crate) const fn advertised(self) -> u16 {
        match self {
            // b100baseTXFD(5)
            Self::Copper100 => 0x8000 >> 5,
            // b1000baseTFD(15)
            Self::Copper1000 => 0x8000 >> 15,
            // bOther(0)
            Self::Unknown => 0x8000,
        }
    }

    /// Returns the MediaType in PDPortDataReal (IEC 61158-6-10).
    pub(crate) const fn media_type(self) -> u32 {
        match self {
            // Copper cable
            Self::Copper100 | Self::Copper1000 => 1,
            // Unknown
            Self::Unknown => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_and_medium_of_a_type_agree_with_its_name_in_rfc_4836() {
        let of_types = [MauType::Copper100, MauType::Copper1000, MauType::Unknown]
            .map(|it| (it.code(), it.advertised(), it.media_type()));
        assert_eq!(of_types, [(16, 0x0400, 1), (30, 0x0001, 1), (0, 0x8000, 0)]);
    }
}
