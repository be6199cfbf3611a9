//! Machines without a protocol, to test the driver with.

pub(crate) mod tcp;

use std::net::SocketAddrV4;

use machine::ethernet::Mac;
use machine::{Cycle, Duration, Instant, Machine, Port, PortRequest, Source, Transmit};
use protocol::direct::Direct;
use protocol::fieldbus::{Counters, Fieldbus as _, LinkEvent};
use protocol::image::IMAGE_LEN;
use protocol_linux::Interface;

use super::test_network::Progress;

pub(crate) const UDP_PORT: u16 = 34962;
const PERIOD: Duration = Duration::from_millis(1);
const BROADCAST: [u8; 6] = [0xFF; 6];
pub(crate) const ETHERTYPE: [u8; 2] = [0x88, 0x92];
/// Priority 6, VLAN 0, as class 1 frames have it.
pub(crate) const PRIORITY_TAG: [u8; 4] = [0x81, 0x00, 0xC0, 0x00];
/// Longer than any stall of the host.
const WATCHDOG: Duration = Duration::from_secs(60);

/// How images travel.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Cable {
    Untagged,
    PriorityTagged,
    Vlan(u16),
    Udp,
}

/// One end of a [`Direct`] cable; adds the headers that a real cable needs around the image.
#[derive(Debug)]
pub(crate) struct Station {
    direct: Direct,
    cable: Cable,
    /// Built once: the cyclic path must not allocate.
    head: Vec<u8>,
    peer: SocketAddrV4,
    /// The number in the last image that was received.
    last: u64,
    /// Images whose number is not above that of the image before.
    pub(crate) out_of_order: u64,
}

impl Station {
    pub(crate) fn new(cable: Cable, mac: Mac, peer: SocketAddrV4, now: Instant) -> Self {
        Self {
            direct: Direct::new(now + PERIOD, PERIOD, WATCHDOG),
            cable,
            head: head(mac, cable),
            peer,
            last: 0,
            out_of_order: 0,
        }
    }

    pub(crate) fn counters(&self) -> Counters {
        self.direct.counters()
    }

    /// Puts the number of the next image into it.
    fn number_output(&mut self) {
        let mut image = [0; IMAGE_LEN];
        image[..8].copy_from_slice(&(self.counters().sent + 1).to_be_bytes());
        self.direct.set_output(&image);
    }

    fn check_number(&mut self) {
        let image = self.direct.input().unwrap_or([0; IMAGE_LEN]);
        let number = image.first_chunk().map_or(0, |bytes| u64::from_be_bytes(*bytes));
        self.out_of_order += u64::from(number <= self.last);
        self.last = number;
    }
}

impl Progress for Station {
    fn link(event: LinkEvent) -> LinkEvent {
        event
    }

    /// Returns the number of images that were sent, or received if those are fewer.
    fn progress(&self) -> u64 {
        self.counters().sent.min(self.counters().received)
    }
}

fn head(mac: Mac, cable: Cable) -> Vec<u8> {
    let tag = match cable {
        Cable::Untagged => vec![],
        Cable::PriorityTagged => PRIORITY_TAG.to_vec(),
        Cable::Vlan(id) => [[0x81, 0x00], id.to_be_bytes()].concat(),
        Cable::Udp => return vec![],
    };
    [&BROADCAST[..], &mac.0, &tag, &ETHERTYPE].concat()
}

/// Raw Ethernet and a UDP port, whichever of them a station uses.
const PORTS: &[PortRequest] = &[
    PortRequest::Ethernet { ether_type: u16::from_be_bytes(ETHERTYPE), groups: &[] },
    PortRequest::Udp(UDP_PORT),
];

impl Machine for Station {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        PORTS
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match from.port {
            // The kernel removes the tag from received frames.
            Port::Ethernet => self.direct.handle_frame(now, from, frame.get(14..).unwrap_or_default()),
            _ => self.direct.handle_frame(now, from, frame),
        }
        self.check_number();
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.number_output();
        self.direct.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let transmit = self.direct.poll_transmit(now, buf)?;
        if self.cable == Cable::Udp {
            return Some(Transmit { port: Port::Udp(UDP_PORT), to: Some(self.peer), len: transmit.len });
        }
        buf.copy_within(..transmit.len, self.head.len());
        buf.get_mut(..self.head.len())?.copy_from_slice(&self.head);
        Some(Transmit { len: transmit.len + self.head.len(), ..transmit })
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.direct.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.direct.poll_timeout()
    }
}

/// Sends a request with its instant every cycle and counts the answers; or answers.
#[derive(Debug)]
pub(crate) struct Echo {
    mac: Mac,
    cycle: Option<Cycle>,
    send: Option<u64>,
    pub(crate) asked: u64,
    pub(crate) answered: u64,
    /// The instant in the last answer.
    last: u64,
    /// Answers whose instant is not after that in the answer before.
    pub(crate) out_of_order: u64,
}

impl Progress for Echo {
    fn link(event: LinkEvent) -> LinkEvent {
        event
    }

    fn progress(&self) -> u64 {
        self.answered
    }
}

impl Echo {
    pub(crate) fn asks(interface: &Interface) -> Self {
        let cycle = Cycle::new(protocol_linux::clock::now() + PERIOD, PERIOD);
        Self { cycle: Some(cycle), ..Self::answers(interface) }
    }

    pub(crate) fn answers(interface: &Interface) -> Self {
        Self {
            mac: interface.mac(),
            cycle: None,
            send: None,
            asked: 0,
            answered: 0,
            last: 0,
            out_of_order: 0,
        }
    }
}

impl Machine for Echo {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        PORTS
    }

    fn handle_frame(&mut self, _: Instant, _: Source, frame: &[u8]) {
        let Some(stamp) = frame.get(14..22).and_then(|bytes| bytes.try_into().ok()) else {
            return;
        };
        let stamp = u64::from_be_bytes(stamp);
        if self.cycle.is_some() {
            self.answered += 1;
            self.out_of_order += u64::from(stamp <= self.last);
            self.last = stamp;
        } else {
            self.send = Some(stamp);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.cycle.as_mut().is_some_and(|cycle| cycle.tick(now).is_some()) {
            self.asked += 1;
            self.send = Some(now.as_nanos());
        }
    }

    fn poll_transmit(&mut self, _: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let stamp = self.send.take()?;
        let head = head(self.mac, Cable::PriorityTagged);
        let frame = [&head[..], &stamp.to_be_bytes(), &[0; 248]].concat();
        buf.get_mut(..frame.len())?.copy_from_slice(&frame);
        Some(Transmit { port: Port::Ethernet, to: None, len: frame.len() })
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.cycle.as_ref().map(Cycle::next)
    }
}
