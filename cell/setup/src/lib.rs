//! Setups: all numbers that a user may change, each with its unit in its key and with its provenance.
//!
//! A *setup* is a PLC, a bus and a robot ([`Setup`]), and it names the robot's application. The project's own setups
//! are compiled in ([`SETUPS`]); a path selects a user's setup. A setup with several robots is a [`Cell`] ([`CELLS`]); each of its
//! stations is a `Setup` too.

mod bus;
mod bus_section;
mod cell;
mod cell_bus;
mod check;
mod device_file;
mod difference;
mod error;
mod exact;
mod kinematics;
mod load;
mod model;
mod nearest;
mod peer;
mod place;
mod plain_file;
mod problem;
mod shared_zone;
mod sourced;
mod supply;
mod vary;
mod write;

pub use bus::{
    Addresses, Bus, BusKind, Cyclic, Ethercat, EthercatDevice, EthernetIp, EthernetIpAdapter,
    EthernetIpFormat, EthernetIpKey, Profinet, ProfinetDevice, ProfinetModule, ProfinetSubmodule,
    UnknownCyclic,
};
pub use cell::{Cell, Station};
pub use cell_bus::CellBus;
pub use device_file::{DevicePaths, UnfitRobotFile, ways_to_plug};
pub use difference::{Difference, text_differences};
pub use error::{Error, Figure, control_character};
pub use load::{
    CELLS, SETUPS, Text, built_in, built_in_setup, cell, cell_from_table, cell_from_text, check, check_cell,
    find, read, setup, setup_from_text, setup_with_directory,
};
pub use model::{
    Axes, Drives, Frame, Kinematics, Motions, Opw, Paper, PaperRow, Plc, Robot, Scara, Servo, Setup,
    ThreeParallel,
};
pub use nearest::{meant_or_all, nearest};
pub use peer::Peer;
pub use plain_file::{
    MOST_FILE_BYTES, open_plain_file, read_plain_file, read_plain_text, read_plain_text_within,
};
pub use shared_zone::SharedZone;
pub use sourced::{Provenance, Sourced};
pub use supply::{LookAhead, MOST_QUEUE_MOTIONS, Refill, SlotForm, SplineBlock};
pub use write::{cell_to_table, cell_to_toml, setup_to_toml};

#[cfg(test)]
mod cell_tests;
#[cfg(test)]
mod tests;
