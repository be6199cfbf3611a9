//! The frames of one connection in one direction: which are new, which a mirror port doubled, which are missing.

use std::hash::{DefaultHasher, Hasher as _};

use protocol::image::{IMAGE_LEN, Image, Order};

use crate::address::CyclicBus;
use crate::content::{ContentSearch, ImageDirection};
use crate::cyclic::{CyclicFrame, FlowKey};
use crate::pace::FramePace;
use crate::relation::Agreement;

/// Frames among which a doubled one is recognised.
const RECENT: usize = 4;

/// Length of a run/idle header in bytes (volume 1, 3-6.1.4).
const RUN_IDLE_LEN: usize = 4;

/// Time from which on the 16 bits of a cycle counter no longer count missing frames: half of its period.
const COUNTER_PERIOD_NS: u64 = 1_024_000_000;

/// Frames of one direction, by what became of them.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct FrameCounts {
    /// Frames, each once.
    pub(crate) frames: u64,
    /// Frames that were there again.
    pub(crate) doubled: u64,
    /// Frames that the counters skip: not captured, or not sent.
    pub(crate) missing: u64,
    /// Frames after a later one.
    pub(crate) disordered: u64,
}

impl FrameCounts {
    pub(crate) const fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        self.doubled += other.doubled;
        self.missing += other.missing;
        self.disordered += other.disordered;
    }
}

/// An image of a new frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NewImage {
    pub(crate) direction: ImageDirection,
    pub(crate) order: Order,
    pub(crate) image: Image,
}

/// ImageDirection of a flow and place of the image.
#[derive(Clone, PartialEq, Eq, Debug)]
struct FrameLayout {
    direction: ImageDirection,
    /// Position and length in bytes of the parts of the image.
    parts: Vec<(usize, usize)>,
    sdu_len: Option<usize>,
    is_agreed: bool,
}

/// One connection in one direction.
#[derive(Clone, Debug)]
pub(crate) struct Flow {
    pub(crate) key: FlowKey,
    layout: Option<FrameLayout>,
    search: ContentSearch,
    /// Counter and digest of the last frames.
    recent: [Option<(u32, u64)>; RECENT],
    last_ns: u64,
    /// Counts of the counter in one cycle; 0 if it is not known yet.
    step: u32,
    counts: FrameCounts,
    pace: FramePace,
}

impl Flow {
    /// Creates a flow; `usual_cycle_ns` is the cycle of the setup, where nothing else tells it.
    pub(crate) fn new(key: FlowKey, usual_cycle_ns: u64) -> Self {
        let mut pace = FramePace::default();
        pace.set_cycle(usual_cycle_ns);
        Self {
            key,
            layout: None,
            search: ContentSearch::default(),
            recent: [None; RECENT],
            last_ns: 0,
            step: u32::from(key.bus == CyclicBus::EthernetIp),
            counts: FrameCounts::default(),
            pace,
        }
    }

    /// Takes up what was agreed for its frames, when the connection was set up.
    pub(crate) fn agree(&mut self, agreement: &Agreement) {
        let parts = match agreement.parts.is_empty() {
            // The numbers of EtherNet/IP's assemblies say nothing of a header before the data.
            true if self.key.bus == CyclicBus::EthernetIp => Vec::new(),
            _ => agreement.parts.clone(),
        };
        self.layout = Some(FrameLayout {
            direction: agreement.direction,
            parts,
            sdu_len: agreement.sdu_len,
            is_agreed: true,
        });
        self.step = agreement.step;
        self.pace.disconnect();
        self.pace.set_cycle(agreement.cycle_ns);
        self.recent = [None; RECENT];
    }

    /// Returns its direction, once it is known.
    pub(crate) fn direction(&self) -> Option<ImageDirection> {
        self.layout.as_ref().map(|layout| layout.direction)
    }

    /// Returns whether its direction was agreed when the connection was set up.
    pub(crate) fn is_agreed(&self) -> bool {
        self.layout.as_ref().is_some_and(|layout| layout.is_agreed)
    }

    pub(crate) const fn counts(&self) -> &FrameCounts {
        &self.counts
    }

    pub(crate) const fn pace(&self) -> &FramePace {
        &self.pace
    }

    /// Returns whether the search for the image in its frames ended without one.
    pub(crate) const fn is_unknown(&self) -> bool {
        self.layout.is_none() && !self.search.is_open()
    }

    /// Counts a frame; returns its image if it is new and the place of the image is known.
    pub(crate) fn handle_frame(&mut self, now_ns: u64, frame: &CyclicFrame<'_>) -> Option<NewImage> {
        let sdu_len = self.layout.as_ref().and_then(|layout| layout.sdu_len);
        let counter = frame.counter(sdu_len)?;
        if !self.is_new(now_ns, counter, frame.body) {
            return None;
        }
        let order = order_of(self.key.bus);
        if self.layout.is_none() {
            let (direction, at) = self.search.add(order, frame.body)?;
            let parts = vec![(at, IMAGE_LEN)];
            self.layout = Some(FrameLayout { direction, parts, sdu_len: None, is_agreed: false });
        }
        let layout = self.layout.as_ref()?;
        let image = layout.image_in(frame.body)?;
        Some(NewImage { direction: layout.direction, order, image })
    }

    /// Counts a frame by its counter; returns whether it is new.
    fn is_new(&mut self, now_ns: u64, counter: u32, body: &[u8]) -> bool {
        let mut hasher = DefaultHasher::new();
        hasher.write(body);
        let digest = hasher.finish();
        if self.recent.contains(&Some((counter, digest))) {
            self.counts.doubled += 1;
            return false;
        }
        let last = self.recent[0].map(|(counter, _)| counter);
        let since = now_ns.saturating_sub(self.last_ns);
        let missing = match last {
            None => 0,
            Some(last) => match self.advance(counter, last, since) {
                Some(missing) => missing,
                None => {
                    self.counts.disordered += 1;
                    return false;
                }
            },
        };
        self.recent.rotate_right(1);
        self.recent[0] = Some((counter, digest));
        self.last_ns = now_ns;
        self.counts.frames += 1;
        self.counts.missing += missing;
        self.pace.add(now_ns, missing);
        true
    }

    /// Returns how many frames are missing between two counters; `None` if the second is earlier.
    fn advance(&mut self, counter: u32, last: u32, since_ns: u64) -> Option<u64> {
        let is_short = self.key.bus != CyclicBus::EthernetIp;
        let difference = counter.wrapping_sub(last);
        let difference = if is_short { difference & 0xFFFF } else { difference };
        let half = if is_short { 0x8000 } else { 0x8000_0000 };
        let cycle = self.pace.cycle_ns().max(1);
        if is_short && since_ns >= COUNTER_PERIOD_NS {
            return Some((since_ns / cycle).saturating_sub(1));
        }
        if difference >= half {
            return None;
        }
        if self.step == 0 {
            self.step = difference.max(1);
        }
        Some(u64::from(difference / self.step.max(1)).saturating_sub(1))
    }
}

impl FrameLayout {
    /// Returns the image in the data of a frame, with zeros where the data is shorter; `None` if the frame is cut.
    fn image_in(&self, body: &[u8]) -> Option<Image> {
        let mut image = [0; IMAGE_LEN];
        if self.parts.is_empty() {
            // EtherNet/IP: a run/idle header stands before the data O→T, and not before that T→O.
            let header = if self.direction == ImageDirection::Command { RUN_IDLE_LEN } else { 0 };
            let data = body.get(header..)?;
            image.iter_mut().zip(data).for_each(|(place, byte)| *place = *byte);
            return Some(image);
        }
        let mut rest = &mut image[..];
        for (at, length) in &self.parts {
            let (part, later) = rest.split_at_mut((*length).min(rest.len()));
            part.copy_from_slice(body.get(*at..at + part.len())?);
            rest = later;
        }
        Some(image)
    }
}

/// Returns the byte order of the image on a bus.
const fn order_of(bus: CyclicBus) -> Order {
    match bus {
        CyclicBus::ProfinetRt | CyclicBus::ProfinetUdp => Order::BigEndian,
        CyclicBus::EthernetIp => Order::LittleEndian,
    }
}
