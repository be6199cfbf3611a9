//! The network: one cable, at whose far end each robot has an interface with addresses of its own (macvlan); on EtherCAT
//! the first robot in line has the cable's end.
//!
//! Each frame passes one cable and no switch of this host, whose work the PLC's core would do for the frames that it sends.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Interface, macvlan, veth};

use super::super::plant::{MASK, PLC, address};

/// The PLC's interface.
pub(super) const PLC_INTERFACE: &str = "plc0";

/// The cable's end at the robots.
const ROBOTS_END: &str = "robots";

/// Networks of the PLC and of the robots, with the cable between them.
#[derive(Debug)]
pub(super) struct ScaleNetwork {
    pub(super) plc: NetworkNamespace,
    pub(super) robots: NetworkNamespace,
}

/// Returns the name of a robot's interface.
pub(super) fn robot_interface(number: u8) -> String {
    format!("robot{number}")
}

impl ScaleNetwork {
    /// Sets up the network for so many robots.
    pub(super) fn set_up(robots: u8) -> anyhow::Result<Self> {
        let own = Self::with_cable(ROBOTS_END)?;
        macvlan::separate_addresses(&own.robots)?;
        own.plc.run(|| Interface::open(PLC_INTERFACE)?.set_address(PLC, MASK))??;
        own.robots.run(|| {
            let end = Interface::open(ROBOTS_END)?;
            (0..robots).try_for_each(|number| {
                macvlan::add(&end, &own.robots, &robot_interface(number), mac(number))?;
                bring_up(&robot_interface(number), address(number))
            })
        })??;
        Ok(own)
    }

    /// Sets up one cable, to the first of the robots in line.
    pub(super) fn set_up_line() -> anyhow::Result<Self> {
        Self::with_cable(&robot_interface(0))
    }

    fn with_cable(robots_end: &str) -> anyhow::Result<Self> {
        let [plc, robots] = [NetworkNamespace::new()?, NetworkNamespace::new()?];
        veth::connect(&plc, PLC_INTERFACE, &robots, robots_end)?;
        plc.run(|| Interface::open(PLC_INTERFACE)?.set_up())??;
        robots.run(|| Interface::open(robots_end)?.set_up())??;
        Ok(Self { plc, robots })
    }
}

/// Returns a robot's MAC address: a locally administered one.
const fn mac(number: u8) -> Mac {
    Mac([0x02, 0, 0, 0, 1, number])
}

fn bring_up(name: &str, address: Ipv4Addr) -> anyhow::Result<()> {
    let interface = Interface::open(name)?;
    interface.set_address(address, MASK)?;
    Ok(interface.set_up()?)
}
