//! The cables of a network: two ends, and a link in each direction.

use machine::{Duration, Instant, Multihomed};

use super::Network;
use super::ids::{CableId, Plug};
use crate::link::{Impairment, Link, LinkCounters};
use crate::side::Side;

#[derive(Debug)]
pub(super) struct Cable {
    ends: [Plug; 2],
    links: [Link; 2],
}

impl Cable {
    pub(super) fn new(ends: [Plug; 2], links: [Impairment; 2], seed: u64, CableId(number): CableId) -> Self {
        let [of_a, of_b] = links;
        let stream = 2 * number as u64;
        Self { ends, links: [Link::new(of_a, seed, stream), Link::new(of_b, seed, stream + 1)] }
    }

    #[inline]
    pub(super) const fn end(&self, side: Side) -> Plug {
        let [a, b] = &self.ends;
        match side {
            Side::A => *a,
            Side::B => *b,
        }
    }

    #[inline]
    pub(super) const fn link(&mut self, from: Side) -> &mut Link {
        let [a, b] = &mut self.links;
        match from {
            Side::A => a,
            Side::B => b,
        }
    }

    pub(super) const fn is_cut(&self) -> bool {
        let [a, _] = &self.links;
        a.is_cut()
    }

    const fn delay(&self, from: Side) -> Duration {
        let [a, b] = &self.links;
        match from {
            Side::A => a.delay(),
            Side::B => b.delay(),
        }
    }

    const fn counters(&self, from: Side) -> LinkCounters {
        let [a, b] = &self.links;
        match from {
            Side::A => a.counters(),
            Side::B => b.counters(),
        }
    }
}

/// The frame of a cable's side at which the network stops, counted from 1.
#[derive(Debug)]
pub(super) struct Stop {
    cable: CableId,
    side: Side,
    frame: u64,
}

impl<M: Multihomed> Network<M> {
    /// Changes what a cable does to the frames that `side` sends.
    pub fn set_impairment(&mut self, cable: CableId, side: Side, impairment: Impairment) {
        if let Some(cable) = self.cables.get_mut(cable.0) {
            cable.link(side).set_impairment(impairment);
        }
    }

    /// Cuts a cable in both directions, or mends it. A cut loses datagrams in flight; bytes of a stream wait until
    /// the cable is mended or the stream's ends give up.
    pub fn set_cut(&mut self, id: CableId, cut: bool) {
        let Some(cable) = self.cables.get_mut(id.0) else { return };
        for side in [Side::A, Side::B] {
            cable.link(side).set_cut(cut);
        }
        if cut { self.hold_streams(id) } else { self.resume_streams(id) }
    }

    /// Makes [`next_event`](Self::next_event) return once `side` has put so many frames into a cable.
    pub fn stop_at_frame(&mut self, cable: CableId, side: Side, frame: Option<u64>) {
        self.stops.retain(|stop| (stop.cable, stop.side) != (cable, side));
        self.stops.extend(frame.map(|frame| Stop { cable, side, frame }));
    }

    /// Returns what a cable did to the frames that `side` sent.
    #[must_use]
    pub fn link_counters(&self, cable: CableId, side: Side) -> LinkCounters {
        self.cables.get(cable.0).map(|cable| cable.counters(side)).unwrap_or_default()
    }

    /// Returns whether a side has put in a frame at which the network stops, once for each such frame.
    pub(super) fn stops(&mut self) -> bool {
        if self.stops.is_empty() {
            return false;
        }
        let (cables, waiting) = (&self.cables, self.stops.len());
        let sent = |stop: &Stop| cables.get(stop.cable.0).map_or(0, |cable| cable.counters(stop.side).sent);
        self.stops.retain(|stop| sent(stop) < stop.frame);
        self.stops.len() < waiting
    }

    /// Returns what is at an end of a cable.
    pub(super) fn plug(&self, cable: CableId, side: Side) -> Option<Plug> {
        self.cables.get(cable.0).map(|cable| cable.end(side))
    }

    /// Returns the delay of a cable for what `from` sends, without jitter.
    pub(super) fn delay(&self, (cable, from): (CableId, Side)) -> Duration {
        self.cables.get(cable.0).map(|cable| cable.delay(from)).unwrap_or_default()
    }

    /// Counts a frame that was in flight on a cable when it was cut.
    pub(super) fn lose_in_flight(&mut self, cable: CableId, from: Side) {
        if let Some(cable) = self.cables.get_mut(cable.0) {
            cable.link(from).lose_in_flight();
        }
    }

    /// Passes a frame of a host, as ARP; `None` if the cable is cut.
    pub(super) fn pass_of_hosts(&mut self, cable: CableId, from: Side, now: Instant) -> Option<Instant> {
        self.cables.get_mut(cable.0)?.link(from).pass_of_hosts(now)
    }
}
