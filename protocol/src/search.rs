//! Search for devices on a cable, on PROFINET and on EtherNet/IP at the same time.

use alloc::vec::Vec;

use machine::search::SearchEnded;
use machine::{Instant, Machine, PortRequest, Source, Transmit};

/// The searches of both buses, or of one, as one machine. It reports [`SearchEnded`] after the last of them.
#[derive(Debug)]
pub struct Search {
    ports: Vec<PortRequest>,
    profinet: Option<profinet::Search>,
    ethernet_ip: Option<ethernet_ip::Search>,
    /// Searches that have not ended.
    running: usize,
}

impl Search {
    /// Joins the searches of the buses that are asked.
    #[must_use]
    pub fn new(profinet: Option<profinet::Search>, ethernet_ip: Option<ethernet_ip::Search>) -> Self {
        let of_profinet = profinet.iter().flat_map(Machine::ports);
        let ports = of_profinet.chain(ethernet_ip.iter().flat_map(Machine::ports)).copied().collect();
        let running = usize::from(profinet.is_some()) + usize::from(ethernet_ip.is_some());
        Self { ports, profinet, ethernet_ip, running }
    }

    /// Returns the search for PROFINET stations, if they are asked.
    #[must_use]
    pub const fn profinet(&self) -> Option<&profinet::Search> {
        self.profinet.as_ref()
    }

    /// Returns the search for EtherNet/IP devices, if they are asked.
    #[must_use]
    pub const fn ethernet_ip(&self) -> Option<&ethernet_ip::Search> {
        self.ethernet_ip.as_ref()
    }
}

impl Machine for Search {
    type Event = SearchEnded;

    fn ports(&self) -> &[PortRequest] {
        &self.ports
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        if let Some(profinet) = &mut self.profinet {
            profinet.handle_frame(now, from, frame);
        }
        if let Some(ethernet_ip) = &mut self.ethernet_ip {
            ethernet_ip.handle_frame(now, from, frame);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if let Some(profinet) = &mut self.profinet {
            profinet.handle_timeout(now);
        }
        if let Some(ethernet_ip) = &mut self.ethernet_ip {
            ethernet_ip.handle_timeout(now);
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let profinet = self.profinet.as_mut().and_then(|search| search.poll_transmit(now, buf));
        profinet.or_else(|| self.ethernet_ip.as_mut().and_then(|search| search.poll_transmit(now, buf)))
    }

    fn poll_event(&mut self) -> Option<SearchEnded> {
        let profinet = self.profinet.as_mut().and_then(Machine::poll_event);
        let ethernet_ip = self.ethernet_ip.as_mut().and_then(Machine::poll_event);
        let ended = [profinet, ethernet_ip].into_iter().flatten().count();
        self.running = self.running.saturating_sub(ended);
        (ended > 0 && self.running == 0).then_some(SearchEnded)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let profinet = self.profinet.as_ref().and_then(Machine::poll_timeout);
        Instant::earlier(profinet, self.ethernet_ip.as_ref().and_then(Machine::poll_timeout))
    }
}
