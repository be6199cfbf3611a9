#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

mod abort_code;
mod al;
mod cabling;
mod config;
pub mod datagram;
pub mod description;
mod dictionary;
mod esc;
mod event;
mod layout;
mod mailbox;
mod segment;
mod sii_image;
mod subdevice;

pub use al::{AlState, AlStatusCode};
pub use config::DeviceConfig;
pub use description::Description;
pub use dictionary::PdoConfiguration;
pub use esc::{LocalClock, checksum as sii_checksum};
pub use event::{DeviceId, Event};
pub use layout::{SyncManagerLayout, Usage, sync_managers};
pub use mailbox::{Emergency, MailFault};
pub use segment::{Counters, DataError, Segment, SegmentEnd};
pub use sii_image::sii_image;

/// EtherType of EtherCAT frames.
pub const ETHER_TYPE: u16 = 0x88A4;

type Writer<'a> = machine::wire::Writer<'a, machine::wire::LittleEndian>;
type Reader<'a> = machine::wire::Reader<'a, machine::wire::LittleEndian>;
