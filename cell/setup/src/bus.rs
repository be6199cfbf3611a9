//! The bus of a setup: what every bus has, and which one it is with all that this one needs.

use std::net::Ipv4Addr;
use std::time::Duration;

use device_files::ChosenDevice;
use serde::{Deserialize, Serialize};

use crate::{DevicePaths, Peer, Sourced};

/// The fieldbus.
#[derive(Clone, PartialEq, Debug)]
pub struct Bus {
    /// Which one, and what only this one needs.
    pub kind: BusKind,
    /// Time from one cyclic frame to the next, each way, in µs.
    pub cycle_us: Sourced<u32>,
    /// Cycles without a frame after which a side gives the connection up.
    pub watchdog_cycles: Sourced<u32>,
    /// One way over the cable, in µs. Modelled in virtual mode.
    pub cable_delay_us: Sourced<u32>,
    /// How far the nodes' clocks may be off, in parts per million. Modelled in virtual mode.
    pub clock_drift_ppm: Sourced<u32>,
    /// PLCs that the robot node accepts; every one if the list is empty.
    pub allowed_plcs: Vec<Peer>,
    /// Properties that the PLC node checks besides the name or address of the robot.
    pub robot: Option<Peer>,
    /// Files that describe the robot's device, until they are read.
    pub device_paths: Option<DevicePaths>,
    /// Device that was chosen from such a file: the robot node is that device, and the PLC node starts it as the file says.
    pub device: Option<Box<ChosenDevice>>,
}

impl Bus {
    /// Returns the PLCs that the robot node accepts.
    #[must_use]
    pub fn allowed(&self) -> machine::Allowed {
        machine::Allowed(self.allowed_plcs.iter().copied().map(Into::into).collect())
    }

    /// Returns the product name in the EDS of the robot's device; `None` if the setup names none.
    #[must_use]
    pub fn product_name(&self) -> Option<&str> {
        match self.device.as_deref()? {
            ChosenDevice::Eds(adapter) => Some(&adapter.product_name),
            ChosenDevice::Gsdml(_) | ChosenDevice::Esi(_) => None,
        }
    }
}

/// Which fieldbus.
#[derive(Clone, PartialEq, Debug)]
pub enum BusKind {
    /// PROFINET IO: the PLC is the IO-Controller, the robot the IO-Device.
    Profinet(Addresses, Profinet),
    /// EtherNet/IP: the PLC is the scanner, the robot the adapter.
    EthernetIp(Addresses, EthernetIp),
    /// EtherCAT: the PLC is the MainDevice, the robot a SubDevice. There are no addresses to set.
    Ethercat(Ethercat),
}

impl BusKind {
    /// Returns its name in a setup and in options.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Profinet(..) => "profinet",
            Self::EthernetIp(..) => "ethernet-ip",
            Self::Ethercat(_) => "ethercat",
        }
    }
}

/// The nodes in an IP network.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Addresses {
    /// PLC's IPv4 address.
    pub plc: Ipv4Addr,
    /// Robot's IPv4 address.
    pub robot: Ipv4Addr,
    /// Both nodes' subnet mask.
    pub mask: Ipv4Addr,
}

impl Bus {
    /// Returns the time without a frame after which a side gives the connection up.
    #[must_use]
    pub fn watchdog(&self) -> Duration {
        Duration::from_micros(self.cycle_us.value.into()) * self.watchdog_cycles.value
    }

    /// Returns the nodes' IP addresses, if the bus has any.
    #[must_use]
    pub const fn addresses(&self) -> Option<&Addresses> {
        match &self.kind {
            BusKind::Profinet(addresses, _) | BusKind::EthernetIp(addresses, _) => Some(addresses),
            BusKind::Ethercat(_) => None,
        }
    }

    /// Sets how PROFINET's cyclic frames travel. Returns whether the bus is PROFINET.
    pub const fn set_cyclic(&mut self, cyclic: Cyclic) -> bool {
        match &mut self.kind {
            BusKind::Profinet(_, profinet) => {
                profinet.cyclic = cyclic;
                true
            }
            BusKind::EthernetIp(..) | BusKind::Ethercat(_) => false,
        }
    }
}

/// How PROFINET carries its cyclic frames.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Cyclic {
    /// RT_CLASS_UDP: UDP port 34962.
    Udp,
    /// RT_CLASS_1: EtherType 0x8892.
    Rt1,
}

impl std::str::FromStr for Cyclic {
    type Err = UnknownCyclic;

    fn from_str(name: &str) -> Result<Self, UnknownCyclic> {
        match name {
            "udp" => Ok(Self::Udp),
            "rt1" => Ok(Self::Rt1),
            _ => Err(UnknownCyclic(name.to_owned())),
        }
    }
}

/// No way of carrying cyclic frames has this name.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("cyclic frames travel by `udp` (RT_CLASS_UDP) or by `rt1` (EtherType 0x8892), not by `{0}`")]
pub struct UnknownCyclic(pub String);

/// Details of the PROFINET connection.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Profinet {
    /// How the cyclic frames travel.
    pub cyclic: Cyclic,
    /// The PLC's name of station.
    pub plc_station_name: String,
    /// The robot's name of station.
    pub robot_station_name: String,
    /// What the PLC expects to find there, where it is not our robot node but, say, a robot's own fieldbus interface.
    pub device: Option<ProfinetDevice>,
}

/// An IO-Device as its GSDML file describes it.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ProfinetDevice {
    /// VendorID.
    pub vendor: u16,
    /// DeviceID.
    pub device: u16,
    /// The modules that are plugged, by ascending slot; slot 0 is the device access point. The image is spread over the
    /// submodules with data, in the order of slot and subslot. Bytes of the image that do not fit are left out; bytes of the
    /// submodules that it does not fill are zero.
    pub modules: Vec<ProfinetModule>,
}

/// What is in one slot of an IO-Device.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ProfinetModule {
    /// Slot number.
    pub slot: u16,
    /// ModuleIdentNumber.
    pub ident: u32,
    /// Its submodules, by ascending subslot.
    pub submodules: Vec<ProfinetSubmodule>,
}

/// What is in one subslot of an IO-Device.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ProfinetSubmodule {
    /// Subslot number.
    pub subslot: u16,
    /// SubmoduleIdentNumber.
    pub ident: u32,
    /// Data from the device to the PLC, in bytes.
    #[serde(default)]
    pub input_bytes: u16,
    /// Data from the PLC to the device, in bytes.
    #[serde(default)]
    pub output_bytes: u16,
}

/// Optional details of the EtherNet/IP connection. The requested packet interval is [`Bus::cycle_us`], both ways.
#[derive(Clone, PartialEq, Default, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct EthernetIp {
    /// Packet intervals without a frame after which a side gives the connection up: 4, 8, 16 and so on up to 512.
    /// Without it, the smallest that covers [`Bus::watchdog_cycles`].
    pub timeout_multiplier: Option<Sourced<u32>>,
    /// Whether the robot sends its frames to a multicast group, which other scanners may join as well, and not to this
    /// PLC alone.
    #[serde(default)]
    pub multicast: bool,
    /// The adapter, where it is not our robot.
    pub adapter: Option<EthernetIpAdapter>,
}

/// An adapter as its EDS file describes it.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct EthernetIpAdapter {
    /// Assembly of the data from the PLC to the adapter, O→T.
    pub consumed_assembly: u32,
    /// Its data, in bytes.
    pub consumed_bytes: u16,
    /// Assembly of the data from the adapter to the PLC, T→O.
    pub produced_assembly: u32,
    /// Its data, in bytes.
    pub produced_bytes: u16,
    /// How its frames show run and idle, O→T.
    #[serde(default = "EthernetIpFormat::run_idle_header")]
    pub consumed_format: EthernetIpFormat,
    /// How its frames show run and idle, T→O.
    #[serde(default)]
    pub produced_format: EthernetIpFormat,
    /// Configuration assembly, where the adapter has one.
    pub configuration_assembly: Option<u32>,
    /// Configuration data that the Forward_Open carries, at most 400 bytes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub configuration_data: Vec<u8>,
    /// Port segments to the adapter behind a bridge, as a padded path.
    #[serde(default)]
    pub route: Vec<u8>,
    /// What the adapter has to be; without it, it may be any.
    pub key: Option<EthernetIpKey>,
}

/// The real-time format of one direction.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum EthernetIpFormat {
    /// Data alone.
    #[default]
    Modeless,
    /// Data in run, nothing in idle.
    ZeroLength,
    /// Never data.
    Heartbeat,
    /// A header of 32 bits before the data.
    RunIdleHeader,
}

impl EthernetIpFormat {
    /// Returns the format that most adapters have O→T.
    const fn run_idle_header() -> Self {
        Self::RunIdleHeader
    }
}

/// An electronic key. A number that is 0 fits every device.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct EthernetIpKey {
    /// ODVA vendor number.
    pub vendor: u16,
    /// Device type.
    pub device_type: u16,
    /// Product code.
    pub product_code: u16,
    /// Major revision.
    pub major_revision: u8,
    /// Minor revision.
    pub minor_revision: u8,
    /// Whether a device of another revision that says it is compatible will do.
    #[serde(default)]
    pub compatible: bool,
}

impl EthernetIp {
    /// Returns the number of packet intervals without a frame that the connection must tolerate at least, on a bus with
    /// this watchdog.
    #[must_use]
    pub fn timeout_intervals(&self, watchdog_cycles: &Sourced<u32>) -> u32 {
        self.timeout_multiplier.as_ref().unwrap_or(watchdog_cycles).value
    }
}

/// Optional details of the EtherCAT connection.
#[derive(Clone, PartialEq, Default, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Ethercat {
    /// The SubDevice that the PLC expects, where it is not our robot node but, say, a bridge terminal.
    pub device: Option<EthercatDevice>,
}

/// A SubDevice as its ESI file describes it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct EthercatDevice {
    /// Vendor ID.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision; any, if left out.
    pub revision: Option<u32>,
    /// Process data from the PLC to the device, in bytes.
    pub output_bytes: u16,
    /// Process data from the device to the PLC, in bytes.
    pub input_bytes: u16,
}
