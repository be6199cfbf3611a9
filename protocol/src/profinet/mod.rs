//! PROFINET IO: an IO-Device, and what an IO-Controller needs to speak to one.
//!
//! A connection, an *application relation* (AR), comes about in five steps (IEC 61158-6-10):
//!
//! ```text
//! IO-Controller                                        IO-Device
//!   DCP Identify, Set IP      ── Ethernet 0x8892 ──▶    dcp
//!   Connect                   ── UDP 34964 ────────▶    rpc, connect
//!   Write (parameters)        ── UDP 34964 ────────▶    record
//!   PrmEnd                    ── UDP 34964 ────────▶    control
//!                             ◀── UDP 34964 ────────    control: ApplicationReady
//!   cyclic data               ◀─ 0x8892 or UDP 34962 ─▶ rt
//! ```
//!
//! It ends by a Release over RPC, by an error PDU ([`alarm`]), or because cyclic frames fail to come. Whatever a peer
//! does wrong has a name in [`status::Violation`] and a status that goes back to it.
//!
//! All of PROFINET is big-endian, except for the headers of RPC, whose sender says which order it uses.

pub mod alarm;
pub mod block;
pub mod connect;
pub mod control;
mod controller;
pub mod dcp;
pub mod description;
pub mod device;
pub mod ethernet;
pub mod record;
pub mod rpc;
pub mod rt;
mod station;
pub mod status;
mod uuid;

pub use controller::{ConfigError, Controller, ControllerConfig, Parameter};
pub use device::{Device, DeviceConfig};
pub use station::is_station_name;
pub use uuid::Uuid;

/// UDP port of connection management (IANA `profinet-cm`).
pub const RPC_PORT: u16 = 34964;

/// The code `LT` in connection management for cyclic data and alarms over UDP: IPv4's EtherType. On raw Ethernet it is
/// [`ethernet::ETHER_TYPE_PROFINET`].
pub const LT_UDP: u16 = 0x0800;

#[cfg(test)]
mod captured;
