//! Setups and applications: every number that a user may change, with its unit in the key and its provenance
//! beside it.
//!
//! A *setup* is a PLC, a bus and a robot ([`Setup`]); an *application* is what the robot does ([`Application`]).
//! Those that the project ships are compiled in ([`SETUPS`], [`APPLICATIONS`]); a path names one's own.

mod application;
mod check;
mod error;
mod load;
mod model;
mod motions;
mod sourced;
mod write;

pub use application::{Application, Motion, MotionKind};
pub use error::Error;
pub use load::{APPLICATIONS, SETUPS, application, check, setup, setup_with_application};
pub use model::{
    Axes, Bus, BusKind, Cyclic, Figure, Frame, Kinematics, Motions, Paper, Plc, Profinet, ProfinetDevice,
    ProfinetModule, ProfinetSubmodule, Robot, Scara, Setup, UnknownCyclic,
};
pub use motions::{PROGRAM, motions};
pub use sourced::{Provenance, Sourced};
pub use write::{application_to_toml, setup_to_toml};

#[cfg(test)]
mod tests;
