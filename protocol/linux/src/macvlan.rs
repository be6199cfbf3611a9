//! Further MAC addresses at a network interface: the kernel's macvlan, asked for over rtnetlink.
//!
//! `IFLA_LINK` is the index of the interface of the host; `IFLA_ADDRESS` the MAC address; `IFLA_NET_NS_FD` the namespace that gets
//! the new interface; `IFLA_LINKINFO` { `IFLA_INFO_KIND` "macvlan", `IFLA_INFO_DATA` { `IFLA_MACVLAN_MODE` } }.

use std::os::fd::{AsFd, AsRawFd};

use machine::ethernet::Mac;
use rustix::io::Errno;

use crate::Interface;
use crate::namespace::{NamespaceError, NetworkNamespace};
use crate::rtnetlink::{
    IFLA_IFNAME, IFLA_INFO_DATA, IFLA_INFO_KIND, IFLA_LINKINFO, IFLA_NET_NS_FD, attribute, create, name,
};

const IFLA_ADDRESS: u16 = 1;
const IFLA_LINK: u16 = 5;
const IFLA_MACVLAN_MODE: u16 = 1;

/// `MACVLAN_MODE_BRIDGE` of linux/if_link.h: the interfaces of one host also reach each other.
const BRIDGE: u32 = 4;

/// Adds an interface with a MAC address of its own to the cable of `host`, an interface of this thread's network. The new one is in
/// `network` under the name `own`, is down, and is removed with that network or with `host`.
///
/// # Errors
///
/// The kernel's error: without `CAP_NET_ADMIN` it is not permitted, and some virtual interfaces take no further addresses.
pub fn add(host: &Interface, network: &NetworkNamespace, own: &str, mac: Mac) -> Result<(), NamespaceError> {
    let data = attribute(IFLA_MACVLAN_MODE, &BRIDGE.to_ne_bytes());
    let info = [attribute(IFLA_INFO_KIND, &name("macvlan")), attribute(IFLA_INFO_DATA, &data)].concat();
    let attributes = [
        attribute(IFLA_IFNAME, &name(own)),
        attribute(IFLA_ADDRESS, &mac.0),
        attribute(IFLA_LINK, &host.index().to_ne_bytes()),
        attribute(IFLA_NET_NS_FD, &network.as_fd().as_raw_fd().to_ne_bytes()),
        attribute(IFLA_LINKINFO, &info),
    ];
    create(&attributes.concat()).map_err(|error| {
        NamespaceError::new(
            if error == Errno::OPNOTSUPP {
                "adding a MAC address to the interface (the kernel has no macvlan driver: `modprobe macvlan`)"
            } else {
                "adding a MAC address to the interface"
            },
            error,
        )
    })
}

/// Settings of a network whose interfaces are those of different stations (ip-sysctl: `arp_ignore`, `arp_announce`, `rp_filter`).
const SEPARATE: [(&str, &str); 3] = [("arp_ignore", "1"), ("arp_announce", "2"), ("rp_filter", "0")];

/// Makes each address of a network belong to its own interface alone, as on hosts of their own.
///
/// # Errors
///
/// The kernel's error.
pub fn separate_addresses(network: &NetworkNamespace) -> Result<(), NamespaceError> {
    network.run(|| {
        SEPARATE.iter().try_for_each(|(setting, value)| {
            std::fs::write(format!("/proc/sys/net/ipv4/conf/all/{setting}"), value)
                .map_err(|error| NamespaceError::new("separating the addresses of a network", error))
        })
    })?
}
