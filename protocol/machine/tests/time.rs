//! Arithmetic of instants, which saturates, and the grid of a cyclic task.

use machine::{Cycle, Duration, Instant, Tick};

const LAST: Instant = Instant::from_nanos(u64::MAX);

#[test]
fn an_instant_counts_nanoseconds_from_the_origin() {
    assert_eq!(Instant::ZERO.as_nanos(), 0);
    assert_eq!(Instant::from_nanos(7).as_nanos(), 7);
    assert_eq!(Instant::from_micros(7).as_nanos(), 7_000);
    assert_eq!(Instant::from_millis(7).as_nanos(), 7_000_000);
}

#[test]
fn a_time_is_added_to_and_taken_from_an_instant() {
    let mut instant = Instant::from_millis(5);
    instant += Duration::from_micros(1_500);
    assert_eq!(instant, Instant::from_micros(6_500));
    assert_eq!(instant + Duration::new(1, 1), Instant::from_nanos(1_006_500_001));
    assert_eq!(instant - Duration::from_millis(2), Instant::from_micros(4_500));
    assert_eq!(instant.since(Instant::from_millis(5)), Duration::from_micros(1_500));
}

#[test]
fn arithmetic_stops_at_the_origin_and_at_the_last_instant() {
    assert_eq!(Instant::from_millis(1) - Duration::from_millis(2), Instant::ZERO);
    assert_eq!(Instant::ZERO.since(Instant::from_millis(1)), Duration::ZERO);
    assert_eq!(Instant::from_millis(1) + Duration::MAX, LAST);
    assert_eq!(Instant::from_millis(u64::MAX), LAST);
    assert_eq!(Instant::from_micros(u64::MAX), LAST);
    assert_eq!(LAST.next_on_grid(Duration::MAX, LAST), (LAST, 0));
}

#[test]
fn the_earlier_deadline_is_the_one_that_is_set() {
    let (early, late) = (Some(Instant::from_millis(3)), Some(Instant::from_millis(4)));
    for (a, b, earlier) in [
        (early, late, early),
        (late, early, early),
        (early, None, early),
        (None, late, late),
        (None, None, None),
    ] {
        assert_eq!(Instant::earlier(a, b), earlier, "{a:?}, {b:?}");
    }
}

#[test]
fn a_grid_point_is_over_when_it_has_come() {
    let (start, period) = (Instant::from_millis(5), Duration::from_millis(1));
    let at = Instant::from_nanos;
    assert_eq!(start.next_on_grid(period, at(5_999_999)), (Instant::from_millis(6), 0));
    assert_eq!(start.next_on_grid(period, at(6_000_000)), (Instant::from_millis(7), 1));
    assert_eq!(start.next_on_grid(Duration::ZERO, at(5_000_003)), (at(5_000_004), 3));
}

#[test]
fn a_task_runs_at_the_instant_at_which_it_is_due() {
    let (due, period) = (Instant::from_millis(4), Duration::from_millis(2));
    let mut cycle = Cycle::new(due, period);
    assert_eq!(cycle.tick(due - Duration::from_nanos(1)), None);
    assert_eq!(cycle.tick(due), Some(Tick { due, lateness: Duration::ZERO, skipped: 0 }));
    assert_eq!((cycle.next(), cycle.period()), (Instant::from_millis(6), period));
    assert_eq!(cycle.tick(due), None);
}
