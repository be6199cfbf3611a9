//! A switch in a network namespace: the kernel's bridge, asked for over rtnetlink.
//!
//! `IFLA_LINKINFO` { `IFLA_INFO_KIND` "bridge", `IFLA_INFO_DATA` { `IFLA_BR_FORWARD_DELAY` } }; `IFLA_MASTER` of an interface is
//! the index of the bridge whose port it is.

use rustix::io::Errno;

use crate::Interface;
use crate::namespace::NamespaceError;
use crate::rtnetlink::{
    IFLA_IFNAME, IFLA_INFO_DATA, IFLA_INFO_KIND, IFLA_LINKINFO, IFLA_MASTER, attribute, change, create, name,
};

const IFLA_BR_FORWARD_DELAY: u16 = 1;

/// Creates a bridge in this thread's network, without a spanning tree, whose ports forward as soon as they are up. It is down.
///
/// # Errors
///
/// The kernel's error.
pub fn new(bridge: &str) -> Result<(), NamespaceError> {
    let data = attribute(IFLA_BR_FORWARD_DELAY, &0_u32.to_ne_bytes());
    let info = [attribute(IFLA_INFO_KIND, &name("bridge")), attribute(IFLA_INFO_DATA, &data)].concat();
    let attributes = [attribute(IFLA_IFNAME, &name(bridge)), attribute(IFLA_LINKINFO, &info)].concat();
    create(&attributes).map_err(|error| {
        NamespaceError::new(
            if error == Errno::OPNOTSUPP {
                "making a bridge (the kernel has no bridge driver: `modprobe bridge`)"
            } else {
                "making a bridge"
            },
            error,
        )
    })
}

/// Makes an interface a port of a bridge; both are in this thread's network.
///
/// # Errors
///
/// The kernel's error.
pub fn add_port(bridge: &Interface, port: &Interface) -> Result<(), NamespaceError> {
    change(port.index(), &attribute(IFLA_MASTER, &bridge.index().to_ne_bytes()))
        .map_err(|error| NamespaceError::new("adding a port to a bridge", error))
}
