#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

pub mod adapter;
pub mod cip;
pub mod class1;
pub mod connection;
pub mod cpf;
mod data;
pub mod description;
pub mod discovery;
pub mod encapsulation;
mod objects;
mod own_address;
pub mod scanner;
mod search;

pub use adapter::{Adapter, AdapterConfig};
pub use data::DataError;
pub use objects::PORT_NUMBER;
pub use scanner::{Connection, ConnectionConfig, ConnectionId, Scanner, ScannerConfig, TooManyConnections};
pub use search::{FoundDevice, Search, SearchConfig};

use machine::PortRequest;
use machine::wire::{self, LittleEndian};

/// The UDP ports of both roles: cyclic data, then explicit messages.
pub const PORTS: &[PortRequest] = &[PortRequest::Udp(IO_PORT), PortRequest::Udp(ENCAPSULATION_PORT)];

/// The same ports, and the one for ARP, by which address conflicts are detected.
pub const PORTS_WITH_ARP: &[PortRequest] =
    &[PortRequest::Udp(IO_PORT), PortRequest::Udp(ENCAPSULATION_PORT), machine::arp::ETHERNET];

/// TCP and UDP port of the encapsulation (volume 2, 2-2).
pub const ENCAPSULATION_PORT: u16 = 0xAF12;

/// UDP port of class 0 and class 1 connections (volume 2, 2-2).
pub const IO_PORT: u16 = 0x08AE;

type Reader<'a> = wire::Reader<'a, LittleEndian>;
type Writer<'a> = wire::Writer<'a, LittleEndian>;

/// Declares the codes of a field with their words. A code that is not listed survives a round trip.
macro_rules! codes {
    ($(#[$doc:meta])* $name:ident: $number:ty { $($variant:ident = $code:literal: $words:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum $name {
            $(#[doc = $words] $variant,)*
            /// A code that is not listed here.
            Unknown($number),
        }

        impl $name {
            /// Returns the meaning of the code in words.
            #[must_use]
            pub const fn text(self) -> &'static str {
                match self {
                    $(Self::$variant => $words,)*
                    Self::Unknown(_) => "a code that is not in the standard's table",
                }
            }
        }

        impl From<$number> for $name {
            fn from(code: $number) -> Self {
                match code {
                    $($code => Self::$variant,)*
                    code => Self::Unknown(code),
                }
            }
        }

        impl From<$name> for $number {
            fn from(code: $name) -> Self {
                match code {
                    $($name::$variant => $code,)*
                    $name::Unknown(code) => code,
                }
            }
        }
    };
}
use codes;

#[cfg(test)]
extern crate self as ethernet_ip;
#[cfg(test)]
#[path = "../tests/ethernet_ip/samples.rs"]
mod samples;
