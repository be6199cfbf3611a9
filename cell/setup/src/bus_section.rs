//! The section `[bus]` as it stands in a file: `kind`, and beside it keys and sections that only some buses read.
//!
//! It is resolved once, into a [`Bus`] that has what its kind needs and nothing else. What other buses would read may
//! stay in the file, so that one word changes the bus.

use std::net::Ipv4Addr;

use device_files::ChosenDevice;
use serde::de::{Deserializer, Error};
use serde::ser::Serializer;
use serde::{Deserialize, Serialize};

use crate::{Addresses, Bus, BusKind, DevicePaths, Ethercat, EthernetIp, Peer, Profinet, Sourced};

/// The fieldbus. Keys that only other buses need may stay in the file. The keys are written in this order.
#[derive(Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
struct BusSection {
    /// Which fieldbus.
    kind: Kind,
    /// Time from one cyclic frame to the next, each way, in µs.
    cycle_us: Sourced<u32>,
    /// Cycles without a frame after which a side gives the connection up.
    watchdog_cycles: Sourced<u32>,
    /// One way over the cable, in µs. Modelled in virtual mode.
    cable_delay_us: Sourced<u32>,
    /// How far the nodes' clocks may be off, in parts per million. Modelled in virtual mode.
    clock_drift_ppm: Sourced<u32>,
    /// The PLC's IPv4 address; needed by PROFINET and EtherNet/IP.
    plc_address: Option<Ipv4Addr>,
    /// The robot's IPv4 address; needed by PROFINET and EtherNet/IP.
    robot_address: Option<Ipv4Addr>,
    /// Both nodes' subnet mask; needed by PROFINET and EtherNet/IP.
    subnet_mask: Option<Ipv4Addr>,
    /// PLCs that the robot node accepts; every one if the list is empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    allowed_plcs: Vec<Peer>,
    /// Properties that the PLC node checks besides the name or address of the robot.
    robot: Option<Peer>,
    /// File of the robot's device, a GSDML, EDS or ESI: identity, lengths and start-up come from it, and the robot node is that
    /// device. The path is relative to this file's directory.
    device: Option<String>,
    /// Choice from `device`, a TOML file as `plc-node io --print-config` writes it. Needed where the file leaves a choice.
    config: Option<String>,
    /// Device that was chosen from `device`, as a run writes it into its copy of a setup.
    #[cfg_attr(test, schemars(with = "Option<serde_json::Map<String, serde_json::Value>>"))]
    chosen_device: Option<Box<ChosenDevice>>,
    /// Details of the PROFINET connection.
    profinet: Option<Profinet>,
    /// Optional details of the EtherNet/IP connection.
    ethernet_ip: Option<EthernetIp>,
    /// Optional details of the EtherCAT connection.
    ethercat: Option<Ethercat>,
}

/// Which fieldbus.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
enum Kind {
    /// PROFINET IO: the PLC is the IO-Controller, the robot the IO-Device.
    Profinet,
    /// EtherNet/IP: the PLC is the scanner, the robot the adapter.
    EthernetIp,
    /// EtherCAT: the PLC is the MainDevice, the robot a SubDevice.
    Ethercat,
}

impl Kind {
    /// Returns the line of this kind in a file.
    const fn line(self) -> &'static str {
        match self {
            Self::Profinet => "kind = \"profinet\"",
            Self::EthernetIp => "kind = \"ethernet-ip\"",
            Self::Ethercat => "kind = \"ethercat\"",
        }
    }
}

/// The section lacks what another key of it needs, such as the kind of the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("`{of}` needs {wanted}")]
struct Missing {
    of: &'static str,
    wanted: &'static str,
}

impl<'de> Deserialize<'de> for Bus {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        BusSection::deserialize(deserializer)?.resolve().map_err(D::Error::custom)
    }
}

impl Serialize for Bus {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        BusSection::of(self.clone()).serialize(serializer)
    }
}

impl BusSection {
    fn addresses(&self) -> Result<Addresses, Missing> {
        let lacks = |wanted| Missing { of: self.kind.line(), wanted };
        Ok(Addresses {
            plc: self.plc_address.ok_or(lacks("the key `plc_address`"))?,
            robot: self.robot_address.ok_or(lacks("the key `robot_address`"))?,
            mask: self.subnet_mask.ok_or(lacks("the key `subnet_mask`"))?,
        })
    }

    fn resolve(self) -> Result<Bus, Missing> {
        let lacks = |wanted| Missing { of: self.kind.line(), wanted };
        let kind = match self.kind {
            Kind::Profinet => {
                let addresses = self.addresses()?;
                BusKind::Profinet(addresses, self.profinet.ok_or(lacks("a section [bus.profinet]"))?)
            }
            Kind::EthernetIp => BusKind::EthernetIp(self.addresses()?, self.ethernet_ip.unwrap_or_default()),
            Kind::Ethercat => BusKind::Ethercat(self.ethercat.unwrap_or_default()),
        };
        let Self { cycle_us, watchdog_cycles, cable_delay_us, clock_drift_ppm, allowed_plcs, robot, .. } =
            self;
        let device_paths = match (self.device, self.config) {
            (Some(device), config) => Some(DevicePaths { device, config }),
            (None, Some(_)) => {
                return Err(Missing { of: "config", wanted: "the key `device`, a device file" });
            }
            (None, None) => None,
        };
        Ok(Bus {
            kind,
            cycle_us,
            watchdog_cycles,
            cable_delay_us,
            clock_drift_ppm,
            allowed_plcs,
            robot,
            device_paths,
            device: self.chosen_device,
        })
    }

    fn of(bus: Bus) -> Self {
        let Bus {
            kind, cycle_us, watchdog_cycles, cable_delay_us, clock_drift_ppm, allowed_plcs, robot, ..
        } = bus;
        let (device, config) =
            bus.device_paths.map_or((None, None), |paths| (Some(paths.device), paths.config));
        let (mut profinet, mut ethernet_ip, mut ethercat) = (None, None, None);
        let (kind, addresses) = match kind {
            BusKind::Profinet(addresses, section) => {
                profinet = Some(section);
                (Kind::Profinet, Some(addresses))
            }
            BusKind::EthernetIp(addresses, section) => {
                ethernet_ip = (section != EthernetIp::default()).then_some(section);
                (Kind::EthernetIp, Some(addresses))
            }
            BusKind::Ethercat(section) => {
                ethercat = (section != Ethercat::default()).then_some(section);
                (Kind::Ethercat, None)
            }
        };
        Self {
            kind,
            cycle_us,
            watchdog_cycles,
            cable_delay_us,
            clock_drift_ppm,
            plc_address: addresses.map(|addresses| addresses.plc),
            robot_address: addresses.map(|addresses| addresses.robot),
            subnet_mask: addresses.map(|addresses| addresses.mask),
            allowed_plcs,
            robot,
            device,
            config,
            chosen_device: bus.device,
            profinet,
            ethernet_ip,
            ethercat,
        }
    }
}

#[cfg(test)]
impl schemars::JsonSchema for Bus {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Bus".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        BusSection::json_schema(generator)
    }
}
