#![doc = include_str!("../README.md")]

mod al;
mod bring_up;
mod cable;
mod coe;
mod commissioning;
mod config;
mod datagrams;
mod foreign;
mod frames;
mod group;
mod held;
mod incoming_mailbox;
mod lend;
mod mailbox;
mod main_device;
mod module_list;
mod operation;
mod problem;
mod process;
mod recovery;
mod script;
mod sdo;
mod sdo_fault;
mod search;
mod sii;
mod slot;
mod survey;
pub mod time;

pub use commissioning::{DetectedModule, LONGEST_OBJECT, SdoAnswer, SdoRefusal, SdoRequest, StartupWrite};
pub use config::{Config, ExpectedDevice, MAX_PROCESS_DATA};
pub use ethercrab;
pub use group::GroupMainDevice;
pub use main_device::{MainDevice, PositionError, SubDeviceId, TooManyDevices};
pub use script::{Scripted, with_main_device};
pub use search::{Found, FoundSubDevice, search};
pub use sii::{Identity, Unreadable};

/// EtherType of EtherCAT frames.
pub const ETHER_TYPE: u16 = 0x88A4;
