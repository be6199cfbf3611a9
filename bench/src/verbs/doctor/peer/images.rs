//! Images of a foreign end: whether they come, count, and carry a right check.

use machine::{Duration, Instant};
use protocol::image::{Checker, IMAGE_LEN, Image, LifeMonitor, Order, Verdict};

use crate::verbs::doctor::finding::Finding;

const FIRST_FRAME: &str = "first frame";
const LIFE: &str = "life counter";
const CHECK: &str = "check";

/// Largest ratio of the counter's real speed and that of the setup, either way, that counts as equal: a counter that runs this
/// much faster is not yet refused for the whole of a run, and host stalls stay below it.
const MOST_DEVIATION: f64 = 1.2;

/// Counts of a life counter.
#[derive(Clone, Copy, Debug)]
struct LifeCount {
    last: u16,
    /// When it moved first and last.
    moved: Option<(Instant, Instant)>,
    /// Counts between these.
    counted: u64,
    moves: u64,
    /// Moves that are large as the counter is read, and small with its bytes the other way round.
    swapped: u64,
}

/// Watches the images that arrive. `AT` is where their check begins.
#[derive(Debug)]
pub(super) struct ImageWatch<const AT: usize> {
    order: Order,
    checker: Checker<AT>,
    /// Verifies the check as if it had the other byte order.
    other_order: Checker<AT>,
    life: LifeMonitor,
    cycle: Duration,
    first_at: Option<Instant>,
    last: Image,
    /// Images that differ from the one before.
    images: u64,
    intact: u64,
    swapped: u64,
    count: Option<LifeCount>,
    /// Set if the next image is the first of a connection.
    is_new: bool,
}

impl<const AT: usize> ImageWatch<AT> {
    /// Creates a watch of a sender that counts once in this cycle.
    pub(super) fn new(order: Order, cycle: Duration) -> Self {
        Self {
            order,
            checker: Checker::default(),
            other_order: Checker::default(),
            life: LifeMonitor::new(cycle),
            cycle,
            first_at: None,
            last: [0; IMAGE_LEN],
            images: 0,
            intact: 0,
            swapped: 0,
            count: None,
            is_new: false,
        }
    }

    /// Forgets the connection: the next image is that of another one.
    pub(super) const fn disconnect(&mut self) {
        self.checker.disconnect();
        self.other_order.disconnect();
        self.life.restart();
        self.is_new = true;
    }

    /// Returns when the first image came.
    pub(super) const fn first_at(&self) -> Option<Instant> {
        self.first_at
    }

    /// Takes the present image, which has this life counter. `received` are the frames so far. Returns whether its check allows
    /// to read it.
    pub(super) fn take(&mut self, now: Instant, image: &Image, life: u16, received: u64) -> bool {
        self.life.note_arrival(now, received);
        let is_first = self.first_at.is_none();
        self.first_at.get_or_insert(now);
        if *image == self.last && !is_first {
            return true;
        }
        (self.last, self.images) = (*image, self.images + 1);
        let verdict = self.checker.verify(self.order, image);
        self.intact += u64::from(verdict == Verdict::Intact);
        if verdict == Verdict::Altered {
            let is_swapped = self.other_order.verify(other(self.order), image) == Verdict::Intact;
            self.swapped += u64::from(is_swapped);
            return false;
        }
        self.life.act();
        self.life.judge_present(life);
        self.count_life(now, life);
        true
    }

    fn count_life(&mut self, now: Instant, life: u16) {
        if std::mem::take(&mut self.is_new) {
            self.count = None;
        }
        let Some(count) = &mut self.count else {
            self.count = Some(LifeCount { last: life, moved: None, counted: 0, moves: 0, swapped: 0 });
            return;
        };
        let ahead = life.wrapping_sub(count.last);
        if ahead == 0 {
            return;
        }
        let ahead_if_swapped = life.swap_bytes().wrapping_sub(count.last.swap_bytes());
        count.last = life;
        count.moves += 1;
        count.swapped += u64::from(ahead >= 256 && ahead_if_swapped < 256);
        match &mut count.moved {
            Some((_, last)) => (*last, count.counted) = (now, count.counted + u64::from(ahead)),
            None => count.moved = Some((now, now)),
        }
    }

    /// Returns the findings on the first frame, the life counter and the check.
    pub(super) fn findings(&self, sender: &str) -> [Finding; 3] {
        if self.first_at.is_none() {
            let fix = "see the step `connection`: images come only over a connection that is up";
            return [FIRST_FRAME, LIFE, CHECK].map(|what| Finding::not_seen(what, "no image came", fix));
        }
        [self.first_frame(sender), self.life_counter(), self.check(sender)]
    }

    fn first_frame(&self, sender: &str) -> Finding {
        if self.last.iter().all(|byte| *byte == 0) {
            let fix = format!(
                "start the program of the {sender}, and map the {IMAGE_LEN} bytes of its image to it"
            );
            return Finding::missing(FIRST_FRAME, "frames come, but every byte is 0", fix);
        }
        let plural = if self.images == 1 { "" } else { "s" };
        Finding::good(FIRST_FRAME, format!("{} different image{plural} of {IMAGE_LEN} bytes", self.images))
    }

    fn life_counter(&self) -> Finding {
        let Some(count) = self.count else {
            return Finding::not_seen(LIFE, "no image with a right check", "correct the check first");
        };
        let Some((first, last)) = count.moved else {
            let found = format!("stays at {}", count.last);
            return Finding::missing(LIFE, found, "add 1 in each cycle of the sending program, modulo 65536");
        };
        if count.swapped == count.moves && count.moves > 1 {
            let fix = "swap the bytes: PROFINET sends the high byte of a number first, the other buses the low byte";
            return Finding::missing(LIFE, "counts with its bytes the other way round", fix);
        }
        let elapsed = last.since(first).as_secs_f64();
        let [speed, wanted] =
            [count.counted as f64 / elapsed.max(1e-9), 1.0 / self.cycle.as_secs_f64().max(1e-9)];
        let found = format!("{speed:.0} counts a second, {wanted:.0} in the setup");
        let outdated = self.life.outdated();
        if count.moves < 3 {
            let found = format!("moved {} times only", count.moves);
            Finding::missing(LIFE, found, "add 1 in each cycle of the sending program, modulo 65536")
        } else if speed > wanted * MOST_DEVIATION {
            let fix = "images of a counter that runs too fast are refused: count once a cycle, or correct the cycle in the setup";
            Finding::missing(LIFE, found, fix)
        } else if speed < wanted / MOST_DEVIATION {
            Finding::limited(LIFE, found, "count once in each cycle, or give the setup the real cycle")
        } else if outdated > 0 {
            let found = format!("{found}; {outdated} images were late or old");
            Finding::limited(LIFE, found, "look for switches and gateways that hold frames back")
        } else {
            Finding::good(LIFE, found)
        }
    }

    fn check(&self, sender: &str) -> Finding {
        let checks = self.checker.checks();
        let altered = format!("{} of {} images have a wrong check", checks.altered, self.images);
        if self.swapped > 0 && self.swapped == checks.altered {
            let fix = "send the check in the byte order of the bus, like every other number of the image";
            return Finding::missing(CHECK, format!("{altered}: its bytes are the other way round"), fix);
        }
        if checks.altered > 0 {
            let fix = format!(
                "let the {sender} compute CRC-32C as docs/process-image.md has it, or send 0; if few are wrong, look at cables"
            );
            return Finding::missing(CHECK, altered, fix);
        }
        if self.intact == 0 {
            let fix = "without a check altered images are not noticed: send CRC-32C where the sender can compute it";
            return Finding::limited(CHECK, format!("the {sender} sends none (0)"), fix);
        }
        Finding::good(CHECK, format!("CRC-32C right in {} images", self.intact))
    }
}

const fn other(order: Order) -> Order {
    match order {
        Order::BigEndian => Order::LittleEndian,
        Order::LittleEndian => Order::BigEndian,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::doctor::finding::Verdict::{Good, Limited, Missing, NotSeen};
    use protocol::image::{Command, CommandSealer};

    const ORDER: Order = Order::LittleEndian;

    /// Sends an image in each ms whose counter goes on by `step`.
    fn watched(step: u16, sealed_in: Option<Order>, emitted_in: Order) -> [Finding; 3] {
        let mut watch = ImageWatch::<32>::new(ORDER, Duration::from_millis(1));
        for cycle in 0..1_500_u16 {
            let command = Command { life: cycle.wrapping_mul(step), ..Command::default() };
            let mut image = [0; IMAGE_LEN];
            emitted_in.emit_command(&command, &mut image);
            if let Some(order) = sealed_in {
                let mut sealer = CommandSealer::default();
                sealer.take_tail(&image);
                sealer.seal(order, &mut image);
            }
            let life = ORDER.parse_command_head(&image).unwrap().life;
            watch.take(Instant::from_millis(cycle.into()), &image, life, cycle.into());
        }
        watch.findings("PLC")
    }

    fn verdicts(findings: &[Finding; 3]) -> [crate::verbs::doctor::finding::Verdict; 3] {
        [0, 1, 2].map(|index: usize| findings[index].verdict)
    }

    #[test]
    fn images_are_judged_by_their_counter_and_their_check() {
        assert_eq!(verdicts(&watched(1, Some(ORDER), ORDER)), [Good, Good, Good]);
        assert_eq!(verdicts(&watched(1, None, ORDER)), [Good, Good, Limited]);
        assert_eq!(verdicts(&watched(0, Some(ORDER), ORDER)), [Good, Missing, Good]);
        let fast = watched(3, Some(ORDER), ORDER);
        assert_eq!(verdicts(&fast), [Good, Missing, Good]);
        assert_eq!(fast[1].found, "3000 counts a second, 1000 in the setup");
        let none = ImageWatch::<32>::new(ORDER, Duration::from_millis(1)).findings("PLC");
        assert_eq!(verdicts(&none), [NotSeen; 3]);
    }

    #[test]
    fn the_wrong_byte_order_is_named_for_the_counter_and_for_the_check() {
        let counter = watched(1, None, Order::BigEndian);
        assert_eq!(counter[1].found, "counts with its bytes the other way round");
        let check = watched(1, Some(Order::BigEndian), ORDER);
        assert_eq!(verdicts(&check), [Good, NotSeen, Missing]);
        assert!(check[2].found.ends_with("its bytes are the other way round"), "{}", check[2].found);
    }
}
