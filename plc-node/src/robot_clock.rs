//! A robot's clock, estimated by the PLC from the stamps in the feedback; and the time for robots that start together.
//!
//! No image is seen before it was stamped. With y = time seen (PLC) − stamp (robot) − least delay, every image is a point
//! on or above the line of the true offsets, whether it was lost and repeated, late or read in a late scan. The least
//! delayed image of each half second is close to that line: at most `spread` above it.
//!
//! ```text
//! y │       o   o         each half second gives two limits of the line: the best image's y, and that minus the spread.
//!   │ o  o    o    o      The estimate at a time is the middle of all lines within all limits, the uncertainty half
//!   │──────────────── ◄   of their range
//!   └───────────────── stamp
//! ```
//!
//! Scans see stamps on their own grid, so an image waits up to a scan. Only drift moves that wait: at 30 ppm it takes
//! 33 s for 1 ms, and not before it has passed twice through 0 are offset and rate both known. The uncertainty says how far that has
//! come. Instants at which *frames* arrived have no such wait.

use std::collections::VecDeque;

use machine::{Duration, Instant};

/// Time whose least delayed image is kept. In a shorter one more images are late than jitter explains; in a longer one drift hides
/// how late an image can be.
const WINDOW: Duration = Duration::from_millis(500);

/// Images that a window has at least: one that has fewer lasts longer.
const IMAGES: u32 = 60;

/// Windows that are kept, 80 s: twice the time in which 1 ms passes at 25 ppm.
const WINDOWS: usize = 160;

/// Allowance for the jitter that is left in the least delayed image of a window, in ns. Of 100 µs that are evenly distributed more is left
/// in one of 10⁸ windows, even if a third of the images is lost.
const LEAST_JITTER_NS: f64 = 20_000.0;

/// Largest rate at which both clocks part: twice 100 ppm, the tolerance of a poor crystal (IEEE 802.3, 40.6.1.2.6: 100 ppm).
const MOST_DRIFT: f64 = 200e-6;

/// An offset that changes by more than this is a jump of the clock, or an image that was held back: in ns.
const JUMP_NS: f64 = 20e6;

/// This many images in a row with a jump are a clock that was set or restarted.
const JUMPED_IMAGES: u32 = 25;

/// This many windows in a row whose images are all late are a clock that was set back a little, or a slower network.
const LATE_WINDOWS: u32 = 4;

/// Time for which something may wait for an estimate: twice what one takes at most.
pub(crate) const CLOCK_WAIT: Duration = Duration::from_secs(2);

/// What delays an image from the robot's stamp until the PLC sees it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct StampDelay {
    /// Least delay: what every image takes. It shifts the estimate.
    pub least: Duration,
    /// Highest additional delay of an image that nothing disturbs: a scan cycle if scans give the time, 0 if the time is
    /// that of the frame.
    pub spread: Duration,
}

/// The robot's clock at an instant of the PLC.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Estimate {
    /// Robot's clock in ns.
    pub at_ns: u64,
    /// Largest error in ns, if [`StampDelay`] is right.
    pub uncertainty_ns: u64,
}

/// A stamp, and how much later it was seen.
#[derive(Clone, Copy, PartialEq, Debug)]
struct ClockPoint {
    stamp: u64,
    offset: i64,
}

impl ClockPoint {
    /// Returns the robot's time from an earlier stamp to this one, in ns.
    const fn since(&self, earlier: &Self) -> f64 {
        self.stamp.wrapping_sub(earlier.stamp).cast_signed() as f64
    }

    /// Returns by how much its offset is above another one, in ns.
    const fn above(&self, other: &Self) -> f64 {
        self.offset.wrapping_sub(other.offset) as f64
    }
}

/// Rates, as shares, that the line of the offsets may have.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Rates {
    least: f64,
    most: f64,
}

impl Rates {
    const ANY: Self = Self { least: -MOST_DRIFT, most: MOST_DRIFT };

    const fn and(self, other: Self) -> Self {
        Self { least: self.least.max(other.least), most: self.most.min(other.most) }
    }
}

/// The least delayed image of a window that has ended.
#[derive(Clone, Copy, PartialEq, Debug)]
struct ClockWindow {
    best: ClockPoint,
    /// Distance between both limits, in ns.
    width: f64,
    /// Rates that it allows together with each later one.
    rates: Rates,
}

/// The window that is filling.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Open {
    since: Instant,
    images: u32,
    /// The least delayed one at the middle of the rates that were known when the window began.
    best: ClockPoint,
    rates: Rates,
}

/// All lines of offsets that the kept windows allow, from the newest of them on.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Lines {
    newest: ClockPoint,
    /// The lowest and the highest of them at the newest point, in ns above its offset.
    range: [f64; 2],
    rates: Rates,
}

impl Lines {
    /// Returns the lowest and the highest offset some time after the newest point, in ns above its offset.
    const fn after(&self, nanos: f64) -> [f64; 2] {
        let nanos = nanos.max(0.0);
        [self.range[0] + nanos * self.rates.least, self.range[1] + nanos * self.rates.most]
    }
}

/// Estimates a robot's clock from its feedback, in constant memory.
#[derive(Clone, Debug)]
pub struct RobotClock {
    least_ns: i64,
    /// Distance between both limits of a window, in ns.
    width: f64,
    windows: VecDeque<ClockWindow>,
    open: Option<Open>,
    lines: Option<Lines>,
    last_stamp: Option<u64>,
    jumped_images: u32,
    late_windows: u32,
}

impl RobotClock {
    /// Creates an estimator that has seen nothing. All its memory is allocated here.
    #[must_use]
    pub fn new(delay: StampDelay) -> Self {
        let nanos = |duration: Duration| i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX);
        Self {
            least_ns: nanos(delay.least),
            width: nanos(delay.spread) as f64 + LEAST_JITTER_NS,
            windows: VecDeque::with_capacity(WINDOWS),
            open: None,
            lines: None,
            last_stamp: None,
            jumped_images: 0,
            late_windows: 0,
        }
    }

    /// Forgets everything: the connection was lost, or the robot is another one.
    pub fn restart(&mut self) {
        self.windows.clear();
        (self.open, self.lines, self.last_stamp) = (None, None, None);
        (self.jumped_images, self.late_windows) = (0, 0);
    }

    /// Takes over the stamp of an image and the time at which the PLC saw it: when the frame came, or the scan that read it.
    /// An image that stands, or comes twice, counts once.
    pub fn observe(&mut self, seen_at: Instant, clock_ns: u64) {
        if self.last_stamp.replace(clock_ns) == Some(clock_ns) {
            return;
        }
        let offset = seen_at.as_nanos().wrapping_sub(clock_ns).cast_signed().wrapping_sub(self.least_ns);
        let point = ClockPoint { stamp: clock_ns, offset };
        if self.is_jump(&point) {
            self.jumped_images += 1;
            if self.jumped_images < JUMPED_IMAGES {
                return;
            }
            self.restart();
            self.last_stamp = Some(clock_ns);
        }
        self.jumped_images = 0;
        let Some(open) = &mut self.open else {
            let rates = self.lines.map_or(Rates::ANY, |lines| lines.rates);
            self.open = Some(Open { since: seen_at, images: 1, best: point, rates });
            return;
        };
        open.images = open.images.saturating_add(1);
        let rate = 0.5 * (open.rates.least + open.rates.most);
        if point.above(&open.best) < rate * point.since(&open.best) {
            open.best = point;
        }
        if open.images >= IMAGES && seen_at.since(open.since) >= WINDOW {
            // Another one may be the least delayed by as much as the rate is unknown.
            let unknown = 0.5 * (open.rates.most - open.rates.least);
            let width = self.width + unknown * seen_at.since(open.since).as_secs_f64() * 1e9;
            let best = open.best;
            self.open = None;
            self.close(best, width);
        }
    }

    /// Returns the robot's clock at an instant of the PLC, which may lie ahead; none before the first images.
    #[must_use]
    pub fn robot_time(&self, plc_now: Instant) -> Option<Estimate> {
        let Lines { newest, .. } = self.lines?;
        let [now, offset] = [i128::from(plc_now.as_nanos()), i128::from(newest.offset)];
        let at_newest = now - offset;
        let since = (at_newest - i128::from(newest.stamp)) as f64;
        let (offset, _) = middle(self.lines?.after(since));
        // The offset is that at the robot's time, which is earlier by the change of the offset.
        let (offset, uncertainty) = middle(self.lines?.after(since - offset));
        let at_ns = u64::try_from(at_newest - offset as i128).ok()?;
        Some(Estimate { at_ns, uncertainty_ns: uncertainty.ceil() as u64 })
    }

    /// Returns whether an image's offset is farther from the others' than drift and delays explain.
    fn is_jump(&self, point: &ClockPoint) -> bool {
        let known = self.open.map(|open| open.best).or(self.lines.map(|lines| lines.newest));
        known.is_some_and(|known| {
            point.above(&known).abs() > JUMP_NS + self.width + MOST_DRIFT * point.since(&known).abs()
        })
    }

    /// Takes over the best image of a window, unless all its images were late.
    fn close(&mut self, best: ClockPoint, width: f64) {
        let is_late = self.lines.is_some_and(|lines| {
            best.above(&lines.newest) - width > lines.after(best.since(&lines.newest))[1]
        });
        self.late_windows = if is_late { self.late_windows + 1 } else { 0 };
        if is_late && self.late_windows < LATE_WINDOWS {
            return;
        }
        if is_late {
            self.windows.clear();
            self.late_windows = 0;
        }
        self.keep(best, width);
        self.drop_contradicted();
        self.find_lines();
    }

    /// Keeps a window, and what rates it allows together with each one before.
    fn keep(&mut self, best: ClockPoint, width: f64) {
        if self.windows.len() == WINDOWS {
            self.windows.pop_front();
        }
        for ClockWindow { best: before, width: before_width, rates } in &mut self.windows {
            let (since, above) = (best.since(before), best.above(before));
            if since > 0.0 {
                let per = 1.0 / since;
                let both = Rates { least: (above - width) * per, most: (above + *before_width) * per };
                *rates = rates.and(both);
            }
        }
        self.windows.push_back(ClockWindow { best, width, rates: Rates::ANY });
    }

    /// Drops the oldest windows that no line allows together with the newer ones: the rate has changed since, or all
    /// their images were late.
    fn drop_contradicted(&mut self) {
        let mut rates = Rates::ANY;
        let fits = |window: &&ClockWindow| {
            rates = rates.and(window.rates);
            rates.least <= rates.most
        };
        let fitting = self.windows.iter().rev().take_while(fits).count();
        self.windows.drain(..self.windows.len() - fitting);
    }

    fn find_lines(&mut self) {
        let Some(ClockWindow { best: newest, width, .. }) = self.windows.back().copied() else { return };
        let rates = self.windows.iter().fold(Rates::ANY, |rates, window| rates.and(window.rates));
        let mut range = [-width, 0.0];
        for ClockWindow { best, width, .. } in &self.windows {
            let (since, above) = (newest.since(best), best.above(&newest));
            range[0] = range[0].max(above - width + rates.least * since);
            range[1] = range[1].min(above + rates.most * since);
        }
        self.lines = Some(Lines { newest, range, rates });
    }
}

/// Returns the estimate between the lowest and the highest offset, and its largest error. Seldom is any of the jitter left that
/// is allowed for, so the lowest one counts without that.
const fn middle([lowest, highest]: [f64; 2]) -> (f64, f64) {
    let offset = (0.5 * (lowest + LEAST_JITTER_NS + highest)).min(highest);
    (offset, (highest - offset).max(offset - lowest))
}

/// Writes for each robot the time on its clock at which it must start, so that all start at `at`: bytes 20..28 of its
/// command. Returns the largest skew to which the estimates lead; none if a clock is not known yet, or a time is missing for one.
///
/// Choose `at` so late that every robot has the command before: a robot that reads a start time in its past starts at once.
pub fn start_together<'c>(
    at: Instant,
    clocks: impl IntoIterator<Item = &'c RobotClock>,
    start_times_ns: &mut [u64],
) -> Option<Duration> {
    let mut start_times = start_times_ns.iter_mut();
    // Of errors in opposite directions the skew is the sum.
    let mut largest = [0; 2];
    for clock in clocks {
        let Estimate { at_ns, uncertainty_ns } = clock.robot_time(at)?;
        // 0 is "at once".
        *start_times.next()? = at_ns.max(1);
        let [first, second] = largest;
        largest = if uncertainty_ns > first {
            [uncertainty_ns, first]
        } else {
            [first, second.max(uncertainty_ns)]
        };
    }
    let [first, second] = largest;
    Some(Duration::from_nanos(first.saturating_add(second)))
}

#[cfg(test)]
mod tests;
