//! The controller of the device of a GSDML, EDS or ESI as a machine: it connects by what file and wire say, and has inputs,
//! outputs and parameters by name.
//!
//! ```text
//! device        the device and what its owner asks of it; running is its time: script, reports and frames
//! ├─ stack      the stack of its bus: opened, asked for inputs and given outputs
//! ├─ profinet, ethernet_ip, ethercat   from the chosen device to what the stack takes, and to names
//! ├─ signal, value, table   named values in inputs and outputs
//! ├─ parameter  attributes, records and objects by name
//! ├─ arrivals   intervals between cyclic data
//! └─ script     outputs over time
//! ```
//!
//! Outputs are zeros that the device is to ignore until the owner starts them: provider status bad, idle or SAFE-OP. Data of
//! PROFIsafe and FSoE are shown as bytes and never set; a connection of CIP Safety is refused.

mod arrivals;
mod config;
mod device;
mod ethercat;
mod ethernet_ip;
mod parameter;
mod profinet;
mod running;
mod script;
mod signal;
mod stack;
mod table;
mod value;

pub use arrivals::Arrivals;
pub use config::{DriveConfig, DriveError};
pub use device::{DriveEvent, DrivenDevice};
pub use emulated_device::ScriptError;
pub use parameter::{DeviceParameter, ParameterAnswer, ParameterValue};
pub use profinet::{MODULES_RECORD, found_modules};
pub use script::{OutputScript, ScriptedOutput};
pub use signal::{Signal, SignalType};
pub use table::SignalTable;
pub use value::{ScaledValue, SignalValue, ValueError};
