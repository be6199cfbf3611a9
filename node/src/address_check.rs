//! Checks before a node puts an IP address on its interface that no other station on the cable has it (RFC 5227, 2.1).

use std::net::Ipv4Addr;
use std::ops::ControlFlow;

use machine::arp::{AddressClaim, AddressConflict, ArpPacket, ClaimEvent, ETHERNET, Holders};
use machine::ethernet::Mac;
use machine::{Instant, Machine, Port, PortRequest, Source, Transmit};
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
    let mut verdict = AddressVerdict(None);
    driver.run(&mut verdict)?;
    verdict.0.map_or(Ok(()), |conflict| Err(AddressCheckError::Taken(conflict)))
}

/// Asks every station on the cable whether it has this address, for 60 ms, and returns those that have it.
///
/// # Errors
///
/// The question cannot be asked.
pub fn find_holders(interface: &Interface, address: Ipv4Addr) -> Result<Vec<Mac>, AddressCheckError> {
    let mut search = HolderSearch(Holders::new(interface.mac()));
    search.0.probe(clock::now(), address);
    let mut driver = Driver::new(search, interface.clone(), Notifier::new()?)?;
    driver.run(&mut UntilDone)?;
    Ok(driver.machine().0.found().collect())
}

/// Who has an address, as a machine of its own.
struct HolderSearch(Holders);

impl Machine for HolderSearch {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        &[ETHERNET]
    }

    fn handle_frame(&mut self, _now: Instant, _from: Source, frame: &[u8]) {
        if let Some(Ok(packet)) = ArpPacket::from_frame(frame) {
            self.0.handle(&packet);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.0.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let len = self.0.poll_transmit(now, buf)?;
        Some(Transmit { port: Port::Ethernet, to: None, len })
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.0.poll_timeout()
    }
}

/// Ends the driver when all answers should have come.
struct UntilDone;

impl Owner<HolderSearch> for UntilDone {
    fn wake(
        &mut self,
        _now: Instant,
        search: &mut HolderSearch,
        _statistics: &Statistics,
    ) -> ControlFlow<()> {
        if search.0.is_done() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(&mut self, _now: Instant, _search: &mut HolderSearch, (): ()) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Ends the driver with the first event of the claim.
struct AddressVerdict(Option<AddressConflict>);

impl Owner<AddressClaim> for AddressVerdict {
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
