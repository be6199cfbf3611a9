//! The way of frames through a segment, and the ends by which they leave it.

use alloc::boxed::Box;
use alloc::vec;

use machine::ethernet::EthernetHeader;
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, Port, Transmit};

use super::Segment;
use crate::ETHER_TYPE;
use crate::cabling::{End, Place, next_port};
use crate::datagram::Datagrams;
use crate::event::{DeviceId, Sink};

/// Largest number of frames under way; if the MainDevice sends more, they are lost.
const MAX_UNDER_WAY: usize = 256;

/// An end of a segment, by which frames leave it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SegmentEnd {
    /// Towards the MainDevice.
    Upstream,
    /// Towards devices after its last one.
    Onward,
}

/// A frame that leaves the segment.
#[derive(Debug)]
pub(super) struct UnderWay {
    pub(super) departs: Instant,
    by: SegmentEnd,
    len: usize,
    frame: Box<[u8]>,
}

impl Segment {
    /// Sends a frame that comes in by an end through the devices, each of which changes it where it passes the processing unit.
    /// Returns when and by which end it leaves, or `None` if it is lost.
    fn pass(
        &mut self,
        now: Instant,
        from: SegmentEnd,
        frame: &mut [u8],
        header_len: usize,
    ) -> Option<(Instant, SegmentEnd)> {
        let (mut place, delay) = match from {
            SegmentEnd::Upstream => self.cabling.first()?,
            SegmentEnd::Onward => (self.onward()?, Duration::ZERO),
        };
        let mut at = now + delay;
        loop {
            let esc = &mut self.devices.get_mut(place.device)?.esc;
            if place.port == self.cabling.upstream_port(place.device) {
                esc.begin_frame();
            }
            esc.frame_arrives(at, place.port);
            let out = self.forward(at, place, frame, header_len)?;
            at += self.cabling.forwarding_delay(place.device);
            if self.onward() == Some(out) {
                return Some((at, SegmentEnd::Onward));
            }
            let (end, delay) = self.cabling.peer(out)?;
            at += delay;
            let End::Device(next) = end else { return Some((at, SegmentEnd::Upstream)) };
            place = next;
        }
    }

    /// Handles a frame that devices after this segment sent back. Frames that no cable leads out of the segment are lost.
    pub fn handle_returned(&mut self, now: Instant, frame: &[u8]) {
        self.take(now, SegmentEnd::Onward, frame);
    }

    /// Writes the next frame that leaves the segment into `buf`, as [`machine::Machine::poll_transmit`], and returns by which end it leaves.
    pub fn poll_frame(&mut self, now: Instant, buf: &mut [u8]) -> Option<(SegmentEnd, Transmit)> {
        let UnderWay { by, len, frame, .. } = self.under_way.pop_front_if(|next| next.departs <= now)?;
        let room = buf.get_mut(..len);
        if let (Some(room), Some(bytes)) = (room, frame.get(..len)) {
            room.copy_from_slice(bytes);
        }
        self.spare.push(frame);
        Some((by, Transmit { port: Port::Ethernet, to: None, len }))
    }

    /// Takes a frame that comes in by an end.
    pub(super) fn take(&mut self, now: Instant, from: SegmentEnd, frame: &[u8]) {
        let datagrams =
            EthernetHeader::parse(frame).ok().filter(|(header, _)| header.ether_type == ETHER_TYPE);
        let Some((header, _)) = datagrams.filter(|_| frame.len() <= FRAME_CAPACITY) else {
            self.counters.foreign += 1;
            return;
        };
        let mut buf = self.spare.pop().unwrap_or_else(|| vec![0; FRAME_CAPACITY].into_boxed_slice());
        let Some(passing) = buf.get_mut(..frame.len()) else { return };
        passing.copy_from_slice(frame);
        // A chip marks the source address as locally administered, so that the MainDevice can distinguish frames that
        // come back from frames that it sends.
        if let Some(byte) = passing.get_mut(6) {
            *byte |= 0x02;
        }
        if Datagrams::of(passing.get_mut(header.buffer_len()..).unwrap_or_default()).is_none() {
            self.counters.foreign += 1;
            self.spare.push(buf);
            return;
        }
        match self.pass(now, from, passing, header.buffer_len()) {
            Some((departs, by)) if self.under_way.len() < MAX_UNDER_WAY => {
                // A frame that comes back was counted on its way out.
                self.counters.passed += u64::from(from == SegmentEnd::Upstream);
                self.under_way.push_back(UnderWay { departs, by, len: frame.len(), frame: buf });
            }
            _ => {
                self.counters.lost += 1;
                self.spare.push(buf);
            }
        }
    }

    /// Lets a frame that arrives at a port pass one device. Returns the port that it leaves by; `None` if it is dropped at a
    /// closed port, or because it circulates.
    fn forward(&mut self, at: Instant, place: Place, frame: &mut [u8], header_len: usize) -> Option<Place> {
        let device = self.devices.get_mut(place.device)?;
        if !device.esc.is_open(place.port) {
            return None;
        }
        let mut port = place.port;
        loop {
            let payload = frame.get_mut(header_len..)?;
            if port == 0 {
                for mut datagram in Datagrams::of(payload).into_iter().flatten() {
                    device.esc.process(at, &mut datagram);
                }
                device.esc.end_frame(at);
                device.serve(at, &mut Sink { id: DeviceId(place.device), events: &mut self.events });
            }
            port = next_port(port);
            if device.esc.is_open(port) {
                return Some(Place { device: place.device, port });
            }
            // A closed port 0 marks a frame that passes it, and destroys one that is marked: it would circulate endlessly in the
            // devices beyond a cut cable (ESC datasheet section I, circulating frames).
            if port == 0 && mark_circulating(payload) {
                return None;
            }
        }
    }
}

/// Marks the datagrams of a frame as circulating. Returns whether they were marked before.
fn mark_circulating(payload: &mut [u8]) -> bool {
    let mut circulates = false;
    for mut datagram in Datagrams::of(payload).into_iter().flatten() {
        circulates |= datagram.set_circulating();
    }
    circulates
}
