//! Holds the host's table of neighbours against what a machine knows before a datagram is sent: nobody but the station that
//! the machine found may get it.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use rustix::io::Errno;

use crate::Interface;

/// Places for stations whose entries are remembered as right, so that the kernel is not asked for each datagram: one for each
/// last byte of an address. Two stations that share a place only make the kernel be asked more often.
const PLACES: usize = 256;

/// The entries of the host's table that were found right or were corrected. What changes an entry later is an ARP packet, and
/// the driver forgets all of them at the next one.
#[derive(Clone, Debug)]
pub(crate) struct Neighbours {
    places: Box<[Option<Right>; PLACES]>,
    /// Number of ARP packets: an entry that was right before the last one counts no more.
    generation: u64,
}

/// An entry that was right.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Right {
    address: Ipv4Addr,
    mac: Mac,
    generation: u64,
}

impl Neighbours {
    /// Starts without entries.
    pub(crate) fn new() -> Self {
        Self { places: Box::new([None; PLACES]), generation: 0 }
    }

    /// Forgets which entries were right, when ARP has changed them or may have.
    pub(crate) const fn forget(&mut self) {
        self.generation = self.generation.wrapping_add(1);
    }

    fn place(&mut self, address: Ipv4Addr) -> &mut Option<Right> {
        let [.., last] = address.octets();
        &mut self.places[usize::from(last)]
    }

    /// Makes sure that the host sends datagrams for `address` to `wanted`; without a wish, forgets the address.
    ///
    /// # Errors
    ///
    /// The MAC address to which the host would send, if it is another one and may not be corrected.
    pub(crate) fn check(
        &mut self,
        interface: &Interface,
        address: Ipv4Addr,
        wanted: Option<Mac>,
    ) -> Result<(), Mac> {
        let generation = self.generation;
        let place = self.place(address);
        let Some(mac) = wanted else {
            if place.is_some_and(|right| right.address == address) {
                *place = None;
            }
            return Ok(());
        };
        let right = Right { address, mac, generation };
        if *place == Some(right) {
            return Ok(());
        }
        if place.is_some_and(|right| right.address == address) {
            *place = None;
        }
        if correct(interface, address, mac)? {
            *place = Some(right);
        }
        Ok(())
    }
}

/// Corrects the host's entry for an address if it has another MAC address than `wanted`. Returns whether it is right then, as
/// far as the kernel says.
///
/// # Errors
///
/// The MAC address in the entry, if that may not be corrected.
fn correct(interface: &Interface, address: Ipv4Addr, wanted: Mac) -> Result<bool, Mac> {
    let Ok(found) = interface.neighbour(address) else { return Ok(true) };
    if found == Some(wanted) {
        return Ok(true);
    }
    match (interface.set_neighbour(address, wanted), found) {
        (Ok(()), _) => Ok(true),
        // An empty entry: the host asks, and the machine sees every answer.
        (Err(_), None) => Ok(false),
        // The host has no route through this interface: the datagram does not leave by it.
        (Err(error), Some(_)) if Errno::from_io_error(&error) == Some(Errno::NETUNREACH) => Ok(false),
        (Err(_), Some(found)) => Err(found),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_of_254_stations_is_remembered_until_arp_may_have_changed_its_entry() {
        let mut neighbours = Neighbours::new();
        let loopback = Interface::open("lo").unwrap();
        let stations = || (1..=254).map(|last| (Ipv4Addr::new(192, 0, 2, last), Mac([2, 0, 0, 0, 0, last])));
        let remembered = |neighbours: &mut Neighbours| {
            let generation = neighbours.generation;
            stations()
                .filter(|(address, mac)| {
                    let right = Right { address: *address, mac: *mac, generation };
                    *neighbours.place(*address) == Some(right)
                })
                .count()
        };
        for (address, mac) in stations() {
            let generation = neighbours.generation;
            *neighbours.place(address) = Some(Right { address, mac, generation });
        }
        assert_eq!(remembered(&mut neighbours), 254);
        // A wish that no longer holds is forgotten alone.
        neighbours.check(&loopback, Ipv4Addr::new(192, 0, 2, 9), None).unwrap();
        assert_eq!(remembered(&mut neighbours), 253);
        neighbours.forget();
        assert_eq!(remembered(&mut neighbours), 0);
    }
}
