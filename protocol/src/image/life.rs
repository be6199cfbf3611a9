//! The age of an image: finds old images that a bus took for new, by the sender's life counter and the receiver's clock.
//!
//! Buses order frames within a window only (the cycle counter of PROFINET: 1.92 s of 2.048 s) or not at all (EtherCAT).
//! A frame that a switch held back for longer arrives as a new one.
//!
//! # The rule
//!
//! An image is accepted if its life counter is ahead of the last accepted one by at most what the receiver's clock says has
//! passed since, plus two steps of the sender. The same counter is a repetition. Any other image is outdated: the receiver
//! refuses it, and the image before stands, as if the frame had been lost.
//!
//! A counter of 16 bits wraps, so an old image appears as one that is ahead: by 65,536 minus its age in cycles. It is refused
//! until that is less than the allowance, so an image of a sender that counts every millisecond is recognised until it is
//! 65.5 s old. That is the limit.
//!
//! # Why it is computed with a line
//!
//! Let the *lead* of an image be its counter times the sender's cycle, minus the time of its arrival. It differs from image to
//! image by their delays only. "Ahead by at most what has passed" compares the lead with that of an earlier image, and the
//! question is with which one:
//!
//! - Not with the last one. After a stall of cable or host the images arrive late, in a burst, and each would be too far ahead
//!   of the late one before it. The highest lead is that of the most punctual image, and a late one does not lower it.
//! - Not with the highest one for ever. The sender's clock may be slower than the receiver's: the leads then fall, by 0.7 s in
//!   an hour at 200 ppm, and the allowance would grow by as much. So it is the highest lead of the last 10 to 20 s
//!   ([`MEMORY`]), in which clocks with 500 ppm between them, the most by which NTP steers one, differ by 10 ms. A sender
//!   with a faster clock raises the highest lead with each image, by much less than two cycles.
//! - Not with the first one. It may itself be late, and all later ones would be too far ahead of it. So while the receiver
//!   acts on nothing yet (the robot is `Halted`, the PLC leads the robot to `Ready`), each image that is too far ahead or old
//!   sets a new start. From then on delays can only grow.
//!
//! Two steps: the sender's program and its bus are not synchronous, so the delay from one to the other may change by one
//! step at once; the other one is for everything else. A step is one cycle, or the least by which the counter rises from one
//! image to the next where that is more: a program that runs every 16 ms may count milliseconds. The time is that of the arrival, not that at which the receiver's
//! program reads the image: it reads in cycles of its own, and a drift between these and the bus would move the lead by a
//! whole receiver's cycle at once. Where many frames wait in a stalled receiver, they arrive when it takes them: late.
//!
//! A sender that counts slower than its setup says is only late more and more, and so is one that pauses; that widens the
//! allowance by at most twice [`MEMORY`]. One that counts so much faster that it is two cycles ahead from one image to the
//! next (no step is learnt from such images) is refused: its setup is wrong, and the error says so.
//! A sender whose counter never moves cannot be judged. It is named once, and its images are accepted; when it moves, it
//! starts there.

use machine::{Duration, Instant};

/// Steps of the sender by which an image may be ahead of the receiver's clock: see the module.
const STEPS_AHEAD: i64 = 2;

/// Time for which the highest lead is remembered at least; at most twice as long. Longer than stalls and queues of a network
/// last, and so short that clocks do not drift by more than some cycles meanwhile.
const MEMORY: Duration = Duration::from_secs(10);

/// Time without a movement of the counter after which a sender is named that has never moved it.
const STALE_COUNTER_TIME: Duration = Duration::from_secs(1);

/// What the life counter of an image says.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Age {
    /// The image is the next one, or the first of a connection.
    New,
    /// It is the last accepted one once more, or from a sender that does not count.
    Repeated,
    /// It is older than the last accepted one, or ahead of the receiver's clock.
    Outdated,
}

/// Judges the age of received images.
#[derive(Clone, Debug)]
pub struct LifeMonitor {
    /// The sender's cycle, in ns.
    cycle_ns: i64,
    /// The last accepted counter, and how often the sender had counted then since the start.
    last: Option<(u16, i64)>,
    /// When that image arrived.
    last_at: Instant,
    /// The least by which the counter has risen from one image to the next.
    step: Option<u16>,
    /// When the first image of the connection arrived.
    first_at: Instant,
    /// Whether the counter has moved on this connection.
    has_moved: bool,
    /// Whether a sender whose counter stands still was named on this connection.
    is_named: bool,
    /// Whether the receiver has acted on images of this connection: the start then stands.
    is_acted_on: bool,
    /// The highest lead, in ns, since `began_at` and in the time before.
    leads: [i64; 2],
    began_at: Instant,
    /// The counter of the last image that was refused, if none was accepted since.
    refused: Option<u16>,
    outdated: u64,
    /// Frames that the bus had received, and when their number last changed.
    received: u64,
    arrived_at: Instant,
}

impl LifeMonitor {
    /// Creates a monitor of a sender that counts once in this time.
    #[must_use]
    pub fn new(cycle: Duration) -> Self {
        Self {
            cycle_ns: nanos(cycle).max(1),
            last: None,
            last_at: Instant::ZERO,
            step: None,
            first_at: Instant::ZERO,
            has_moved: false,
            is_named: false,
            is_acted_on: false,
            leads: [0; 2],
            began_at: Instant::ZERO,
            refused: None,
            outdated: 0,
            received: 0,
            arrived_at: Instant::ZERO,
        }
    }

    /// Takes the number of frames that the bus has received so far. Where it has changed, the present image arrived now.
    pub const fn note_arrival(&mut self, now: Instant, received: u64) {
        if self.received != received {
            (self.received, self.arrived_at) = (received, now);
        }
    }

    /// Judges the bus's present image, which has this life counter, and counts it if it is outdated. One that is read more
    /// often counts once.
    pub fn judge_present(&mut self, life: u16) -> Age {
        self.judge(self.arrived_at, life)
    }

    /// Forgets the connection: the next image sets the start.
    pub const fn restart(&mut self) {
        (self.last, self.step, self.refused) = (None, None, None);
        (self.has_moved, self.is_named, self.is_acted_on) = (false, false, false);
    }

    /// Says that the receiver acts on the images of this connection from now on. Until then each image sets the start anew
    /// where it has to.
    pub const fn act(&mut self) {
        self.is_acted_on = true;
    }

    /// Judges the image with this life counter that arrived at `at`.
    fn judge(&mut self, at: Instant, life: u16) -> Age {
        let Some((before, count)) = self.last else {
            self.first_at = at;
            self.start(at, life);
            return Age::New;
        };
        let ahead = life.wrapping_sub(before);
        if ahead == 0 {
            self.refused = None;
            return Age::Repeated;
        }
        if !self.has_moved {
            self.has_moved = true;
            self.start(at, life);
            return Age::New;
        }
        self.learn_step(at, ahead);
        let count = count.saturating_add(i64::from(ahead));
        let lead = self.lead(at, count);
        let [one, other] = self.leads;
        if lead > one.max(other).saturating_add(self.allowance()) {
            if !self.is_acted_on {
                self.start(at, life);
                return Age::New;
            }
            self.outdated += u64::from(self.refused.replace(life) != Some(life));
            return Age::Outdated;
        }
        (self.last, self.last_at, self.refused) = (Some((life, count)), at, None);
        self.remember(at, lead);
        Age::New
    }

    /// Returns, once for each connection, that the sender's counter has never moved although its images arrive.
    pub fn take_still(&mut self, now: Instant) -> bool {
        let is_still =
            self.last.is_some() && !self.has_moved && now.since(self.first_at) >= STALE_COUNTER_TIME;
        is_still && !core::mem::replace(&mut self.is_named, true)
    }

    /// Returns the number of images that were refused so far.
    #[must_use]
    pub const fn outdated(&self) -> u64 {
        self.outdated
    }

    /// Sets the start: nothing is known of the time before.
    fn start(&mut self, at: Instant, life: u16) {
        (self.last, self.last_at, self.refused) = (Some((life, 0)), at, None);
        (self.leads, self.began_at) = ([self.lead(at, 0); 2], at);
    }

    /// Learns the sender's step from an image that is not further ahead of the one before it than two cycles allow. In a burst,
    /// and from a sender that counts too fast, nothing is learnt.
    fn learn_step(&mut self, at: Instant, ahead: u16) {
        let passed = nanos(at.since(self.last_at)).saturating_add(self.cycle_ns.saturating_mul(2));
        if i64::from(ahead).saturating_mul(self.cycle_ns) <= passed {
            self.step = Some(self.step.map_or(ahead, |step| step.min(ahead)));
        }
    }

    /// Time by which an image may be ahead of the most punctual one.
    fn allowance(&self) -> i64 {
        let step = i64::from(self.step.unwrap_or(1));
        STEPS_AHEAD.saturating_mul(step).saturating_mul(self.cycle_ns)
    }

    fn lead(&self, at: Instant, count: i64) -> i64 {
        let at = i64::try_from(at.as_nanos()).unwrap_or(i64::MAX);
        count.saturating_mul(self.cycle_ns).saturating_sub(at)
    }

    fn remember(&mut self, at: Instant, lead: i64) {
        let [now, _] = self.leads;
        if now.saturating_sub(lead) > nanos(MEMORY) {
            // No network holds images back for so long: the sender paused.
            (self.leads, self.began_at) = ([lead; 2], at);
        } else if at.since(self.began_at) >= MEMORY {
            (self.leads, self.began_at) = ([lead, now], at);
        } else {
            self.leads[0] = now.max(lead);
        }
    }
}

fn nanos(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests;
