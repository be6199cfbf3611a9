//! Finding every device that a broadcast reaches, by ListIdentity (volume 2, 2-4.3).

use alloc::boxed::Box;
use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use machine::search::{Answers, Due, Schedule, SearchEnded};
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

use crate::ENCAPSULATION_PORT;
use crate::description::Identity;
use crate::discovery::{IdentityReply, emit_request};

/// Devices that one address may have: one, or some that share it by mistake. One host must not fill the list.
const MOST_OF_ONE_HOST: usize = 8;

/// Configuration of a search.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SearchConfig {
    /// UDP port of the requests and their answers; 0 for one that the driver chooses.
    pub local_port: u16,
    /// Broadcast addresses that reach the devices.
    pub to: Vec<Ipv4Addr>,
    /// Time from the first request to the end.
    pub length: Duration,
}

impl SearchConfig {
    /// Creates a search by the broadcast of the own subnet and by the limited broadcast, 255.255.255.255: some devices
    /// listen to only one of them, and a device with a wrong mask would not receive the first.
    #[must_use]
    pub fn from_address(local_port: u16, address: Ipv4Addr, mask: Ipv4Addr, length: Duration) -> Self {
        let subnet = Ipv4Addr::from_bits(address.to_bits() | !mask.to_bits());
        // A network of one or two hosts has no broadcast of its own.
        let to = [subnet, Ipv4Addr::BROADCAST];
        let has_own = mask.to_bits().count_zeros() >= 2 && subnet != Ipv4Addr::BROADCAST;
        let to = if has_own { &to[..] } else { &to[1..] };
        Self { local_port, to: to.to_vec(), length }
    }
}

/// A device that answered.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FoundDevice {
    /// Where its answer came from.
    pub address: Ipv4Addr,
    /// Address in its answer. If it differs from the address above, there is address translation or a fault.
    pub listens_at: SocketAddrV4,
    /// Its identity.
    pub identity: Identity,
    /// Status word of its Identity: bit 0 owned, bit 2 configured, bits 4 to 7 what I/O does.
    pub status: u16,
    /// Its product name, as bytes of whatever character set its vendor uses.
    pub product_name: Box<[u8]>,
    /// State of its Identity: 3 operational.
    pub state: u8,
}

impl FoundDevice {
    /// Returns whether two answers are from one device. Two devices that share an address by mistake stay two.
    fn is_same(&self, other: &Self) -> bool {
        let key = |device: &Self| (device.address, device.identity.key.vendor, device.identity.serial_number);
        key(self) == key(other)
    }
}

/// Sends ListIdentity to all devices and collects the answers. It reports [`SearchEnded`].
#[derive(Debug)]
pub struct Search {
    port: PortRequest,
    config: SearchConfig,
    schedule: Schedule,
    /// Addresses that the present request was sent to.
    sent: usize,
    answers: Answers<FoundDevice>,
}

impl Search {
    /// Creates a search that sends its first request at `start`.
    #[must_use]
    pub fn new(config: SearchConfig, start: Instant) -> Self {
        Self {
            port: PortRequest::Udp(config.local_port),
            schedule: Schedule::new(start, config.length),
            sent: config.to.len(),
            answers: Answers::default(),
            config,
        }
    }

    /// Returns the devices that answered.
    #[must_use]
    pub const fn answers(&self) -> &Answers<FoundDevice> {
        &self.answers
    }
}

impl Machine for Search {
    type Event = SearchEnded;

    fn ports(&self) -> &[PortRequest] {
        core::slice::from_ref(&self.port)
    }

    fn handle_frame(&mut self, _now: Instant, from: Source, frame: &[u8]) {
        let Source { port: Port::Udp(port), peer: Some(peer) } = from else { return };
        if port != self.config.local_port || self.schedule.has_ended() {
            return;
        }
        let Some(IdentityReply { address: listens_at, identity, status, product_name, state }) =
            IdentityReply::parse(frame)
        else {
            self.answers.ignore();
            return;
        };
        let (address, product_name) = (*peer.ip(), product_name.into());
        let device = FoundDevice { address, listens_at, identity, status, product_name, state };
        let of_host = self.answers.devices().iter().filter(|found| found.address == address);
        let is_known = of_host.clone().any(|found| found.is_same(&device));
        if is_known || of_host.count() < MOST_OF_ONE_HOST {
            self.answers.keep(device, FoundDevice::is_same);
        } else {
            self.answers.ignore();
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.schedule.handle_timeout(now) == Due::Request {
            self.sent = 0;
        }
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let to = *self.config.to.get(self.sent)?;
        self.sent += 1;
        // 0 would mean two seconds to a device.
        let answer_within_ms = u16::try_from(self.schedule.spread().as_millis()).unwrap_or(u16::MAX).max(1);
        let len = emit_request(buf, answer_within_ms).ok()?;
        let to = Some(SocketAddrV4::new(to, ENCAPSULATION_PORT));
        Some(Transmit { port: Port::Udp(self.config.local_port), to, len })
    }

    fn poll_event(&mut self) -> Option<SearchEnded> {
        self.schedule.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.schedule.poll_timeout()
    }
}
