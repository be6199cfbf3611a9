//! The device of a GSDML, EDS or ESI as a machine: identity, slots or assemblies or process data with their sizes, and inputs
//! and faults from a script.
//!
//! ```text
//! devices       several devices of one process: a line of EtherCAT, or each at its own interface
//! device        the device and what its owner asks it; running is its time: script, faults and frames
//! ├─ stack      the stack of its bus: opened, given inputs and asked for outputs
//! ├─ profinet, ethernet_ip, ethercat   from the chosen device to the description that the stack takes
//! ├─ image      inputs and outputs as bytes, and the places that a script names
//! ├─ playback   values of the script over time
//! ├─ faults     begin, end and effect of each fault
//! ├─ description   the same description for an owner with a stack of its own
//! └─ script     the form of the script
//! ```
//!
//! An emulated device claims no conformance: it has the identity of another maker's device and behaves as our stack does.

mod config;
mod description;
mod device;
mod devices;
mod ethercat;
mod ethernet_ip;
mod faults;
mod image;
mod leak;
mod playback;
mod profinet;
mod running;
mod script;
mod stack;

pub use config::{EmulationConfig, EmulationError};
pub use description::{DeviceDescription, describe};
pub use device::{DeviceEvent, EmulatedDevice};
pub use devices::{EmulatedDevices, MOST_DEVICES};
pub use image::DataPlace;
pub use script::{
    CounterSource, DeviceScript, EchoSource, FaultKind, RampSource, ScriptError, ScriptedFault,
    ScriptedInput, SourceOverTime, ValueType, read_script,
};
