//! Questions to the kernel about network interfaces, over rtnetlink: the message `RTM_NEWLINK` and its answer (rtnetlink(7);
//! numbers in native byte order, every attribute padded to 4 bytes).
//!
//! | bytes | content |
//! |---|---|
//! | 0..16 | nlmsghdr: length u32, type u16, flags u16, sequence u32, port u32 |
//! | 16..32 | ifinfomsg: family u8, pad u8, type u16, index i32, flags u32, change u32 |
//! | then | attributes: length u16 (with this head), type u16, value |

use rustix::io::Errno;
use rustix::net::netlink::SocketAddrNetlink;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType, recv, sendto, socket_with};

const RTM_NEWLINK: u16 = 16;
const NLMSG_ERROR: u16 = 2;
/// NLM_F_REQUEST | NLM_F_ACK
const CHANGE: u16 = 0x0001 | 0x0004;
/// NLM_F_EXCL | NLM_F_CREATE
const NEW: u16 = 0x0200 | 0x0400;

pub(crate) const IFLA_IFNAME: u16 = 3;
pub(crate) const IFLA_MASTER: u16 = 10;
pub(crate) const IFLA_LINKINFO: u16 = 18;
pub(crate) const IFLA_NET_NS_FD: u16 = 28;
pub(crate) const IFLA_INFO_KIND: u16 = 1;
pub(crate) const IFLA_INFO_DATA: u16 = 2;

/// An ifinfomsg of an interface that does not exist yet.
pub(crate) const IFINFOMSG: [u8; 16] = [0; 16];

/// Asks for a new interface with these attributes.
pub(crate) fn create(attributes: &[u8]) -> Result<(), Errno> {
    ask(&request(CHANGE | NEW, &IFINFOMSG, attributes))
}

/// Asks to change the attributes of the interface with this index.
pub(crate) fn change(index: u32, attributes: &[u8]) -> Result<(), Errno> {
    let mut of_interface = IFINFOMSG;
    of_interface[4..8].copy_from_slice(&index.to_ne_bytes());
    ask(&request(CHANGE, &of_interface, attributes))
}

fn request(flags: u16, of_interface: &[u8; 16], attributes: &[u8]) -> Vec<u8> {
    let length = 16 + of_interface.len() + attributes.len();
    let mut message = Vec::with_capacity(length);
    message.extend_from_slice(&(length as u32).to_ne_bytes());
    message.extend_from_slice(&RTM_NEWLINK.to_ne_bytes());
    message.extend_from_slice(&flags.to_ne_bytes());
    message.extend_from_slice(&[0; 8]);
    message.extend_from_slice(of_interface);
    message.extend_from_slice(attributes);
    message
}

pub(crate) fn attribute(kind: u16, value: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(value.len() + 8);
    bytes.extend_from_slice(&((value.len() + 4) as u16).to_ne_bytes());
    bytes.extend_from_slice(&kind.to_ne_bytes());
    bytes.extend_from_slice(value);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

/// Encodes a name, which ends with a zero byte.
pub(crate) fn name(text: &str) -> Vec<u8> {
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
