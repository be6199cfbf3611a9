//! Checks before a node puts an IP address on its interface that no other station on the cable has it (RFC 5227, 2.1).

use std::net::Ipv4Addr;
use std::ops::ControlFlow;

use machine::Instant;
use machine::arp::{AddressClaim, AddressConflict, ClaimEvent};
use protocol_linux::{Driver, DriverError, Interface, Notifier, Owner, PortError, Statistics, clock};

/// Why an address must not be put on the interface, or why that is unknown.
#[derive(Debug, thiserror::Error)]
pub enum AddressCheckError {
    /// Another station has it.
    #[error("{0}; switch that station off, or choose another address in the setup")]
    Taken(AddressConflict),
    /// ARP cannot be sent or received.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The interface failed.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// The kernel gives no notifier.
    #[error("checking the address: {0}")]
    Notifier(#[from] std::io::Error),
}

/// Asks every station on the cable whether it has this address, for 60 ms.
///
/// # Errors
///
/// Another station has it, or the question cannot be asked.
pub fn check_address(interface: &Interface, address: Ipv4Addr) -> Result<(), AddressCheckError> {
    let mut claim = AddressClaim::new(interface.mac());
    claim.probe(clock::now(), address);
    let mut driver = Driver::new(claim, interface.clone(), Notifier::new()?)?;
    let mut verdict = Verdict(None);
    driver.run(&mut verdict)?;
    verdict.0.map_or(Ok(()), |conflict| Err(AddressCheckError::Taken(conflict)))
}

/// Ends the driver with the first event of the claim.
struct Verdict(Option<AddressConflict>);

impl Owner<AddressClaim> for Verdict {
    fn wake(
        &mut self,
        _now: Instant,
        _claim: &mut AddressClaim,
        _statistics: &Statistics,
    ) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn event(&mut self, _now: Instant, _claim: &mut AddressClaim, event: ClaimEvent) -> ControlFlow<()> {
        if let ClaimEvent::Taken(conflict) | ClaimEvent::Conflict(conflict) = event {
            self.0 = Some(conflict);
        }
        ControlFlow::Break(())
    }
}
