//! A connection without a bus protocol: sends the image every cycle. For tests of the nodes that are not about a bus.

use core::net::SocketAddrV4;

use crate::fieldbus::{Counters, Down, DownCause, Fieldbus, LinkEvent};
use crate::image::{IMAGE_LEN, Image, Order};
use machine::{Cycle, Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

/// EtherType for experiments within one network (IEEE 802, 9.2.4).
const EXPERIMENTAL: u16 = 0x88B5;

/// One end of the connection. It is up once the other end's first image has arrived.
#[derive(Debug)]
pub struct Direct {
    cycle: Cycle,
    watchdog: Duration,
    port: Port,
    request: PortRequest,
    peer: Option<SocketAddrV4>,
    output: Image,
    input: Image,
    last_input: Option<Instant>,
    is_input_bad: bool,
    send: bool,
    event: Option<LinkEvent>,
    counters: Counters,
}

impl Direct {
    /// Creates an end that sends at `first` and every `period` after it, and reports the connection lost after
    /// `watchdog` without an image.
    #[must_use]
    pub const fn new(first: Instant, period: Duration, watchdog: Duration) -> Self {
        Self {
            cycle: Cycle::new(first, period),
            watchdog,
            port: Port::Ethernet,
            request: PortRequest::Ethernet { ether_type: EXPERIMENTAL, groups: &[] },
            peer: None,
            output: [0; IMAGE_LEN],
            input: [0; IMAGE_LEN],
            last_input: None,
            is_input_bad: false,
            send: false,
            event: None,
            counters: Counters {
                sent: 0,
                skipped: 0,
                received: 0,
                lost: 0,
                late: 0,
                malformed: 0,
                foreign: 0,
            },
        }
    }

    /// Treats the peer's images as if it marked them as bad, or no longer so.
    pub const fn set_input_bad(&mut self, bad: bool) {
        self.is_input_bad = bad;
    }

    /// Sends over UDP instead, so that it also works on a real cable.
    #[must_use]
    pub const fn over_udp(self, port: u16, peer: SocketAddrV4) -> Self {
        Self { port: Port::Udp(port), request: PortRequest::Udp(port), peer: Some(peer), ..self }
    }
}

impl Machine for Direct {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        core::slice::from_ref(&self.request)
    }

    fn handle_frame(&mut self, now: Instant, _from: Source, frame: &[u8]) {
        let Ok(image) = frame.try_into() else {
            self.counters.malformed += 1;
            return;
        };
        self.input = image;
        self.counters.received += 1;
        if self.last_input.replace(now).is_none() {
            self.event = Some(LinkEvent::Up);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.cycle.tick(now).is_some() {
            self.send = true;
        }
        if self.last_input.is_some_and(|last| now.since(last) > self.watchdog) {
            self.last_input = None;
            self.event = Some(LinkEvent::Down(Down { cause: DownCause::Watchdog, code: 0, text: "" }));
        }
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if !core::mem::take(&mut self.send) {
            return None;
        }
        buf.get_mut(..IMAGE_LEN)?.copy_from_slice(&self.output);
        self.counters.sent += 1;
        Some(Transmit { port: self.port, to: self.peer, len: IMAGE_LEN })
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.event.take()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.cycle.next())
    }
}

impl Fieldbus for Direct {
    fn byte_order(&self) -> Order {
        Order::BigEndian
    }

    fn set_output(&mut self, image: &Image) {
        self.output = *image;
    }

    fn input(&self) -> Option<Image> {
        self.last_input.filter(|_| !self.is_input_bad).map(|_| self.input)
    }

    fn disconnect(&mut self, _now: Instant) {
        if self.last_input.take().is_some() {
            self.event = Some(LinkEvent::Down(Down { cause: DownCause::ClosedHere, code: 0, text: "" }));
        }
    }

    fn counters(&self) -> Counters {
        self.counters
    }
}
