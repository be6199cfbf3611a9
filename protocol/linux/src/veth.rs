//! A cable between two network namespaces: a veth pair, asked of the kernel over rtnetlink.
//!
//! The one message, `RTM_NEWLINK` (rtnetlink(7); numbers in native byte order, every attribute padded to 4 bytes):
//!
//! | bytes | content |
//! |---|---|
//! | 0..16 | nlmsghdr: length u32, type u16, flags u16, sequence u32, port u32 |
//! | 16..32 | ifinfomsg: family u8, pad u8, type u16, index i32, flags u32, change u32 |
//! | then | attributes: length u16 (with this head), type u16, value |
//!
//! `IFLA_IFNAME` is this end's name; `IFLA_LINKINFO` { `IFLA_INFO_KIND` "veth", `IFLA_INFO_DATA` { `VETH_INFO_PEER`:
//! an ifinfomsg and the other end's `IFLA_IFNAME` and `IFLA_NET_NS_FD` } }.

use std::os::fd::{AsFd, AsRawFd};

use rustix::io::Errno;
use rustix::net::netlink::SocketAddrNetlink;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType, recv, sendto, socket_with};

use crate::namespace::{NamespaceError, NetworkNamespace};

const RTM_NEWLINK: u16 = 16;
const NLMSG_ERROR: u16 = 2;
/// NLM_F_REQUEST | NLM_F_ACK | NLM_F_EXCL | NLM_F_CREATE
const FLAGS: u16 = 0x0001 | 0x0004 | 0x0200 | 0x0400;

const IFLA_IFNAME: u16 = 3;
const IFLA_LINKINFO: u16 = 18;
const IFLA_NET_NS_FD: u16 = 28;
const IFLA_INFO_KIND: u16 = 1;
const IFLA_INFO_DATA: u16 = 2;
const VETH_INFO_PEER: u16 = 1;

const IFINFOMSG: [u8; 16] = [0; 16];

/// Creates a cable: interface `a_name` in namespace `a` and `b_name` in `b`, both down. It is removed with either
/// namespace.
pub fn connect(
    a: &NetworkNamespace,
    a_name: &str,
    b: &NetworkNamespace,
    b_name: &str,
) -> Result<(), NamespaceError> {
    let request = request(a_name, b_name, b.as_fd().as_raw_fd());
    a.run(|| ask(&request))?.map_err(|error| {
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

fn request(a_name: &str, b_name: &str, b_namespace: i32) -> Vec<u8> {
    let peer = [
        IFINFOMSG.to_vec(),
        attribute(IFLA_IFNAME, &name(b_name)),
        attribute(IFLA_NET_NS_FD, &b_namespace.to_ne_bytes()),
    ]
    .concat();
    let data = attribute(VETH_INFO_PEER, &peer);
    let info = [attribute(IFLA_INFO_KIND, &name("veth")), attribute(IFLA_INFO_DATA, &data)].concat();
    let body =
        [IFINFOMSG.to_vec(), attribute(IFLA_IFNAME, &name(a_name)), attribute(IFLA_LINKINFO, &info)].concat();
    let mut message = Vec::with_capacity(16 + body.len());
    message.extend_from_slice(&((16 + body.len()) as u32).to_ne_bytes());
    message.extend_from_slice(&RTM_NEWLINK.to_ne_bytes());
    message.extend_from_slice(&FLAGS.to_ne_bytes());
    message.extend_from_slice(&[0; 8]);
    message.extend_from_slice(&body);
    message
}

fn attribute(kind: u16, value: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(value.len() + 8);
    bytes.extend_from_slice(&((value.len() + 4) as u16).to_ne_bytes());
    bytes.extend_from_slice(&kind.to_ne_bytes());
    bytes.extend_from_slice(value);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

/// Encodes a name, which ends with a zero byte.
fn name(text: &str) -> Vec<u8> {
    [text.as_bytes(), &[0]].concat()
}

fn ask(message: &[u8]) -> Result<(), Errno> {
    let socket = socket_with(AddressFamily::NETLINK, SocketType::RAW, SocketFlags::CLOEXEC, None)?;
    sendto(&socket, message, SendFlags::empty(), &SocketAddrNetlink::new(0, 0))?;
    let mut answer = [0; 4096];
    let (len, _) = recv(&socket, &mut answer[..], RecvFlags::empty())?;
    // The response is an nlmsghdr and, as its type is NLMSG_ERROR, a negative errno, or 0 for success.
    let answer = answer.get(..len).unwrap_or_default();
    let kind = answer.get(4..6).and_then(|bytes| bytes.try_into().ok()).map(u16::from_ne_bytes);
    let error = answer.get(16..20).and_then(|bytes| bytes.try_into().ok()).map(i32::from_ne_bytes);
    match (kind, error) {
        (Some(NLMSG_ERROR), Some(0)) => Ok(()),
        (Some(NLMSG_ERROR), Some(error)) => Err(Errno::from_raw_os_error(error.saturating_neg())),
        _ => Err(Errno::PROTO),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_length_of_an_attribute_includes_its_header_but_not_its_padding() {
        assert_eq!(attribute(IFLA_IFNAME, b"ab\0"), [7, 0, 3, 0, b'a', b'b', 0, 0]);
    }
}
