//! The network: a switch, a cable to the PLC, and one to each robot; on EtherCAT one cable.

use std::fs;

use anyhow::Context as _;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Interface, bridge, veth};

use super::super::plant::{MASK, PLC, address};

/// The PLC's interface.
pub(super) const PLC_INTERFACE: &str = "plc0";

const SWITCH: &str = "switch";

/// Settings of the robots' network: each address belongs to its own interface alone, as on hosts of their own (ip-sysctl: `arp_ignore`,
/// `arp_announce`, `rp_filter`).
const SEPARATE: [(&str, &str); 3] = [("arp_ignore", "1"), ("arp_announce", "2"), ("rp_filter", "0")];

/// Networks of the PLC and of the robots, with the switch between them.
#[derive(Debug)]
pub(super) struct ScaleNetwork {
    pub(super) plc: NetworkNamespace,
    pub(super) robots: NetworkNamespace,
    /// Holds the switch, which is removed with it.
    _switch: Option<NetworkNamespace>,
}

/// Returns the name of a robot's interface.
pub(super) fn robot_interface(number: u8) -> String {
    format!("robot{number}")
}

impl ScaleNetwork {
    /// Sets up the network for so many robots.
    pub(super) fn set_up(robots: u8) -> anyhow::Result<Self> {
        let [switch, plc, ends] =
            [NetworkNamespace::new()?, NetworkNamespace::new()?, NetworkNamespace::new()?];
        switch.run(|| bridge::new(SWITCH))??;
        switch.run(|| Interface::open(SWITCH)?.set_up())??;
        ends.run(separate_addresses)??;
        veth::connect(&plc, PLC_INTERFACE, &switch, "to-plc")?;
        plug(&switch, "to-plc")?;
        plc.run(|| bring_up(PLC_INTERFACE, PLC))??;
        for number in 0..robots {
            let (end, port) = (robot_interface(number), format!("to-robot{number}"));
            veth::connect(&ends, &end, &switch, &port)?;
            plug(&switch, &port)?;
            ends.run(|| bring_up(&end, address(number)))??;
        }
        Ok(Self { plc, robots: ends, _switch: Some(switch) })
    }

    /// Sets up one cable, to the first of the robots in line.
    pub(super) fn set_up_line() -> anyhow::Result<Self> {
        let [plc, robots] = [NetworkNamespace::new()?, NetworkNamespace::new()?];
        let first = robot_interface(0);
        veth::connect(&plc, PLC_INTERFACE, &robots, &first)?;
        plc.run(|| Interface::open(PLC_INTERFACE)?.set_up())??;
        robots.run(|| Interface::open(&first)?.set_up())??;
        Ok(Self { plc, robots, _switch: None })
    }
}

/// Plugs a cable's end into the switch.
fn plug(switch: &NetworkNamespace, port: &str) -> anyhow::Result<()> {
    switch.run(|| {
        let port = Interface::open(port)?;
        bridge::add_port(&Interface::open(SWITCH)?, &port)?;
        Ok(port.set_up()?)
    })?
}

fn bring_up(name: &str, address: std::net::Ipv4Addr) -> anyhow::Result<()> {
    let interface = Interface::open(name)?;
    interface.set_address(address, MASK)?;
    Ok(interface.set_up()?)
}

fn separate_addresses() -> anyhow::Result<()> {
    for (setting, value) in SEPARATE {
        let file = format!("/proc/sys/net/ipv4/conf/all/{setting}");
        fs::write(&file, value).with_context(|| format!("cannot write {value} to {file}"))?;
    }
    Ok(())
}
