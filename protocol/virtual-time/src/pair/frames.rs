//! Frames on the cable of a pair: how they are sent and delivered. TCP has its own module.

use alloc::boxed::Box;
use core::net::{Ipv4Addr, SocketAddrV4};

use super::in_flight::{Delivery, InFlight, new_buf};
use super::tap::{Carrier, Label, Tapped};
use super::{Pair, hosts};
use crate::link::{LinkEffect, flip};
use crate::side::Side;
use machine::{Machine, Port, Source, Transmit};

impl<A: Machine, B: Machine> Pair<A, B> {
    /// Delivers the next frame, or what a stream carries.
    pub(super) fn deliver(&mut self) {
        let Some(InFlight { to: side, delivery, .. }) = self.in_flight.pop() else { return };
        let (port, peer, label, buf, len) = match delivery {
            Delivery::Frame { port, peer, label, buf, len } => (port, peer, label, buf, len),
            delivery => return self.deliver_stream(side, delivery),
        };
        let frame = buf.get(..len).unwrap_or_default();
        self.tap_arrival(side, label, frame);
        let to = match label.carrier {
            Carrier::Udp { to, .. } => Some(*to.ip()),
            _ => None,
        };
        if self.station(side).alive && label.carrier == Carrier::Ethernet {
            self.answer_arp(side, frame);
        }
        if self.station(side).alive
            && self.wants(side, port)
            && self.belongs(side, port, to)
            && self.has_opened(side, port, frame)
        {
            let local = self.read_clock(side);
            let source = Source { port, peer };
            match (side, to.is_some_and(|to| to.is_broadcast())) {
                (Side::A, false) => self.a.handle_frame(local, source, frame),
                (Side::B, false) => self.b.handle_frame(local, source, frame),
                (Side::A, true) => self.a.handle_broadcast(local, source, frame),
                (Side::B, true) => self.b.handle_broadcast(local, source, frame),
            }
            self.poll_machine(side, local);
        }
        self.spare_bufs.push(buf);
    }

    /// Returns whether a datagram is for this side; a multicast is if the side joined its group.
    fn belongs(&self, side: Side, port: Port, to: Option<Ipv4Addr>) -> bool {
        let Some(group) = to.filter(Ipv4Addr::is_multicast) else { return true };
        let joined = |index| match side {
            Side::A => self.a.group(port, index),
            Side::B => self.b.group(port, index),
        };
        (0..).map_while(joined).any(|joined| joined == group)
    }

    /// Puts a frame that a machine has written into the cable.
    pub(super) fn send(&mut self, from: Side, Transmit { port, to, len }: Transmit) {
        if let Port::Stream(id) = port {
            return self.send_stream(from, id, len);
        }
        let now = self.now;
        let dscp = self.dscp(from, port);
        let [a, b] = &mut self.stations;
        let (sender, receiver) = match from {
            Side::A => (a, b),
            Side::B => (b, a),
        };
        let (port, peer, carrier) = match (port, to) {
            (Port::Udp(local), Some(to)) => {
                let known = receiver.address.is_some_and(|address| address == *to.ip())
                    || to.ip().is_broadcast()
                    || to.ip().is_multicast();
                let Some(source) = sender.address.filter(|_| known) else { return };
                let source = SocketAddrV4::new(source, local);
                (Port::Udp(to.port()), Some(source), Carrier::Udp { source, to })
            }
            (port, _) => (port, None, Carrier::Ethernet),
        };
        let (effect, arrives) = match (port, self.buf.get(..len)) {
            (Port::Ethernet, Some(frame)) => {
                sender.learn_mac(frame);
                if hosts::is_arp(frame) {
                    (LinkEffect::default(), sender.link.pass_of_hosts(now))
                } else {
                    sender.link.decide(now, len)
                }
            }
            _ => sender.link.decide(now, len),
        };
        let label = Label { carrier, dscp, effect };
        if let Some(tap) = &mut self.tap {
            let frame = self.buf.get(..len).unwrap_or_default();
            tap.see(Tapped { at: now, end: from, from, carrier, dscp, effect, frame });
        }
        let Some(arrives) = arrives else { return };
        let mut buf = self.take_buf();
        if let Some(bit) = effect.flipped_bit {
            flip(&mut buf, bit);
        }
        let second = effect.duplicated.then(|| holding(self.spare_bufs.pop(), buf.get(..len)));
        let delivery = |buf| Delivery::Frame { port, peer, label, buf, len };
        self.in_flight.push(arrives, from.other(), delivery(buf));
        if let Some(second) = second {
            self.in_flight.push(arrives, from.other(), delivery(second));
        }
    }

    /// Takes the buffer with a written frame, to send it; another one replaces it.
    pub(super) fn take_buf(&mut self) -> Box<[u8]> {
        let spare = self.spare_bufs.pop().unwrap_or_else(new_buf);
        core::mem::replace(&mut self.buf, spare)
    }
}

/// Returns a buffer that begins with these bytes: a spare one, or a new one.
pub(super) fn holding(spare: Option<Box<[u8]>>, bytes: Option<&[u8]>) -> Box<[u8]> {
    let mut buf = spare.unwrap_or_else(new_buf);
    let bytes = bytes.unwrap_or_default();
    if let Some(start) = buf.get_mut(..bytes.len()) {
        start.copy_from_slice(bytes);
    }
    buf
}
