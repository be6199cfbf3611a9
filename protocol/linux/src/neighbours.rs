//! Holds the host's table of neighbours against what a machine knows before a datagram is sent: nobody but the station that
//! the machine found may get it.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use rustix::io::Errno;

use crate::Interface;

/// Stations whose entries are remembered as right, so that the kernel is not asked for each datagram. What changes an entry
/// later is an ARP packet, and the driver forgets all of them at the next one.
const REMEMBERED: usize = 8;

/// The entries of the host's table that were found right or were corrected.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Neighbours {
    right: [Option<(Ipv4Addr, Mac)>; REMEMBERED],
    next: usize,
}

impl Neighbours {
    /// Forgets which entries were right, when ARP has changed them or may have.
    pub(crate) const fn forget(&mut self) {
        self.right = [None; REMEMBERED];
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
        let known = self.right.iter().position(|right| right.is_some_and(|(known, _)| known == address));
        let known = known.and_then(|index| self.right.get_mut(index));
        let Some(wanted) = wanted else {
            if let Some(known) = known {
                *known = None;
            }
            return Ok(());
        };
        if let Some(known) = known {
            if *known == Some((address, wanted)) {
                return Ok(());
            }
            *known = None;
        }
        if let Ok(found) = interface.neighbour(address)
            && found != Some(wanted)
        {
            match (interface.set_neighbour(address, wanted), found) {
                (Ok(()), _) => {}
                // An empty entry: the host asks, and the machine sees every answer.
                (Err(_), None) => return Ok(()),
                (Err(error), Some(found)) => {
                    // The host has no route through this interface: the datagram does not leave by it.
                    if Errno::from_io_error(&error) == Some(Errno::NETUNREACH) {
                        return Ok(());
                    }
                    return Err(found);
                }
            }
        }
        if let Some(place) = self.right.get_mut(self.next) {
            *place = Some((address, wanted));
        }
        self.next = (self.next + 1) % REMEMBERED;
        Ok(())
    }
}
