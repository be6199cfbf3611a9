//! A cable between two network namespaces: a veth pair, asked of the kernel over rtnetlink.
//!
//! `IFLA_IFNAME` is this end's name; `IFLA_LINKINFO` { `IFLA_INFO_KIND` "veth", `IFLA_INFO_DATA` { `VETH_INFO_PEER`:
//! an ifinfomsg and the other end's `IFLA_IFNAME` and `IFLA_NET_NS_FD` } }.

use std::os::fd::{AsFd, AsRawFd};

use rustix::io::Errno;

use crate::namespace::{NamespaceError, NetworkNamespace};
use crate::rtnetlink::{
    IFINFOMSG, IFLA_IFNAME, IFLA_INFO_DATA, IFLA_INFO_KIND, IFLA_LINKINFO, IFLA_NET_NS_FD, attribute, create,
    name,
};

const VETH_INFO_PEER: u16 = 1;

/// Creates a cable: interface `a_name` in namespace `a` and `b_name` in `b`, both down. It is removed with either
/// namespace.
pub fn connect(
    a: &NetworkNamespace,
    a_name: &str,
    b: &NetworkNamespace,
    b_name: &str,
) -> Result<(), NamespaceError> {
    let attributes = attributes(a_name, b_name, b.as_fd().as_raw_fd());
    a.run(|| create(&attributes))?.map_err(|error| {
        NamespaceError::new(
            if error == Errno::OPNOTSUPP {
                "making a veth pair (the kernel has no veth driver: `modprobe veth`)"
            } else {
                "making a veth pair"
            },
            error,
        )
    })
}

fn attributes(a_name: &str, b_name: &str, b_namespace: i32) -> Vec<u8> {
    let peer = [
        IFINFOMSG.to_vec(),
        attribute(IFLA_IFNAME, &name(b_name)),
        attribute(IFLA_NET_NS_FD, &b_namespace.to_ne_bytes()),
    ]
    .concat();
    let data = attribute(VETH_INFO_PEER, &peer);
    let info = [attribute(IFLA_INFO_KIND, &name("veth")), attribute(IFLA_INFO_DATA, &data)].concat();
    [attribute(IFLA_IFNAME, &name(a_name)), attribute(IFLA_LINKINFO, &info)].concat()
}
