//! Why a node does not run a setup of several stations, or export one of them, in words.

use std::net::Ipv4Addr;

use setup::meant_or_all;

use crate::interface_option::BusName;

/// Why a node does not run a setup of several stations.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum CellRunError {
    /// A robot node is one robot, and an export is for one.
    #[error("setup {setup} has {} robots: choose one with --station {}", stations.len(), stations.join(" or --station "))]
    NoStation {
        /// The setup's name.
        setup: String,
        /// The names of its stations.
        stations: Vec<String>,
    },
    /// No station has this name.
    #[error("setup {setup} has no station `{name}`: {}", meant_or_all(name, &stations.iter().map(String::as_str).collect::<Vec<_>>()))]
    UnknownStation {
        /// The setup's name.
        setup: String,
        /// The name.
        name: String,
        /// The names of its stations.
        stations: Vec<String>,
    },
    /// An application in place of the setup's is for one arm.
    #[error(
        "setup {0} has several stations with applications of their own: leave --application out, and write them into a setup file"
    )]
    Application(String),
    /// Images without a protocol have one sender and one receiver.
    #[error("setup {0} has several stations: leave --direct out, which connects two nodes")]
    Direct(String),
    /// A SubDevice with another one after it has one port only.
    #[error(
        "station {station} leads on to station {next} of the EtherCAT line: give it two interfaces, --interface IN,OUT"
    )]
    NoWayOn {
        /// The station.
        station: String,
        /// The next one of the line.
        next: String,
    },
    /// An EtherCAT segment is not a network of others.
    #[error(
        "bus ethercat shares interface {interface} with bus {other}: give it an interface of its own, ethercat=IF"
    )]
    SharedSegment {
        /// The interface.
        interface: String,
        /// The other bus.
        other: BusName,
    },
    /// Two buses give the PLC different addresses on one interface.
    #[error("the PLC is {} on bus {} and {} on bus {}, both on interface {interface}: give each bus an interface", addresses[0], buses[0], addresses[1], buses[1])]
    TwoAddresses {
        /// The interface.
        interface: String,
        /// The buses.
        buses: [BusName; 2],
        /// The PLC's addresses there.
        addresses: [Ipv4Addr; 2],
    },
}
