//! Setups: every number that a user may change, with its unit in the key and its provenance beside it.
//!
//! A *setup* is a PLC, a bus and a robot ([`Setup`]), and it names the application that the robot runs. Those that the
//! project ships are compiled in ([`SETUPS`]); a path names one's own.

mod check;
mod error;
mod load;
mod model;
mod sourced;
mod vary;
mod write;

pub use error::Error;
pub use load::{SETUPS, Text, check, find, setup, setup_with_directory};
pub use model::{
    Axes, Bus, BusKind, Cyclic, EthernetIp, EthernetIpAdapter, EthernetIpKey, Figure, Frame, Kinematics,
    Motions, Opw, Paper, Plc, Profinet, ProfinetDevice, ProfinetModule, ProfinetSubmodule, Robot, Scara,
    Setup, UnknownCyclic,
};
pub use sourced::{Provenance, Sourced};
pub use write::setup_to_toml;

#[cfg(test)]
mod tests;
