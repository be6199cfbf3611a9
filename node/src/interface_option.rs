//! The option `--interface`: one network interface for all buses of a node, or one for each bus.

use std::str::FromStr;

/// Name of a kind of bus, as it stands in a setup.
pub type BusName = &'static str;

/// Every kind of bus.
const BUSES: [BusName; 3] = ["profinet", "ethernet-ip", ETHERCAT];

/// The bus whose stations are in line.
const ETHERCAT: BusName = "ethercat";

/// Network interfaces for the buses of a node, each by its name or its IPv4 address: `eth0` for all buses, or
/// `profinet=eth0,ethernet-ip=eth1`; or `eth0,eth1` for the two ports of a SubDevice in an EtherCAT line.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum InterfaceOption {
    /// One interface for all buses.
    All(String),
    /// An interface for each bus, in the order of the option. No bus is in it twice.
    Each(Vec<(BusName, String)>),
    /// The ports of a SubDevice: towards the MainDevice, and to the next SubDevice.
    InOut([String; 2]),
}

/// Why the interfaces of an option cannot be those of a node.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum InterfaceOptionError {
    /// A part names an interface and not its bus.
    #[error("`{0}` has no bus: write BUS=IF for each bus, as in profinet=eth0,ethernet-ip=eth1")]
    NoBus(String),
    /// No bus has this name.
    #[error("`{0}` is not a bus: write profinet=IF, ethernet-ip=IF or ethercat=IF")]
    UnknownBus(String),
    /// A bus has no interface behind its `=`.
    #[error("bus {0} has no interface: write {0}=IF with a name or an IPv4 address")]
    NoInterface(BusName),
    /// A bus is there twice.
    #[error("bus {0} has two interfaces in --interface: give it one")]
    Twice(BusName),
    /// The setup has no such bus.
    #[error("the setup has no {bus} bus, only {}: leave {bus}=IF out of --interface", of_setup.join(" and "))]
    NotInSetup {
        /// The bus.
        bus: BusName,
        /// Buses of the setup.
        of_setup: Vec<BusName>,
    },
    /// Two interfaces without a bus, for a bus whose stations have one port.
    #[error("`{}` are two ports, which only a robot on EtherCAT has: give one interface, or BUS=IF for each bus", .0.join(","))]
    TwoPorts([String; 2]),
    /// Both ports of a SubDevice are one interface.
    #[error(
        "interface {0} is both ports of the SubDevice: give --interface IN,OUT two, or one for the last of the line"
    )]
    OnePort(String),
    /// A bus of the setup has no interface.
    #[error("bus {0} of the setup has no interface: add {0}=IF to --interface")]
    LeftOut(BusName),
}

impl FromStr for InterfaceOption {
    type Err = InterfaceOptionError;

    fn from_str(text: &str) -> Result<Self, InterfaceOptionError> {
        if !text.contains(['=', ',']) {
            return Ok(Self::All(text.to_owned()));
        }
        if let Some((inward, outward)) = text.split_once(',').filter(|_| !text.contains('='))
            && let ports = [inward, outward].map(|port| port.trim().to_owned())
            && ports.iter().all(|port| !port.is_empty() && !port.contains(','))
        {
            return Ok(Self::InOut(ports));
        }
        let mut each: Vec<(BusName, String)> = Vec::new();
        for part in text.split(',').map(str::trim) {
            let Some((bus, interface)) = part.split_once('=') else {
                return Err(InterfaceOptionError::NoBus(part.to_owned()));
            };
            let Some(bus) = BUSES.into_iter().find(|known| *known == bus.trim()) else {
                return Err(InterfaceOptionError::UnknownBus(bus.trim().to_owned()));
            };
            if interface.trim().is_empty() {
                return Err(InterfaceOptionError::NoInterface(bus));
            }
            if each.iter().any(|(other, _)| *other == bus) {
                return Err(InterfaceOptionError::Twice(bus));
            }
            each.push((bus, interface.trim().to_owned()));
        }
        Ok(Self::Each(each))
    }
}

impl InterfaceOption {
    /// Returns the interface of each of a setup's buses, in their order.
    ///
    /// # Errors
    ///
    /// The option names a bus that the setup does not have, or leaves one out.
    pub fn for_buses(&self, buses: &[BusName]) -> Result<Vec<&str>, InterfaceOptionError> {
        let each = match self {
            Self::All(interface) => return Ok(buses.iter().map(|_| interface.as_str()).collect()),
            Self::Each(each) => each,
            Self::InOut(ports) => return Err(InterfaceOptionError::TwoPorts(ports.clone())),
        };
        if let Some((bus, _)) = each.iter().find(|(bus, _)| !buses.contains(bus)) {
            return Err(InterfaceOptionError::NotInSetup { bus, of_setup: buses.to_vec() });
        }
        let interface = |bus: &BusName| {
            let found = each.iter().find(|(other, _)| other == bus);
            found.map(|(_, interface)| interface.as_str()).ok_or(InterfaceOptionError::LeftOut(bus))
        };
        buses.iter().map(interface).collect()
    }

    /// Returns the interfaces of a robot on this bus: one, or the two ports of a SubDevice.
    ///
    /// # Errors
    ///
    /// The option is for another bus, or has two ports for a bus whose stations have one.
    pub fn ports_of(&self, bus: BusName) -> Result<Vec<&str>, InterfaceOptionError> {
        match self {
            Self::InOut(ports) if bus == ETHERCAT => Ok(ports.iter().map(String::as_str).collect()),
            _ => self.for_buses(&[bus]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        text.parse::<InterfaceOption>().unwrap_err().to_string()
    }

    #[test]
    fn one_interface_serves_every_bus() {
        let option: InterfaceOption = "eth0".parse().unwrap();
        assert_eq!(option.for_buses(&[BUSES[0]]), Ok(vec!["eth0"]));
        assert_eq!(option.for_buses(&BUSES), Ok(vec!["eth0"; 3]));
    }

    #[test]
    fn each_bus_gets_its_interface_in_the_order_of_the_setup() {
        let option: InterfaceOption = "ethernet-ip=10.0.0.1, profinet=eth0".parse().unwrap();
        let buses = [BUSES[0], BUSES[1]];
        assert_eq!(option.for_buses(&buses), Ok(vec!["eth0", "10.0.0.1"]));
        let same: InterfaceOption = "profinet=eth0,ethernet-ip=eth0".parse().unwrap();
        assert_eq!(same.for_buses(&buses), Ok(vec!["eth0", "eth0"]));
    }

    #[test]
    fn the_bus_of_every_built_in_setup_may_be_named() {
        for name in ["A", "B", "C", "D"] {
            let bus = setup::setup(name).unwrap().bus.kind.name();
            let option: InterfaceOption = format!("{bus}=eth0").parse().unwrap();
            assert_eq!(option.for_buses(&[bus]), Ok(vec!["eth0"]), "setup {name}");
        }
    }

    #[test]
    fn a_bus_that_the_setup_does_not_have_and_one_that_is_left_out_are_named() {
        let option: InterfaceOption = "profinet=eth0,ethercat=eth1".parse().unwrap();
        assert_eq!(
            option.for_buses(&[BUSES[0], BUSES[1]]).unwrap_err().to_string(),
            "the setup has no ethercat bus, only profinet and ethernet-ip: leave ethercat=IF out of --interface"
        );
        let all = option.for_buses(&BUSES).unwrap_err().to_string();
        assert_eq!(all, "bus ethernet-ip of the setup has no interface: add ethernet-ip=IF to --interface");
    }

    #[test]
    fn a_robot_on_ethercat_may_have_two_ports_and_no_other_node() {
        let option: InterfaceOption = "eth0, eth1".parse().unwrap();
        assert_eq!(option.ports_of("ethercat"), Ok(vec!["eth0", "eth1"]));
        let refused = "`eth0,eth1` are two ports, which only a robot on EtherCAT has: give one interface, or BUS=IF for each bus";
        for other in [option.ports_of("profinet"), option.for_buses(&BUSES[2..])] {
            assert_eq!(other.unwrap_err().to_string(), refused);
        }
        for (text, ports) in [("eth0", ["eth0"]), ("ethercat=eth1", ["eth1"])] {
            let option: InterfaceOption = text.parse().unwrap();
            assert_eq!(option.ports_of("ethercat"), Ok(ports.to_vec()));
        }
    }

    #[test]
    fn a_bus_is_named_once_and_with_an_interface() {
        assert_eq!(
            error("profinet=eth0,profinet=eth1"),
            "bus profinet has two interfaces in --interface: give it one"
        );
        let without = "bus ethercat has no interface: write ethercat=IF with a name or an IPv4 address";
        assert_eq!(error("profinet=eth0,ethercat="), without);
        assert_eq!(
            error("profibus=eth0"),
            "`profibus` is not a bus: write profinet=IF, ethernet-ip=IF or ethercat=IF"
        );
        for (text, part) in [
            ("eth0,", "eth0"),
            ("eth0,eth1,eth2", "eth0"),
            ("profinet=eth0,eth1", "eth1"),
            ("profinet=eth0,", ""),
        ] {
            assert_eq!(
                error(text),
                format!(
                    "`{part}` has no bus: write BUS=IF for each bus, as in profinet=eth0,ethernet-ip=eth1"
                )
            );
        }
    }
}
