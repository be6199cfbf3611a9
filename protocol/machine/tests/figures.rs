//! Figures of an endpoint and of a cyclic task: frame counters and the histogram of lateness.

use machine::{Counters, Duration, Instant, Lateness, Tick};

const BEFORE: Counters =
    Counters { sent: 2, received: 3, skipped: 5, lost: 7, late: 11, malformed: 13, foreign: 17 };
const LATER: Counters =
    Counters { sent: 19, received: 23, skipped: 29, lost: 31, late: 37, malformed: 41, foreign: 43 };

fn recorded(nanos: impl IntoIterator<Item = u64>) -> Lateness {
    let mut lateness = Lateness::default();
    for nanos in nanos {
        lateness.record(&Tick { due: Instant::ZERO, lateness: Duration::from_nanos(nanos), skipped: 2 });
    }
    lateness
}

fn buckets(lateness: &Lateness) -> Vec<(u64, u32)> {
    lateness.buckets().map(|(end, runs)| (u64::try_from(end.as_nanos()).unwrap_or(u64::MAX), runs)).collect()
}

#[test]
fn counters_add_field_by_field() {
    assert_eq!(
        BEFORE + LATER,
        Counters { sent: 21, received: 26, skipped: 34, lost: 38, late: 48, malformed: 54, foreign: 60 }
    );
}

#[test]
fn counters_since_an_earlier_state_are_what_came_after_it() {
    assert_eq!(
        LATER.since(&BEFORE),
        Counters { sent: 17, received: 20, skipped: 24, lost: 24, late: 26, malformed: 28, foreign: 26 }
    );
    assert_eq!(BEFORE.since(&LATER), Counters::default());
}

#[test]
fn each_run_and_each_missed_cycle_counts() {
    let lateness = recorded([5, 9, 7]);
    assert_eq!((lateness.runs(), lateness.missed(), lateness.max()), (3, 6, Duration::from_nanos(9)));
}

#[test]
fn below_32_ns_each_lateness_has_a_bucket_of_its_own() {
    let each: Vec<_> = (0..32).map(|nanos| (nanos, 1)).collect();
    assert_eq!(buckets(&recorded(0..32)), each);
}

#[test]
fn above_32_ns_a_bucket_is_a_sixteenth_of_its_power_of_two_and_ends_before_the_next() {
    assert_eq!(
        buckets(&recorded([32, 33, 34, 35, 63, 64, 67, 68])),
        [(33, 2), (35, 2), (63, 1), (67, 2), (71, 1)]
    );
}

#[test]
fn a_lateness_beyond_the_last_bucket_counts_in_it() {
    let lateness = recorded([(1 << 40) + (1 << 39), 1 << 50, u64::MAX]);
    assert_eq!(buckets(&lateness).iter().map(|(_, runs)| runs).sum::<u32>(), 3);
    assert_eq!(lateness.max(), Duration::from_nanos(u64::MAX));
}

#[test]
fn a_quantile_lies_between_the_least_and_the_largest_lateness() {
    let lateness = recorded([5, 6, 7, 1_000]);
    let quantile = |share| lateness.quantile(share).as_nanos();
    assert_eq!([-1.0, 0.0, 0.25, 0.5, 0.75].map(quantile), [5, 5, 5, 6, 7]);
    assert_eq!([0.76, 1.0, 2.0].map(quantile), [1_000; 3]);
    assert_eq!(Lateness::default().quantile(0.5), Duration::ZERO);
}
