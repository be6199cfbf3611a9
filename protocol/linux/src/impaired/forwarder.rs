//! The forwarder of an impaired cable without its sockets: what happens to each frame, and when it is passed on.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::time::Duration;

use capture_file::CableEvent;
use machine::Instant;
use virtual_time::{ImpairmentPlan, Link, LinkCounters, LinkEffect, Side};

use super::frame::{Contents, put_in};

/// Frames that the cable holds at once: one second of both directions at two frames a millisecond.
const PLACES: usize = 4_096;

/// Longest frame: what an interface with 1500 bytes of payload carries, with its header and a tag.
pub(super) const ROOM: usize = 1_536;

/// A frame on the cable; ordered by arrival, then by the order in which frames were sent.
#[derive(PartialEq, Eq, PartialOrd, Ord, Debug)]
struct FrameUnderWay {
    arrives: Instant,
    number: u64,
    to: Side,
    effect: LinkEffect,
    place: usize,
    len: usize,
}

/// What is due.
#[derive(Debug)]
pub(super) enum DueWork<'a> {
    /// The cable's state changes.
    Change(CableEvent),
    /// A frame arrives.
    Frame { to: Side, effect: LinkEffect, frame: &'a [u8] },
}

#[derive(Debug)]
pub(super) struct Forwarder {
    links: [Link; 2],
    /// Delay of the hosts' own traffic, per sender.
    delays: [Duration; 2],
    under_way: BinaryHeap<Reverse<FrameUnderWay>>,
    places: Box<[[u8; ROOM]]>,
    free: Vec<usize>,
    next_number: u64,
    cut: bool,
    cuts: Vec<(Duration, bool)>,
    next_cut: usize,
    ready: Option<Instant>,
}

impl Forwarder {
    /// Allocates all memory that it will ever need.
    pub(super) fn new(plan: &ImpairmentPlan) -> Self {
        let [to_second, to_first] = plan.links;
        Self {
            links: [Link::new(to_second, plan.seed, 0), Link::new(to_first, plan.seed, 1)],
            delays: [to_second.delay, to_first.delay],
            under_way: BinaryHeap::with_capacity(PLACES),
            places: vec![[0; ROOM]; PLACES].into_boxed_slice(),
            free: (0..PLACES).collect(),
            next_number: 0,
            cut: false,
            cuts: plan.cuts.clone(),
            next_cut: 0,
            ready: None,
        }
    }

    /// Sets when both ends are ready: the times of cuts count from here.
    pub(super) fn set_ready(&mut self, at: Instant) {
        self.ready.get_or_insert(at);
    }

    /// Returns what was done to the frames of each sender.
    pub(super) fn counters(&self) -> [LinkCounters; 2] {
        let [first, second] = &self.links;
        [first.counters(), second.counters()]
    }

    /// Takes a frame that `from` sent and returns what happens to it.
    pub(super) fn take(&mut self, now: Instant, from: Side, frame: &[u8]) -> LinkEffect {
        let contents = Contents::of(frame);
        let (cut, delay) = (self.cut, self.delays[from.index()]);
        let Self { links, under_way, places, free, next_number, .. } = self;
        let link = &mut links[from.index()];
        let mut has_room = true;
        let mut put = |arrives, effect, seen: &[u8]| {
            let fits = if frame.len() <= ROOM { free.pop() } else { None };
            let copy = fits.and_then(|place| Some((place, places.get_mut(place)?.get_mut(..frame.len())?)));
            let Some((place, copy)) = copy else {
                has_room = false;
                return;
            };
            copy.copy_from_slice(frame);
            put_in(copy, &contents, seen);
            *next_number += 1;
            let (number, to, len) = (*next_number, from.other(), frame.len());
            under_way.push(Reverse(FrameUnderWay { arrives, number, to, effect, place, len }));
        };
        let mut effect = match &contents {
            Contents::Machine { seen, .. } => {
                link.pass(now, frame.get(seen.clone()).unwrap_or_default(), &mut put)
            }
            // A piece is not corrupted: its receiver would find that, so it would only be lost.
            Contents::Piece => link.pass(now, &[], &mut put),
            Contents::Hosts if cut => LinkEffect { cut, ..LinkEffect::default() },
            Contents::Hosts => {
                put(now + delay, LinkEffect::default(), &[]);
                LinkEffect::default()
            }
        };
        if !has_room {
            link.lose_in_flight();
            effect.lost = true;
        }
        effect
    }

    /// Returns when [`next_due`](Self::next_due) next has something.
    pub(super) fn deadline(&self) -> Option<Instant> {
        let arrival = self.under_way.peek().map(|Reverse(next)| next.arrives);
        Instant::earlier(arrival, self.cut_due().map(|(at, _)| at))
    }

    /// Returns the next thing that is due by now.
    pub(super) fn next_due(&mut self, now: Instant) -> Option<DueWork<'_>> {
        let due = self.deadline().filter(|due| *due <= now)?;
        if let Some((_, cut)) = self.cut_due().filter(|(at, _)| *at <= due) {
            self.next_cut += 1;
            return Some(DueWork::Change(self.set_cut(cut)));
        }
        let Reverse(FrameUnderWay { to, effect, place, len, .. }) = self.under_way.pop()?;
        self.free.push(place);
        Some(DueWork::Frame { to, effect, frame: self.places.get(place)?.get(..len)? })
    }

    fn cut_due(&self) -> Option<(Instant, bool)> {
        let (after, cut) = self.cuts.get(self.next_cut)?;
        Some((self.ready? + *after, *cut))
    }

    fn set_cut(&mut self, cut: bool) -> CableEvent {
        self.cut = cut;
        self.links.iter_mut().for_each(|link| link.set_cut(cut));
        if !cut {
            return CableEvent::Mended;
        }
        let lost_under_way = self.under_way.len() as u64;
        for Reverse(FrameUnderWay { to, place, .. }) in self.under_way.drain() {
            self.links[to.other().index()].lose_in_flight();
            self.free.push(place);
        }
        CableEvent::Cut { lost_under_way }
    }
}

#[cfg(test)]
mod tests {
    use virtual_time::Impairment;

    use super::*;

    const MS: fn(u64) -> Duration = Duration::from_millis;

    fn profinet(number: u8) -> Vec<u8> {
        [&[0; 12][..], &[0x88, 0x92], &[number; 50]].concat()
    }

    fn arp() -> Vec<u8> {
        [&[0; 12][..], &[0x08, 0x06], &[0; 46]].concat()
    }

    /// Describes what is due until `until`.
    fn due(forwarder: &mut Forwarder, until: Instant) -> Vec<String> {
        let mut found = Vec::new();
        while let Some(due) = forwarder.next_due(until) {
            found.push(match due {
                DueWork::Change(note) => note.to_string(),
                DueWork::Frame { to, effect, frame } => {
                    format!("{to:?} {} {effect}", frame[20]).trim_end().to_owned()
                }
            });
        }
        found
    }

    #[test]
    fn random_decisions_equal_those_of_a_link_with_the_same_seed() {
        let hostile = Impairment {
            loss_ppm: 100_000,
            duplicate_ppm: 100_000,
            corrupt_ppm: 100_000,
            reorder_ppm: 100_000,
            reorder_by: MS(3),
            jitter: MS(1),
            ..Impairment::default()
        };
        let plan = ImpairmentPlan { links: [hostile; 2], seed: 7, ..ImpairmentPlan::default() };
        let (mut forwarder, mut link) = (Forwarder::new(&plan), Link::new(hostile, 7, 1));
        for number in 0..=255 {
            let now = Instant::from_millis(u64::from(number));
            assert_eq!(
                forwarder.take(now, Side::B, &profinet(number)),
                link.pass(now, &profinet(number), |_, _, _| {})
            );
            while forwarder.next_due(now).is_some() {}
        }
        assert_eq!(forwarder.counters()[1], link.counters());
        assert!(link.counters().corrupted > 10 && forwarder.counters()[0] == LinkCounters::default());
    }

    #[test]
    fn later_frames_overtake_a_frame_that_is_held_back() {
        let held = Impairment { reorder_ppm: 1_000_000, reorder_by: MS(2), ..Impairment::default() };
        let plan = ImpairmentPlan {
            links: [held, Impairment { delay: MS(1), ..Impairment::default() }],
            ..ImpairmentPlan::default()
        };
        let mut forwarder = Forwarder::new(&plan);
        forwarder.take(Instant::ZERO, Side::A, &profinet(1));
        forwarder.take(Instant::ZERO, Side::B, &profinet(2));
        assert_eq!(forwarder.deadline(), Some(Instant::from_millis(1)));
        assert_eq!(due(&mut forwarder, Instant::from_millis(5)), ["A 2", "B 1 fault: held back by 2ms"]);
    }

    #[test]
    fn a_cut_counts_from_when_both_ends_are_ready_and_loses_the_frames_on_the_cable() {
        let slow = Impairment { delay: MS(4), ..Impairment::default() };
        let cuts = vec![(MS(10), true), (MS(20), false)];
        let mut forwarder = Forwarder::new(&ImpairmentPlan { links: [slow; 2], cuts, seed: 1 });
        forwarder.take(Instant::ZERO, Side::A, &profinet(1));
        assert_eq!(due(&mut forwarder, Instant::from_millis(90)), ["B 1"]);
        forwarder.set_ready(Instant::from_millis(100));
        forwarder.take(Instant::from_millis(109), Side::A, &profinet(2));
        assert_eq!(
            due(&mut forwarder, Instant::from_millis(110)),
            ["fault: the cable is cut from here on; 1 frames under way are lost"]
        );
        for frame in [profinet(3), arp()] {
            let effect = forwarder.take(Instant::from_millis(111), Side::B, &frame);
            assert_eq!(effect.to_string(), "fault: lost, the cable is cut");
        }
        assert_eq!(due(&mut forwarder, Instant::from_millis(120)), ["the cable is mended"]);
        assert!(forwarder.take(Instant::from_millis(121), Side::B, &profinet(4)).is_clean());
        assert_eq!(forwarder.counters().map(|link| link.lost), [1, 1], "ARP is no frame of a machine");
    }

    #[test]
    fn random_faults_spare_the_hosts_own_traffic() {
        let lossy = Impairment { loss_ppm: 1_000_000, ..Impairment::default() };
        let mut forwarder =
            Forwarder::new(&ImpairmentPlan { links: [lossy; 2], ..ImpairmentPlan::default() });
        assert!(forwarder.take(Instant::ZERO, Side::A, &profinet(1)).lost);
        assert!(forwarder.take(Instant::ZERO, Side::A, &arp()).is_clean());
        assert_eq!(due(&mut forwarder, Instant::ZERO), ["B 0"]);
    }

    #[test]
    fn a_frame_without_room_is_lost_and_counted_and_places_are_reused() {
        let slow = Impairment { delay: MS(1_000), ..Impairment::default() };
        let mut forwarder = Forwarder::new(&ImpairmentPlan { links: [slow; 2], ..ImpairmentPlan::default() });
        for _ in 0..2 {
            for _ in 0..PLACES {
                assert!(forwarder.take(Instant::ZERO, Side::A, &profinet(1)).is_clean());
            }
            assert!(forwarder.take(Instant::ZERO, Side::A, &profinet(1)).lost);
            assert_eq!(due(&mut forwarder, Instant::from_millis(1_000)).len(), PLACES);
        }
        assert!(forwarder.take(Instant::ZERO, Side::A, &[0; ROOM + 1]).lost, "a frame that is too long");
        assert_eq!(forwarder.counters()[0].lost, 3);
    }
}
