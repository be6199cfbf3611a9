//! Finds the devices on a cable, by DCP Identify on PROFINET and by ListIdentity on EtherNet/IP.
//!
//! A [`Search`] of length T sends requests to all devices at 0, T/4 and T/2, so that a request or an answer may be
//! lost. The devices spread their answers over T/4; the remaining time is for slow ones. The search keeps one entry
//! per device, however often it answers, and counts frames that are no answers to it.

mod identify;
mod list_identity;

pub use identify::{ProfinetQuestion, ProfinetStation};
pub use list_identity::{EthernetIpDevice, EthernetIpQuestion};

use alloc::vec::Vec;

use identify::ProfinetSearch;
use list_identity::EthernetIpSearch;
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

/// Requests of one search on each bus.
pub const QUESTIONS: u32 = 3;

/// Largest number of entries per bus. More devices on one cable must be forged.
pub const MOST_DEVICES: usize = 1024;

/// Configuration of a search.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SearchConfig {
    /// Time from the first request to the end.
    pub length: Duration,
    /// Search for PROFINET stations, if set.
    pub profinet: Option<ProfinetQuestion>,
    /// Search for EtherNet/IP devices, if set.
    pub ethernet_ip: Option<EthernetIpQuestion>,
}

impl SearchConfig {
    /// Returns the time over which devices are asked to spread their answers.
    #[must_use]
    pub fn spread(&self) -> Duration {
        self.length / 4
    }
}

/// Counters of the frames on one bus.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Tally {
    /// Answers of devices that had already answered.
    pub repeated: u64,
    /// Broken answers, and answers to requests of others.
    pub ignored: u64,
    /// Answers of devices beyond [`MOST_DEVICES`].
    pub surplus: u64,
}

/// The devices found on one bus, one entry each.
#[derive(Debug)]
struct Gathered<D> {
    devices: Vec<D>,
    tally: Tally,
}

impl<D> Gathered<D> {
    const fn new() -> Self {
        Self { devices: Vec::new(), tally: Tally { repeated: 0, ignored: 0, surplus: 0 } }
    }

    /// Stores a device's answer in place of its earlier one: it may have just got a name or an address.
    fn keep(&mut self, device: D, is_same: impl Fn(&D, &D) -> bool) {
        let known = self.devices.iter().position(|known| is_same(known, &device));
        if let Some(known) = known.and_then(|index| self.devices.get_mut(index)) {
            *known = device;
            self.tally.repeated += 1;
        } else if self.devices.len() < MOST_DEVICES {
            self.devices.push(device);
        } else {
            self.tally.surplus += 1;
        }
    }
}

/// Event: the search has ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SearchEnded;

/// Asks all devices on a cable for their identity, and collects the answers.
#[derive(Debug)]
pub struct Search {
    start: Instant,
    length: Duration,
    /// Requests that are due.
    asked: u32,
    ended: bool,
    /// [`SearchEnded`] was not reported yet.
    report_end: bool,
    ports: Vec<PortRequest>,
    profinet: Option<ProfinetSearch>,
    ethernet_ip: Option<EthernetIpSearch>,
}

impl Search {
    /// Creates a search that sends its first request at `start`.
    #[must_use]
    pub fn new(config: SearchConfig, start: Instant) -> Self {
        let spread = config.spread();
        let profinet = config.profinet.iter().map(|_| profinet::ETHERNET);
        let ethernet_ip = config.ethernet_ip.iter().map(|question| PortRequest::Udp(question.local_port));
        let ports = profinet.chain(ethernet_ip).collect();
        Self {
            start,
            length: config.length,
            asked: 0,
            ended: false,
            report_end: false,
            ports,
            profinet: config.profinet.map(|question| ProfinetSearch::new(question, spread)),
            ethernet_ip: config.ethernet_ip.map(|question| EthernetIpSearch::new(question, spread)),
        }
    }

    /// Returns the PROFINET stations in the order of their first answers.
    #[must_use]
    pub fn profinet_stations(&self) -> &[ProfinetStation] {
        self.profinet.as_ref().map_or(&[], |search| &search.gathered().devices)
    }

    /// Returns the EtherNet/IP devices in the order of their first answers.
    #[must_use]
    pub fn ethernet_ip_devices(&self) -> &[EthernetIpDevice] {
        self.ethernet_ip.as_ref().map_or(&[], |search| &search.gathered().devices)
    }

    /// Returns whether it searches for PROFINET stations.
    #[must_use]
    pub const fn asks_profinet(&self) -> bool {
        self.profinet.is_some()
    }

    /// Returns whether it searches for EtherNet/IP devices.
    #[must_use]
    pub const fn asks_ethernet_ip(&self) -> bool {
        self.ethernet_ip.is_some()
    }

    /// Returns the counters of frames on PROFINET that gave no new station.
    #[must_use]
    pub fn profinet_tally(&self) -> Tally {
        self.profinet.as_ref().map(|search| search.gathered().tally).unwrap_or_default()
    }

    /// Returns the counters of frames on EtherNet/IP that gave no new device.
    #[must_use]
    pub fn ethernet_ip_tally(&self) -> Tally {
        self.ethernet_ip.as_ref().map(|search| search.gathered().tally).unwrap_or_default()
    }

    /// Returns when request `number`, counted from 0, is due.
    fn due(&self, number: u32) -> Instant {
        self.start + self.length.saturating_mul(number) / 4
    }

    fn end(&self) -> Instant {
        self.start + self.length
    }
}

impl Machine for Search {
    type Event = SearchEnded;

    fn ports(&self) -> &[PortRequest] {
        &self.ports
    }

    fn handle_frame(&mut self, _now: Instant, from: Source, frame: &[u8]) {
        if self.ended {
            return;
        }
        match from {
            Source { port: Port::Ethernet, .. } => {
                if let Some(profinet) = &mut self.profinet {
                    profinet.handle_frame(frame);
                }
            }
            Source { port: Port::Udp(port), peer: Some(peer) } => {
                if let Some(search) = self.ethernet_ip.as_mut().filter(|search| search.local_port() == port) {
                    search.handle_datagram(*peer.ip(), frame);
                }
            }
            _ => {}
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.ended {
            return;
        }
        if now >= self.end() {
            (self.ended, self.report_end) = (true, true);
            return;
        }
        // If the driver is late for several requests, it sends one.
        let mut due = false;
        while self.asked < QUESTIONS && self.due(self.asked) <= now {
            self.asked += 1;
            due = true;
        }
        if due {
            if let Some(profinet) = &mut self.profinet {
                profinet.ask();
            }
            if let Some(ethernet_ip) = &mut self.ethernet_ip {
                ethernet_ip.ask();
            }
        }
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let profinet = self.profinet.as_mut().and_then(|search| search.poll_transmit(buf));
        profinet.or_else(|| self.ethernet_ip.as_mut().and_then(|search| search.poll_transmit(buf)))
    }

    fn poll_event(&mut self) -> Option<SearchEnded> {
        core::mem::take(&mut self.report_end).then_some(SearchEnded)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        if self.ended {
            None
        } else if self.asked < QUESTIONS {
            Some(self.due(self.asked))
        } else {
            Some(self.end())
        }
    }
}

#[cfg(test)]
mod tests;
