//! The peers that a station may connect to or be connected by, if its owner lists them.

use alloc::vec::Vec;
use core::net::Ipv4Addr;

use crate::ethernet::Mac;

/// What is listed of a peer. The sender of a frame can forge each of these values.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Peer {
    /// IP address.
    pub address: Option<Ipv4Addr>,
    /// MAC address.
    pub mac: Option<Mac>,
    /// Serial number of the device, as EtherNet/IP tells it.
    pub serial_number: Option<u32>,
}

/// A list of peers. An empty list allows everybody.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct Allowed(pub Vec<Peer>);

impl Allowed {
    /// Returns whether a peer is allowed: an entry of the list has nothing that differs from what is known of the peer.
    #[must_use]
    pub fn allows(&self, known: Peer) -> bool {
        fn fits<T: PartialEq>(listed: Option<T>, known: Option<T>) -> bool {
            listed.is_none() || known.is_none() || listed == known
        }
        let is_it = |listed: &Peer| {
            fits(listed.address, known.address)
                && fits(listed.mac, known.mac)
                && fits(listed.serial_number, known.serial_number)
        };
        self.0.is_empty() || self.0.iter().any(is_it)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_list_allows_everybody_and_any_other_only_who_differs_from_one_of_its_entries_in_nothing_known()
     {
        let (mac, other) = (Mac([2, 0, 0, 0, 0, 1]), Mac([2, 0, 0, 0, 0, 9]));
        let (address, elsewhere) = (Ipv4Addr::new(10, 0, 0, 1), Ipv4Addr::new(10, 0, 0, 9));
        let both = Peer { address: Some(address), mac: Some(mac), serial_number: None };
        assert!(Allowed::default().allows(Peer { mac: Some(other), ..Peer::default() }));
        let list = Allowed(vec![both, Peer { serial_number: Some(7), ..Peer::default() }]);
        let known = |address, mac, serial_number| Peer { address, mac, serial_number };
        assert!(list.allows(known(Some(address), Some(mac), Some(8))));
        assert!(list.allows(known(Some(elsewhere), Some(other), Some(7))));
        assert!(list.allows(known(Some(address), None, Some(8))), "the MAC address is not known yet");
        assert!(!list.allows(known(Some(address), Some(other), Some(8))));
        assert!(!list.allows(known(Some(elsewhere), Some(mac), Some(8))));
    }
}
