//! Finding devices: who is on this cable, by DCP Identify on PROFINET and by ListIdentity on EtherNet/IP.
//!
//! A [`Search`] of length T asks all devices at 0, T/4 and T/2, so that a question or an answer may be lost, and lets
//! them spread their answers over T/4; the rest of the time is for those that take longer. It keeps one entry a device
//! however often that answers, and counts what is no answer to it.

mod identify;
mod list_identity;

pub use identify::{ProfinetQuestion, ProfinetStation};
pub use list_identity::{EthernetIpDevice, EthernetIpQuestion};

use alloc::vec::Vec;

use identify::ProfinetSearch;
use list_identity::EthernetIpSearch;
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

/// Questions of one search on each bus.
pub const QUESTIONS: u32 = 3;

/// Entries that are kept of each bus. More devices than that on one cable are forged.
pub const MOST_DEVICES: usize = 1024;

/// Whom to ask, and for how long.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SearchConfig {
    /// From the first question to the end.
    pub length: Duration,
    /// Asks PROFINET stations, where it is there.
    pub profinet: Option<ProfinetQuestion>,
    /// Asks EtherNet/IP devices, where it is there.
    pub ethernet_ip: Option<EthernetIpQuestion>,
}

impl SearchConfig {
    /// Time over which devices are asked to spread their answers.
    #[must_use]
    pub fn spread(&self) -> Duration {
        self.length / 4
    }
}

/// Answers on one bus.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Tally {
    /// Answers of devices that had answered before.
    pub repeated: u64,
    /// What looked like an answer but is broken, or is one to somebody else's question.
    pub ignored: u64,
    /// Answers of devices beyond [`MOST_DEVICES`].
    pub surplus: u64,
}

/// The devices of one bus, one entry each.
#[derive(Debug)]
struct Gathered<D> {
    devices: Vec<D>,
    tally: Tally,
}

impl<D> Gathered<D> {
    const fn new() -> Self {
        Self { devices: Vec::new(), tally: Tally { repeated: 0, ignored: 0, surplus: 0 } }
    }

    /// Keeps what a device says, in place of what it said before: it may just have got a name or an address.
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

/// The search is over.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Over;

/// Asks all devices of a cable who they are, and gathers the answers.
#[derive(Debug)]
pub struct Search {
    start: Instant,
    length: Duration,
    /// Questions whose time has come.
    asked: u32,
    over: bool,
    /// [`Over`] waits to be told.
    telling: bool,
    ports: Vec<PortRequest>,
    profinet: Option<ProfinetSearch>,
    ethernet_ip: Option<EthernetIpSearch>,
}

impl Search {
    /// A search that asks first at `start`.
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
            over: false,
            telling: false,
            ports,
            profinet: config.profinet.map(|question| ProfinetSearch::new(question, spread)),
            ethernet_ip: config.ethernet_ip.map(|question| EthernetIpSearch::new(question, spread)),
        }
    }

    /// PROFINET stations that answered, the first one first.
    #[must_use]
    pub fn profinet_stations(&self) -> &[ProfinetStation] {
        self.profinet.as_ref().map_or(&[], |search| &search.gathered().devices)
    }

    /// EtherNet/IP devices that answered, the first one first.
    #[must_use]
    pub fn ethernet_ip_devices(&self) -> &[EthernetIpDevice] {
        self.ethernet_ip.as_ref().map_or(&[], |search| &search.gathered().devices)
    }

    /// Whether it asks PROFINET stations.
    #[must_use]
    pub const fn asks_profinet(&self) -> bool {
        self.profinet.is_some()
    }

    /// Whether it asks EtherNet/IP devices.
    #[must_use]
    pub const fn asks_ethernet_ip(&self) -> bool {
        self.ethernet_ip.is_some()
    }

    /// What came on PROFINET besides new stations.
    #[must_use]
    pub fn profinet_tally(&self) -> Tally {
        self.profinet.as_ref().map(|search| search.gathered().tally).unwrap_or_default()
    }

    /// What came on EtherNet/IP besides new devices.
    #[must_use]
    pub fn ethernet_ip_tally(&self) -> Tally {
        self.ethernet_ip.as_ref().map(|search| search.gathered().tally).unwrap_or_default()
    }

    /// When question `number`, from 0, is due.
    fn due(&self, number: u32) -> Instant {
        self.start + self.length.saturating_mul(number) / 4
    }

    fn end(&self) -> Instant {
        self.start + self.length
    }
}

impl Machine for Search {
    type Event = Over;

    fn ports(&self) -> &[PortRequest] {
        &self.ports
    }

    fn handle_frame(&mut self, _now: Instant, from: Source, frame: &[u8]) {
        if self.over {
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
        if self.over {
            return;
        }
        if now >= self.end() {
            (self.over, self.telling) = (true, true);
            return;
        }
        // A driver that was late for several questions asks once.
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

    fn poll_event(&mut self) -> Option<Over> {
        core::mem::take(&mut self.telling).then_some(Over)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        if self.over {
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
