//! A switch in a network namespace: the kernel's bridge, asked of it over rtnetlink.
//!
//! `IFLA_IFNAME` is its name; `IFLA_LINKINFO` { `IFLA_INFO_KIND` "bridge", `IFLA_INFO_DATA` { `IFLA_BR_FORWARD_DELAY` } }. An
//! interface becomes a port of it by `IFLA_MASTER`.

use rustix::io::Errno;

use crate::Interface;
use crate::namespace::{NamespaceError, NetworkNamespace};
use crate::netlink::{
    self, IFLA_IFNAME, IFLA_INFO_DATA, IFLA_INFO_KIND, IFLA_LINKINFO, IFLA_MASTER, attribute, name,
};

const IFLA_BR_FORWARD_DELAY: u16 = 1;

/// Creates a bridge of this name, which is down and has no port. It is removed with the namespace.
///
/// A port forwards as soon as it is up: nobody connects two bridges in a circle, so none waits for others to report one.
///
/// # Errors
///
/// The kernel has no bridges, the name is taken, or creating one is not permitted.
pub fn create(network: &NetworkNamespace, bridge: &str) -> Result<(), NamespaceError> {
    let data = attribute(IFLA_BR_FORWARD_DELAY, &0_u32.to_ne_bytes());
    let info = [attribute(IFLA_INFO_KIND, &name("bridge")), attribute(IFLA_INFO_DATA, &data)].concat();
    let attributes = [attribute(IFLA_IFNAME, &name(bridge)), attribute(IFLA_LINKINFO, &info)].concat();
    network.run(|| netlink::create(&attributes))?.map_err(|error| {
        NamespaceError::new(
            if error == Errno::OPNOTSUPP {
                "making a bridge (the kernel has no bridges: `modprobe bridge`)"
            } else {
                "making a bridge"
            },
            error,
        )
    })
}

/// Makes an interface a port of a bridge in the same namespace.
///
/// # Errors
///
/// The interface is a port already, or it may not be one.
pub fn attach(
    network: &NetworkNamespace,
    port: &Interface,
    bridge: &Interface,
) -> Result<(), NamespaceError> {
    let attributes = attribute(IFLA_MASTER, &bridge.index().to_ne_bytes());
    network
        .run(|| netlink::change(port.index(), &attributes))?
        .map_err(|error| NamespaceError::new("making an interface a port of a bridge", error))
}
