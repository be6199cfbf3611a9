//! The classes of objects that the stack supports. Objects, Message Router and EDS file follow this one list.

/// Declares the classes: a type for exhaustive matches, and the codes as constants for paths.
macro_rules! classes {
    ($($constant:ident, $variant:ident = $code:literal: $name:literal;)*) => {
        /// A class of objects that the stack supports (volume 1, table 5-1.1; volume 2, chapter 5).
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum ObjectClass {
            $(#[doc = concat!($name, ".")] $variant,)*
        }

        impl ObjectClass {
            /// Every class, by ascending code.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// Returns the class of a code; none if the stack does not support it.
            #[must_use]
            pub const fn from_code(code: u32) -> Option<Self> {
                Some(match code {
                    $($code => Self::$variant,)*
                    _ => return None,
                })
            }

            /// Returns its code. All of them have 8 bits.
            #[must_use]
            pub const fn code(self) -> u8 {
                match self {
                    $(Self::$variant => $code,)*
                }
            }

            /// Returns its name in the standard.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)*
                }
            }
        }

        /// Class codes of the objects that the stack supports, as paths hold them.
        pub mod class {
            $(#[doc = concat!($name, ".")] pub const $constant: u32 = $code;)*
        }
    };
}

classes! {
    IDENTITY, Identity = 0x01: "Identity";
    MESSAGE_ROUTER, MessageRouter = 0x02: "Message Router";
    ASSEMBLY, Assembly = 0x04: "Assembly";
    CONNECTION_MANAGER, ConnectionManager = 0x06: "Connection Manager";
    QOS, Qos = 0x48: "QoS";
    PORT, Port = 0xF4: "Port";
    TCP_IP_INTERFACE, TcpIpInterface = 0xF5: "TCP/IP Interface";
    ETHERNET_LINK, EthernetLink = 0xF6: "Ethernet Link";
}
