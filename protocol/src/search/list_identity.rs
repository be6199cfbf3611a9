//! Search on EtherNet/IP: ListIdentity to all devices (volume 2, 2-4.3).

use alloc::boxed::Box;
use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use super::Gathered;
use ethernet_ip::ENCAPSULATION_PORT;
use ethernet_ip::description::Identity;
use ethernet_ip::discovery::{Found, emit_question};
use machine::{Duration, Port, Transmit};

/// Configuration of a search on EtherNet/IP.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct EthernetIpQuestion {
    /// Local UDP port of requests and answers; with 0 the driver chooses one.
    pub local_port: u16,
    /// Broadcast addresses to send requests to.
    pub to: Vec<Ipv4Addr>,
}

impl EthernetIpQuestion {
    /// Sends requests to the broadcast address of the own subnet and to the limited one, 255.255.255.255: some
    /// devices listen to one of them only, and a device with a wrong mask would not receive the first.
    #[must_use]
    pub fn from_address(local_port: u16, address: Ipv4Addr, mask: Ipv4Addr) -> Self {
        let subnet = Ipv4Addr::from_bits(address.to_bits() | !mask.to_bits());
        // A network of one or two hosts has no broadcast address.
        let to = [subnet, Ipv4Addr::BROADCAST];
        let to =
            if mask.to_bits().count_zeros() < 2 || subnet == Ipv4Addr::BROADCAST { &to[1..] } else { &to };
        Self { local_port, to: to.to_vec() }
    }
}

/// An EtherNet/IP device that answered.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct EthernetIpDevice {
    /// Source address of its answer.
    pub address: Ipv4Addr,
    /// The address that it reports; if it differs from the source address, there is address translation or a fault.
    pub listens_at: SocketAddrV4,
    /// Its identity.
    pub identity: Identity,
    /// Status word of its Identity: bit 0 owned, bit 2 configured, bits 4 to 7 what I/O does.
    pub status: u16,
    /// Its product name, in a character set that its vendor chose.
    pub product_name: Box<[u8]>,
    /// State of its Identity: 3 operational.
    pub state: u8,
}

impl EthernetIpDevice {
    /// Returns whether two answers are from one device. Two devices that share an address by mistake remain two.
    fn is_same(&self, other: &Self) -> bool {
        let key = |device: &Self| (device.address, device.identity.key.vendor, device.identity.serial_number);
        key(self) == key(other)
    }
}

#[derive(Debug)]
pub(super) struct EthernetIpSearch {
    question: EthernetIpQuestion,
    answer_within_ms: u16,
    /// Addresses that the current request was already sent to.
    sent: usize,
    gathered: Gathered<EthernetIpDevice>,
}

impl EthernetIpSearch {
    pub(super) fn new(question: EthernetIpQuestion, spread: Duration) -> Self {
        // 0 would mean two seconds for a device.
        let answer_within_ms = u16::try_from(spread.as_millis()).unwrap_or(u16::MAX).max(1);
        let sent = question.to.len();
        Self { question, answer_within_ms, sent, gathered: Gathered::new() }
    }

    pub(super) const fn local_port(&self) -> u16 {
        self.question.local_port
    }

    pub(super) const fn gathered(&self) -> &Gathered<EthernetIpDevice> {
        &self.gathered
    }

    pub(super) const fn ask(&mut self) {
        self.sent = 0;
    }

    pub(super) fn poll_transmit(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        let to = *self.question.to.get(self.sent)?;
        self.sent += 1;
        let len = emit_question(buf, self.answer_within_ms).ok()?;
        let to = Some(SocketAddrV4::new(to, ENCAPSULATION_PORT));
        Some(Transmit { port: Port::Udp(self.question.local_port), to, len })
    }

    pub(super) fn handle_datagram(&mut self, address: Ipv4Addr, datagram: &[u8]) {
        let Some(Found { address: listens_at, identity, status, product_name, state }) =
            Found::parse(datagram)
        else {
            self.gathered.tally.ignored += 1;
            return;
        };
        let product_name = product_name.into();
        let device = EthernetIpDevice { address, listens_at, identity, status, product_name, state };
        self.gathered.keep(device, EthernetIpDevice::is_same);
    }
}
