//! The section `[bus]` as it stands in a file: `kind`, and beside it keys and sections that only some buses read.
//!
//! It is resolved once, into a [`Bus`] that has what its kind needs and nothing else. What other buses would read may
//! stay in the file, so that one word changes the bus.

use std::net::Ipv4Addr;

use serde::de::{Deserializer, Error};
use serde::ser::Serializer;
use serde::{Deserialize, Serialize};

use crate::{Addresses, Bus, BusKind, Ethercat, EthernetIp, Peer, Profinet, Sourced};

/// The section, with its keys in the order in which they are written.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BusSection {
    kind: Kind,
    cycle_us: Sourced<u32>,
    watchdog_cycles: Sourced<u32>,
    cable_delay_us: Sourced<u32>,
    clock_drift_ppm: Sourced<u32>,
    plc_address: Option<Ipv4Addr>,
    robot_address: Option<Ipv4Addr>,
    subnet_mask: Option<Ipv4Addr>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    allowed_plcs: Vec<Peer>,
    robot: Option<Peer>,
    profinet: Option<Profinet>,
    ethernet_ip: Option<EthernetIp>,
    ethercat: Option<Ethercat>,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    Profinet,
    EthernetIp,
    Ethercat,
}

impl Kind {
    const fn name(self) -> &'static str {
        match self {
            Self::Profinet => "profinet",
            Self::EthernetIp => "ethernet-ip",
            Self::Ethercat => "ethercat",
        }
    }
}

/// The section lacks what the bus of its kind needs.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("`kind = \"{kind}\"` needs {wanted}")]
struct Missing {
    kind: &'static str,
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
        let lacks = |wanted| Missing { kind: self.kind.name(), wanted };
        Ok(Addresses {
            plc: self.plc_address.ok_or(lacks("the key `plc_address`"))?,
            robot: self.robot_address.ok_or(lacks("the key `robot_address`"))?,
            mask: self.subnet_mask.ok_or(lacks("the key `subnet_mask`"))?,
        })
    }

    fn resolve(self) -> Result<Bus, Missing> {
        let lacks = |wanted| Missing { kind: self.kind.name(), wanted };
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
        Ok(Bus { kind, cycle_us, watchdog_cycles, cable_delay_us, clock_drift_ppm, allowed_plcs, robot })
    }

    fn of(bus: Bus) -> Self {
        let Bus { kind, cycle_us, watchdog_cycles, cable_delay_us, clock_drift_ppm, allowed_plcs, robot } =
            bus;
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
            profinet,
            ethernet_ip,
            ethercat,
        }
    }
}
