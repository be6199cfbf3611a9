//! Another station that keeps an AR from its device, in words.

use core::fmt;
use core::net::Ipv4Addr;

use super::down_reasons;
use machine::ethernet::Mac;

/// Another station that keeps the AR from the device.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Obstacle {
    /// Both have the device's name.
    Twins([Mac; 2]),
    /// `other` has the IP address that `device` has or is to have.
    Address { address: Ipv4Addr, device: Mac, other: Mac },
    /// `other` has the IP address of the controller.
    OwnAddress { address: Ipv4Addr, other: Mac },
    /// The host would send to `other` what is for `device`.
    Neighbour { address: Ipv4Addr, device: Mac, other: Mac },
}

impl Obstacle {
    /// Returns it as a constant text, without addresses.
    pub(super) const fn text(self) -> &'static str {
        match self {
            Self::Twins(_) => down_reasons::NAME_TWICE,
            Self::Address { .. } => down_reasons::ADDRESS_TWICE,
            Self::OwnAddress { .. } => down_reasons::OWN_ADDRESS_TWICE,
            Self::Neighbour { .. } => down_reasons::WRONG_NEIGHBOUR,
        }
    }
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Twins([first, second]) => write!(
                f,
                "two stations answer to the device's name: {first} and {second}; rename one of them, or configure the MAC \
                 address of the right one"
            ),
            Self::Address { address, device, other } => write!(
                f,
                "another station has this IP address: {address} of the device {device} is also that of {other}; give one of \
                 them another address"
            ),
            Self::OwnAddress { address, other } => write!(
                f,
                "another station has this IP address: {address} of this controller is also that of {other}; give one of them \
                 another address"
            ),
            Self::Neighbour { address, device, other } => write!(
                f,
                "another station has this IP address in the host's table: {address} is {other}, but the device is {device}; \
                 allow CAP_NET_ADMIN, or run `ip neigh flush {address}`"
            ),
        }
    }
}
