//! The age of images in virtual time: senders with other clocks, delays, stalls and old images.

use super::*;
use proptest::prelude::*;

/// A sender and the way to the receiver, both in ns of the receiver's clock.
struct LifeSender {
    /// Its cycle on the receiver's clock.
    cycle_ns: u64,
    start_ns: u64,
    first: u16,
}

impl LifeSender {
    fn of(cycle_us: u64, ppm: i64) -> Self {
        let cycle_ns = (cycle_us as i64 * (1_000_000 + ppm) / 1_000) as u64;
        Self { cycle_ns, start_ns: 77_000_000_000, first: 65_000 }
    }

    fn sent_at(&self, count: u64) -> u64 {
        self.start_ns + count * self.cycle_ns
    }

    fn life(&self, count: u64) -> u16 {
        self.first.wrapping_add(count as u16)
    }
}

fn monitor(cycle_us: u64) -> LifeMonitor {
    LifeMonitor::new(Duration::from_micros(cycle_us))
}

/// A receiver that acts after 20 images without a delay. Returns the number of the next one.
fn settled(monitor: &mut LifeMonitor, sender: &LifeSender) -> u64 {
    for count in 0..20 {
        let at = Instant::from_nanos(sender.sent_at(count));
        assert_eq!(monitor.judge(at, sender.life(count)), Age::New);
    }
    monitor.act();
    20
}

/// Receives every tenth image until this one.
fn receive_until(monitor: &mut LifeMonitor, sender: &LifeSender, from: u64, until: u64) {
    for count in (from..until).step_by(10) {
        let at = Instant::from_nanos(sender.sent_at(count));
        assert_eq!(monitor.judge(at, sender.life(count)), Age::New);
    }
}

/// The ages in ms that are tried: an old frame of PROFINET appears as new between 2.0 and 2.1 s.
fn ages_ms() -> impl Iterator<Item = u64> {
    (2_000..2_100).chain((32_000..33_000).step_by(7)).chain((64_000..65_000).step_by(7)).chain([5, 50, 500])
}

#[test]
fn an_image_that_was_held_back_is_outdated_and_changes_nothing_for_those_after_it() {
    for cycle_us in [500, 1_000, 4_000] {
        let sender = LifeSender::of(cycle_us, 0);
        for age_ms in ages_ms().filter(|age_ms| age_ms * 1_000 < 65_000 * cycle_us) {
            let mut monitor = monitor(cycle_us);
            let first = settled(&mut monitor, &sender);
            let age = age_ms * 1_000 / cycle_us;
            receive_until(&mut monitor, &sender, first, 66_000);
            for count in [66_000, 66_001, 66_009] {
                let now = Instant::from_nanos(sender.sent_at(count));
                assert_eq!(monitor.judge(now, sender.life(count)), Age::New);
                assert_eq!(monitor.judge(now, sender.life(count - age)), Age::Outdated, "{age_ms} ms");
                assert_eq!(monitor.judge(now, sender.life(count - age)), Age::Outdated, "read again");
                assert_eq!(monitor.judge(now, sender.life(count)), Age::Repeated);
            }
            assert_eq!(monitor.outdated(), 3);
        }
    }
}

#[test]
fn an_image_of_65_and_a_half_seconds_is_the_limit_of_a_counter_of_16_bits_at_1_ms() {
    let sender = LifeSender::of(1_000, 0);
    let age = |age: u64| {
        let mut monitor = monitor(1_000);
        let first = settled(&mut monitor, &sender);
        let count = 70_000;
        receive_until(&mut monitor, &sender, first, count);
        monitor.judge(Instant::from_nanos(sender.sent_at(count)), sender.life(count));
        monitor.judge(Instant::from_nanos(sender.sent_at(count)), sender.life(count - age))
    };
    assert_eq!([age(65_530), age(65_533)], [Age::Outdated; 2]);
    assert_eq!([age(65_534), age(65_536)], [Age::New, Age::Repeated]);
}

#[test]
fn images_that_arrive_in_a_burst_after_a_stall_are_not_refused() {
    for stall_ms in [3_u64, 30, 300, 3_000, 9_000] {
        // All at one instant as from a receiver's queue, or at ten times the pace as from a cable's.
        for pace in [0_u64, 1, 5] {
            let sender = LifeSender::of(1_000, 0);
            let mut monitor = monitor(1_000);
            let first = settled(&mut monitor, &sender);
            let end_ns = sender.sent_at(first + stall_ms);
            let mut free_ns = end_ns;
            for count in first..first + 3 * stall_ms + 100 {
                let at_ns = free_ns.max(sender.sent_at(count));
                free_ns = at_ns + pace * 100_000;
                let judged = monitor.judge(Instant::from_nanos(at_ns), sender.life(count));
                assert_eq!(judged, Age::New, "{stall_ms} ms, {pace}");
            }
            assert_eq!(monitor.outdated(), 0);
        }
    }
}

/// An image of a program that runs every 16 ms and counts milliseconds, sent by a bus of 16 ms of its own: each image waits
/// for the bus, and a program that is late once waits less from then on.
#[test]
fn a_program_that_counts_in_steps_may_shift_against_its_bus_at_once() {
    for (before_ms, after_ms) in [(15, 0), (12, 2), (0, 15), (3, 8)] {
        let sender = LifeSender::of(1_000, 0);
        let mut monitor = monitor(1_000);
        for image in 1..200 {
            let wait_ms = if image < 100 { before_ms } else { after_ms };
            let at = Instant::from_nanos(sender.sent_at(16 * image));
            assert_eq!(
                monitor.judge(at, sender.life(16 * image - wait_ms)),
                Age::New,
                "{before_ms}, {after_ms}: {image}"
            );
            if image == 50 {
                monitor.act();
            }
        }
    }
}

#[test]
fn an_hour_with_a_clock_that_is_200_ppm_fast_or_slow_refuses_nothing_and_hides_nothing() {
    for ppm in [-500, -200, 0, 200, 500] {
        for cycle_us in [1_000, 4_000] {
            let sender = LifeSender::of(cycle_us, ppm);
            let mut monitor = monitor(cycle_us);
            settled(&mut monitor, &sender);
            let last = 3_600_000_000 / cycle_us;
            // The receiver reads every fourth image, and each arrives with another delay of up to half a cycle.
            for count in (20..last).step_by(4) {
                let delay_ns = count % 7 * cycle_us * 1_000 / 14;
                let at = Instant::from_nanos(sender.sent_at(count) + delay_ns);
                assert_eq!(monitor.judge(at, sender.life(count)), Age::New, "{ppm} ppm, {count}");
            }
            // 40 ms less than the counter's range: twenty seconds at 500 ppm, and two cycles.
            let (now, age) = (Instant::from_nanos(sender.sent_at(last)), 65_500);
            monitor.judge(now, sender.life(last));
            assert_eq!(monitor.judge(now, sender.life(last - age)), Age::Outdated, "{ppm} ppm");
        }
    }
}

#[test]
fn a_first_image_that_is_late_sets_no_start_for_those_that_are_acted_on() {
    let sender = LifeSender::of(1_000, 0);
    let mut monitor = monitor(1_000);
    let late = Instant::from_nanos(sender.sent_at(80));
    for count in 0..=80 {
        assert_eq!(monitor.judge(late, sender.life(count)), Age::New);
    }
    for count in 81..90 {
        assert_eq!(monitor.judge(Instant::from_nanos(sender.sent_at(count)), sender.life(count)), Age::New);
    }
    monitor.act();
    for count in 90..500 {
        assert_eq!(monitor.judge(Instant::from_nanos(sender.sent_at(count)), sender.life(count)), Age::New);
    }
    let mut monitor = LifeMonitor { is_acted_on: false, ..monitor };
    monitor.restart();
    monitor.judge(late, sender.life(0));
    monitor.judge(late, sender.life(1));
    let on_time = Instant::from_nanos(sender.sent_at(81));
    assert_eq!(monitor.judge(on_time, sender.life(81)), Age::New, "nothing is acted on yet");
    monitor.act();
    assert_eq!(monitor.judge(on_time, sender.life(1)), Age::Outdated);
}

#[test]
fn a_sender_that_counts_slower_than_its_setup_says_is_accepted_and_a_faster_one_is_not() {
    for cycle_us in [1_000, 1_500, 10_000] {
        let sender = LifeSender::of(cycle_us, 0);
        let mut monitor = monitor(1_000);
        settled(&mut monitor, &sender);
        for count in 20..120_000 {
            let at = Instant::from_nanos(sender.sent_at(count));
            assert_eq!(monitor.judge(at, sender.life(count)), Age::New, "{cycle_us} µs");
        }
        let now = Instant::from_nanos(sender.sent_at(119_999));
        assert_eq!(monitor.judge(now, sender.life(119_999 - 2_046_000 / cycle_us)), Age::Outdated);
    }
    let (sender, mut monitor) = (LifeSender::of(250, 0), monitor(1_000));
    settled(&mut monitor, &sender);
    let judged = (24..400)
        .step_by(4)
        .map(|count| monitor.judge(Instant::from_nanos(sender.sent_at(count)), sender.life(count)));
    assert!(judged.last() == Some(Age::Outdated));
}

#[test]
fn a_sender_that_paused_for_longer_than_its_counter_wraps_is_judged_as_strictly_as_before() {
    let sender = LifeSender::of(1_000, 0);
    let mut monitor = monitor(1_000);
    let first = settled(&mut monitor, &sender);
    let later = |count: u64| Instant::from_nanos(sender.sent_at(count) + 100_000_000_000);
    for count in first..first + 100 {
        assert_eq!(monitor.judge(later(count), sender.life(count)), Age::New);
    }
    assert_eq!(monitor.judge(later(first + 99), sender.life(first)), Age::Outdated);
    assert_eq!(monitor.judge(later(first + 99), sender.life(first + 105)), Age::Outdated);
}

#[test]
fn a_counter_that_never_moves_is_named_once_a_connection_and_not_judged() {
    let mut monitor = monitor(1_000);
    let named = |monitor: &mut LifeMonitor, from_ms: u64| {
        (from_ms..from_ms + 5_000)
            .filter(|ms| {
                let at = Instant::from_millis(*ms);
                assert_ne!(monitor.judge(at, 9), Age::Outdated);
                monitor.take_still(at)
            })
            .count()
    };
    assert_eq!(named(&mut monitor, 0), 1);
    monitor.act();
    assert_eq!(monitor.judge(Instant::from_millis(5_001), 40_000), Age::New, "it starts to count");
    assert_eq!(
        monitor.judge(Instant::from_millis(5_002), 40_100),
        Age::Outdated,
        "and is judged from then on"
    );
    monitor.restart();
    assert_eq!(named(&mut monitor, 6_000), 1);
    monitor.restart();
    for ms in 0..3_000 {
        monitor.judge(Instant::from_millis(20_000 + ms), ms as u16);
    }
    assert!(!monitor.take_still(Instant::from_millis(23_000)), "one that counts is not named");
}

#[test]
fn a_new_connection_begins_wherever_the_counter_is() {
    let mut monitor = monitor(1_000);
    for (at_ms, life) in [(0, 7), (1, 8)] {
        assert_eq!(monitor.judge(Instant::from_millis(at_ms), life), Age::New);
    }
    monitor.act();
    assert_eq!(monitor.judge(Instant::from_millis(2), 60_000), Age::Outdated);
    monitor.restart();
    assert_eq!(monitor.judge(Instant::from_millis(3), 60_000), Age::New);
    assert_eq!(monitor.outdated(), 1, "what was counted stays");
}

proptest! {
    #[test]
    fn whatever_the_delays_images_in_order_are_accepted_and_old_ones_are_not(
        delays in proptest::collection::vec((0..200_000_u64, 1..40_u64), 1..200),
        age in 1..65_000_u64,
        ppm in -500..500_i64,
    ) {
        let sender = LifeSender::of(1_000, ppm);
        let mut monitor = monitor(1_000);
        let mut count = settled(&mut monitor, &sender);
        let mut now = 0;
        for (delay_us, step) in delays {
            count += step;
            // None overtakes another one.
            now = (sender.sent_at(count) + delay_us * 1_000).max(now);
            prop_assert_eq!(monitor.judge(Instant::from_nanos(now), sender.life(count)), Age::New);
        }
        // It is refused whether it is one of those that arrived or from before the first one.
        prop_assert_eq!(monitor.judge(Instant::from_nanos(now), sender.life(count).wrapping_sub(age as u16)), Age::Outdated);
    }

    #[test]
    fn no_time_and_no_counter_is_too_large(images in proptest::collection::vec((any::<u64>(), any::<u16>(), any::<bool>()), 1..50)) {
        let mut monitor = LifeMonitor::new(Duration::MAX);
        for (at, life, acts) in images {
            monitor.judge(Instant::from_nanos(at), life);
            monitor.take_still(Instant::from_nanos(at));
            if acts { monitor.act() }
        }
    }
}
