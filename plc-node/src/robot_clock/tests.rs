use super::*;
use proptest::prelude::*;

/// A robot that stamps in its cycle of 4 ms and sends every millisecond, and a PLC that sees its frames.
#[derive(Clone, Copy, Debug)]
struct Plant {
    drift_ppm: f64,
    /// Robot's clock at the PLC's origin.
    clock_ns: u64,
    /// Where in the PLC's millisecond the robot begins its cycle.
    phase_ns: u64,
    /// From the stamp to the arrival of the frame, without jitter.
    delay_ns: u64,
    jitter_ns: u64,
    loss: f64,
    sees: Sees,
    seed: u64,
}

/// What tells the PLC the time.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Sees {
    Frames,
    /// Scans every millisecond, and how late they are at most.
    Scans {
        lateness_ns: u64,
    },
}

const SCAN_NS: u64 = 1_000_000;
const CYCLE_NS: u64 = 4_000_000;
const PLANT: Plant = Plant {
    drift_ppm: 30.0,
    clock_ns: 5_000_000_000,
    phase_ns: 0,
    delay_ns: 150_000,
    jitter_ns: 100_000,
    loss: 0.0,
    sees: Sees::Frames,
    seed: 1,
};

/// A random stream (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut word = self.0;
        word = (word ^ (word >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        word = (word ^ (word >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        word ^ (word >> 31)
    }

    fn below(&mut self, most: u64) -> u64 {
        if most == 0 { 0 } else { self.next() % most }
    }
}

impl Plant {
    fn delay(&self) -> StampDelay {
        let spread = if self.sees == Sees::Frames { 0 } else { SCAN_NS };
        StampDelay { least: Duration::from_nanos(self.delay_ns), spread: Duration::from_nanos(spread) }
    }

    fn estimator(&self) -> RobotClock {
        RobotClock::new(self.delay())
    }

    /// Robot's clock at an instant of the PLC.
    fn clock_at(&self, plc_ns: u64) -> u64 {
        (self.clock_ns + plc_ns).saturating_add_signed((plc_ns as f64 * self.drift_ppm * 1e-6) as i64)
    }

    /// PLC's instant of a stamp.
    fn seen(&self, stamp: u64) -> u64 {
        ((stamp - self.clock_ns) as f64 / (1.0 + self.drift_ppm * 1e-6)) as u64
    }

    /// Feeds the images of these seconds of the PLC's clock, and calls `each` after every one.
    fn feed(&self, clock: &mut RobotClock, seconds: [f64; 2], mut each: impl FnMut(&RobotClock, u64)) {
        let mut random = Random(self.seed);
        let [from, to] = seconds.map(|seconds| (seconds * 1e9) as u64);
        let first = self.clock_at(from + self.phase_ns).next_multiple_of(CYCLE_NS) + self.phase_ns;
        for cycle in 0.. {
            let stamp = first + cycle * CYCLE_NS;
            // The robot repeats the image every millisecond: one that is lost comes a millisecond later.
            let mut sent = self.seen(stamp);
            while (random.next() as f64) < self.loss * u64::MAX as f64 {
                sent += SCAN_NS;
            }
            let came = sent + self.delay_ns + random.below(self.jitter_ns + 1);
            let seen = match self.sees {
                Sees::Frames => came,
                Sees::Scans { lateness_ns } => {
                    let scan = came.next_multiple_of(SCAN_NS);
                    scan + random.below(lateness_ns + 1)
                }
            };
            if seen > to {
                return;
            }
            clock.observe(Instant::from_nanos(seen), stamp);
            each(clock, seen);
        }
    }

    /// Error of an estimate at an instant of the PLC, in ns, and the uncertainty that goes with it.
    fn error(&self, clock: &RobotClock, plc_ns: u64) -> (i64, u64) {
        let estimate = clock.robot_time(Instant::from_nanos(plc_ns)).expect("an estimate");
        ((estimate.at_ns as i64) - self.clock_at(plc_ns) as i64, estimate.uncertainty_ns)
    }

    /// Largest error between two times, in ns. No error is larger than the uncertainty.
    fn largest_error(&self, from: f64, to: f64) -> u64 {
        let (mut clock, mut largest) = (self.estimator(), 0);
        self.feed(&mut clock, [0.0, to], |clock, seen| {
            if seen as f64 >= from * 1e9 {
                let (error, uncertainty) = self.error(clock, seen);
                assert!(
                    error.unsigned_abs() <= uncertainty + 1_000,
                    "{error} ns, ± {uncertainty} ns at {seen} ns of {self:?}"
                );
                largest = largest.max(error.unsigned_abs());
            }
        });
        largest
    }
}

fn plants() -> impl Strategy<Value = Plant> {
    let sees =
        prop_oneof![Just(Sees::Frames), (0..100_000_u64).prop_map(|lateness_ns| Sees::Scans { lateness_ns })];
    let numbers = (-100.0..100.0_f64, 0..u64::MAX / 4, 0..CYCLE_NS, 0..2_000_000_u64);
    (numbers, 0..100_000_u64, prop_oneof![Just(0.0), 0.0..0.3_f64], sees, any::<u64>()).prop_map(
        |((drift_ppm, clock_ns, phase_ns, delay_ns), jitter_ns, loss, sees, seed)| Plant {
            drift_ppm,
            clock_ns,
            phase_ns,
            delay_ns,
            jitter_ns,
            loss,
            sees,
            seed,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_clock_is_known_to_a_millisecond_from_the_first_second_whatever_it_is(plant in plants()) {
        prop_assert!(plant.largest_error(1.0, 8.0) <= 1_000_000);
    }

    #[test]
    fn stamps_of_frames_give_the_clock_to_20_us_after_40_s(plant in plants()) {
        let plant = Plant { sees: Sees::Frames, ..plant };
        let largest = plant.largest_error(40.0, 50.0);
        prop_assert!(largest <= 20_000, "{largest} ns");
    }

    #[test]
    fn scans_give_the_clock_to_150_us_once_a_millisecond_of_drift_has_passed_twice(
        plant in plants(),
        drift_ppm in prop_oneof![30.0..100.0_f64, -100.0..-30.0_f64],
    ) {
        let plant = Plant { drift_ppm, sees: Sees::Scans { lateness_ns: 0 }, ..plant };
        let passes_s = 1e3 / drift_ppm.abs();
        let largest = plant.largest_error(2.2 * passes_s + 2.0, 2.2 * passes_s + 12.0);
        prop_assert!(largest <= 150_000, "{largest} ns");
    }

    #[test]
    fn no_stamp_and_no_time_panics(images in prop::collection::vec((any::<u64>(), any::<u64>()), 1..300)) {
        let mut clock = PLANT.estimator();
        for (seen, stamp) in images {
            clock.observe(Instant::from_nanos(seen), stamp);
            let _ = clock.robot_time(Instant::from_nanos(stamp));
        }
        prop_assert!(clock.windows.len() <= WINDOWS);
    }
}

/// Returns an estimator that has seen this plant for a time.
fn seen(plant: &Plant, seconds: f64) -> RobotClock {
    let mut clock = plant.estimator();
    plant.feed(&mut clock, [0.0, seconds], |_, _| {});
    clock
}

#[test]
fn a_fixed_delay_moves_the_estimate_by_as_much() {
    // The network takes 400 µs more than the estimator was given: the robot's clock seems to be that much slower.
    for (delay_ns, least_ns, error_ns) in
        [(150_000, 150_000, 0), (550_000, 150_000, -400_000), (150_000, 550_000, 400_000)]
    {
        let plant = Plant { delay_ns, ..PLANT };
        let least = Duration::from_nanos(least_ns);
        let mut clock = RobotClock::new(StampDelay { least, ..plant.delay() });
        plant.feed(&mut clock, [0.0, 45.0], |_, _| {});
        let (error, _) = plant.error(&clock, 45_000_000_000);
        assert!((error - error_ns).abs() < 20_000, "{error} ns for {error_ns} ns");
    }
}

#[test]
fn an_estimate_for_an_instant_ahead_says_how_much_less_is_known_about_it() {
    let clock = seen(&PLANT, 45.0);
    let [now, ahead] = [45_000_000_000, 55_000_000_000].map(|plc_ns| PLANT.error(&clock, plc_ns));
    assert!(ahead.0.unsigned_abs() <= ahead.1 && ahead.1 < 30_000, "{ahead:?}");
    assert!(ahead.1 > now.1, "{now:?}, {ahead:?}");
}

#[test]
fn a_robot_that_restarts_is_known_anew_within_a_second() {
    let mut clock = seen(&PLANT, 45.0);
    let restarted = Plant { clock_ns: 0, phase_ns: 700_000, ..PLANT };
    restarted.feed(&mut clock, [46.0, 47.0], |_, _| {});
    let (error, uncertainty) = restarted.error(&clock, 47_000_000_000);
    assert!(error.unsigned_abs() <= uncertainty && uncertainty < 300_000, "{error} ± {uncertainty} ns");
}

#[test]
fn a_clock_that_is_set_back_or_ahead_a_little_is_known_anew_after_some_seconds() {
    for set_by in [-15_000_000_i64, -400_000, 400_000, 15_000_000] {
        let mut clock = seen(&PLANT, 45.0);
        let set = Plant { clock_ns: PLANT.clock_ns.saturating_add_signed(set_by), ..PLANT };
        set.feed(&mut clock, [45.0, 52.0], |_, _| {});
        let (error, _) = set.error(&clock, 52_000_000_000);
        assert!(error.abs() < 300_000, "set by {set_by} ns: {error} ns");
    }
}

#[test]
fn images_that_are_late_or_come_twice_and_late_scans_move_nothing() {
    let mut clock = PLANT.estimator();
    let mut random = Random(7);
    let mut stamps = 0;
    let mut images = Vec::new();
    PLANT.feed(&mut RobotClock::new(PLANT.delay()), [0.0, 45.0], |clock, seen| {
        images.push((seen, clock.last_stamp.unwrap_or_default()));
    });
    let mut stalled_until = 0;
    for (index, (seen, stamp)) in images.iter().enumerate() {
        // Every two seconds the PLC stalls for 300 ms, and then sees the last image.
        if index % 500 == 499 {
            stalled_until = seen + 300_000_000;
        }
        if *seen < stalled_until {
            continue;
        }
        clock.observe(Instant::from_nanos(*seen), *stamp);
        if random.below(5) == 0 {
            // The same once more, and one that a switch held back.
            clock.observe(Instant::from_nanos(seen + 500_000), *stamp);
            let (_, held) = images[index.saturating_sub(random.below(400) as usize)];
            clock.observe(Instant::from_nanos(seen + 600_000), held);
        }
        stamps += 1;
    }
    assert!(stamps > 8_000, "{stamps}");
    let (error, uncertainty) = PLANT.error(&clock, 45_000_000_000);
    assert!(error.unsigned_abs() <= 20_000 && uncertainty <= 25_000, "{error} ± {uncertainty} ns");
}

#[test]
fn seconds_of_nothing_but_late_images_are_left_out_and_a_slower_network_is_learnt() {
    let mut clock = seen(&PLANT, 45.0);
    let slow = Plant { delay_ns: 2_000_000, ..PLANT };
    slow.feed(&mut clock, [45.0, 46.9], |_, _| {});
    let (error, _) = PLANT.error(&clock, 47_000_000_000);
    assert!(error.abs() <= 20_000, "{error} ns");
    slow.feed(&mut clock, [46.9, 60.0], |_, _| {});
    // Only the setup can tell that the delay is another one.
    let (error, _) = PLANT.error(&clock, 60_000_000_000);
    assert!((error + 1_850_000).abs() < 60_000, "{error} ns");
}

#[test]
fn hours_need_no_more_memory() {
    let mut clock = PLANT.estimator();
    let rooms = clock.windows.capacity();
    PLANT.feed(&mut clock, [0.0, 1_000.0], |_, _| {});
    assert_eq!((clock.windows.len(), clock.windows.capacity()), (WINDOWS, rooms));
}

#[test]
fn two_robots_get_start_times_for_one_instant() {
    let other = Plant { drift_ppm: -70.0, clock_ns: 9_000, phase_ns: 3_300_000, seed: 3, ..PLANT };
    let plants = [PLANT, other];
    let clocks = plants.map(|plant| seen(&plant, 45.0));
    let at = 45_200_000_000;
    let mut start_times = [0; 2];
    let skew = start_together(Instant::from_nanos(at), &clocks, &mut start_times).expect("both are known");
    assert!(skew <= Duration::from_micros(50), "{skew:?}");
    let instants = [0, 1].map(|robot| plants[robot].seen(start_times[robot]) as i64);
    let found = (instants[0] - instants[1]).unsigned_abs();
    assert!(found <= skew.as_nanos() as u64, "{found} ns, at most {skew:?}");
    // Both near the instant, not only near each other.
    instants.iter().for_each(|instant| assert!((instant - at as i64).abs() <= 20_000, "{instants:?}"));
}

#[test]
fn robots_start_together_only_when_every_clock_is_known() {
    let (known, unknown) = (seen(&PLANT, 2.0), PLANT.estimator());
    let at = Instant::from_millis(2_500);
    assert_eq!(start_together(at, [&known, &unknown], &mut [0; 2]), None);
    assert_eq!(start_together(at, [&known, &known], &mut [0; 1]), None, "a time for each robot");
    assert!(start_together(at, [&known, &known], &mut [0; 2]).is_some());
}
