//! The IPv4 address that an interface had before a node used it.

use std::net::Ipv4Addr;

use crate::Interface;

/// Gives an interface its former IPv4 address back when it is dropped, or takes its address away where it had none.
///
/// A station that is switched off answers to no address. The kernel would go on answering ARP requests for it: the station
/// that replaces it could not get the address. An address that somebody else gave the interface meanwhile stays.
#[derive(Debug)]
pub struct FormerAddress {
    interface: Interface,
    address: Ipv4Addr,
    mask: Ipv4Addr,
}

impl FormerAddress {
    /// Keeps the address that `interface` has now.
    #[must_use]
    pub fn of(interface: &Interface) -> Self {
        let address = interface.address().unwrap_or(Ipv4Addr::UNSPECIFIED);
        let mask = interface.mask().unwrap_or(Ipv4Addr::UNSPECIFIED);
        Self { interface: interface.clone(), address, mask }
    }
}

impl Drop for FormerAddress {
    fn drop(&mut self) {
        if self.interface.has_given_address() {
            // An interface that no longer exists has no address either.
            let _ = self.interface.set_address(self.address, self.mask);
        }
    }
}
