//! Faults of a script: when each begins and ends, and what it does to frames and device.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Allowed, Instant, Peer, Source};

use crate::playback::instant;
use crate::script::{FaultKind, ScriptedFault};

/// Fault and how far it has come.
#[derive(Clone, Debug)]
pub(crate) struct TimedFault {
    pub(crate) fault: ScriptedFault,
    begin: Instant,
    end: Option<Instant>,
    pub(crate) phase: FaultPhase,
    /// True once an alarm or emergency is on its way.
    pub(crate) is_sent: bool,
}

/// Progress of a fault.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum FaultPhase {
    Waiting,
    Active,
    /// Its end is not reported yet.
    Ending,
    Over,
}

impl TimedFault {
    /// Places a fault in time: its times count from `start`.
    pub(crate) fn new(fault: ScriptedFault, start: Instant) -> Self {
        let begin = instant(start, fault.at);
        let end = fault.seconds.map(|seconds| instant(begin, seconds));
        Self { fault, begin, end, phase: FaultPhase::Waiting, is_sent: false }
    }

    /// Follows the time. Returns true if the fault began or ended.
    pub(crate) fn follow(&mut self, now: Instant) -> bool {
        let next = match self.phase {
            FaultPhase::Waiting if self.begin <= now => FaultPhase::Active,
            FaultPhase::Active if self.end.is_some_and(|end| end <= now) => FaultPhase::Ending,
            _ => return false,
        };
        self.phase = next;
        true
    }

    pub(crate) fn is_active(&self, kind: FaultKind) -> bool {
        self.phase == FaultPhase::Active && self.fault.kind == kind
    }
}

/// Frames that a slow device has not handled yet.
#[derive(Default, Debug)]
pub(crate) struct HeldFrames(Vec<HeldFrame>);

#[derive(Debug)]
struct HeldFrame {
    due: Instant,
    from: Source,
    is_broadcast: bool,
    frame: Vec<u8>,
}

/// Largest number of frames that wait; more are lost, as in a device with as many buffers.
const MOST_FRAMES: usize = 256;

impl HeldFrames {
    pub(crate) fn hold(&mut self, due: Instant, from: Source, frame: &[u8], is_broadcast: bool) {
        if self.0.len() < MOST_FRAMES {
            self.0.push(HeldFrame { due, from, is_broadcast, frame: frame.to_vec() });
        }
    }

    /// Returns the next frame that is due.
    pub(crate) fn next(&mut self, now: Instant) -> Option<(Source, Vec<u8>, bool)> {
        let first = self.0.first().filter(|held| held.due <= now)?;
        let (from, is_broadcast) = (first.from, first.is_broadcast);
        Some((from, self.0.remove(0).frame, is_broadcast))
    }

    pub(crate) fn poll_timeout(&self) -> Option<Instant> {
        self.0.first().map(|held| held.due)
    }
}

/// Changes of a device that faults make.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub(crate) struct Alteration {
    pub(crate) is_other_identity: bool,
    pub(crate) is_longer: bool,
    pub(crate) missing_slot: Option<u16>,
    pub(crate) refuses: bool,
    /// Restarts since the start.
    pub(crate) generation: u32,
}

impl Alteration {
    pub(crate) const fn extra_input_bytes(&self) -> u16 {
        if self.is_longer { 1 } else { 0 }
    }

    /// Returns who may connect: everybody, or nobody.
    pub(crate) fn peers(&self) -> Allowed {
        if !self.refuses {
            return Allowed::default();
        }
        let mac = Mac([0; 6]);
        Allowed(vec![Peer { address: Some(Ipv4Addr::UNSPECIFIED), mac: Some(mac), serial_number: Some(0) }])
    }
}
