//! Setups and applications: every number that a user may change, with its unit in the key and its provenance
//! beside it.
//!
//! A *setup* is a PLC, a bus and a robot ([`Setup`]); an *application* is what the robot does ([`Application`]).
//! Those that the project ships are compiled in ([`SETUPS`], [`APPLICATIONS`]); a path names one's own.

mod application;
mod load;
mod model;
mod motions;
mod sourced;

pub use application::{Application, Motion, MotionKind};
pub use load::{APPLICATIONS, Error, SETUPS, application, setup};
pub use model::{
    Axes, Bus, BusKind, Cyclic, Figure, Frame, Kinematics, Motions, Paper, Plc, Profinet, Robot, Scara, Setup,
};
pub use motions::motions;
pub use sourced::{Provenance, Sourced};
