//! The controller of devices of GSDML, EDS or ESI files as a machine: it connects by what files and wire say, and has inputs,
//! outputs and parameters by name.
//!
//! ```text
//! bus           the devices of one controller; running is their time: script, reports and frames
//! ├─ device     a device and what its owner asks of it; file_device is what its owner gives
//! ├─ stack      the stack of the bus: opened, asked for inputs and given outputs
//! ├─ profinet, ethernet_ip, ethercat   from the chosen device to what the stack takes, and to names
//! ├─ signal, value, table   named values in inputs and outputs
//! ├─ earlier    faults from before the connection
//! ├─ parameter  attributes, records and objects by name
//! ├─ arrivals   intervals between cyclic data
//! └─ script     outputs over time
//! ```
//!
//! Outputs are zeros that the device is to ignore until the owner starts them: provider status bad, idle or SAFE-OP. Data of
//! PROFIsafe and FSoE are shown as bytes and never set; a connection of CIP Safety is refused.

mod arrivals;
mod bus;
mod config;
mod device;
mod earlier;
mod ethercat;
mod ethernet_ip;
mod file_device;
mod parameter;
mod profinet;
mod running;
mod script;
mod signal;
mod stack;
mod table;
mod value;

pub use arrivals::Arrivals;
pub use bus::DrivenBus;
pub use config::{BusConfig, DriveConfig, DriveError};
pub use device::{DriveEvent, DrivenDevice};
pub use emulated_device::ScriptError;
pub use ethercat::startup_writes;
pub use ethernet_ip::{configuration_data, identity_status};
pub use file_device::FileDevice;
pub use parameter::{DeviceParameter, ParameterAnswer, ParameterValue};
pub use profinet::{MODULES_RECORD, found_modules, startup_records};
pub use script::{OutputScript, ScriptedOutput};
pub use signal::{Signal, SignalType};
pub use table::SignalTable;
pub use value::{ScaledValue, SignalValue, ValueError};
