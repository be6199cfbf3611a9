//! A search for devices, by its rule: requests at 0, T/4 and T/2, the end at T, one entry for each device.

use machine::search::{Answers, Due, MOST_DEVICES, Schedule, SearchCounters, SearchEnded};
use machine::{Duration, Instant};

const LENGTH: Duration = Duration::from_millis(400);

/// A search that starts at one second.
fn schedule() -> Schedule {
    Schedule::new(at(0), LENGTH)
}

/// Returns the instant `millis` after the search's start.
fn at(millis: u64) -> Instant {
    Instant::from_millis(1_000 + millis)
}

#[test]
fn a_search_asks_three_times_and_then_waits_for_its_end() {
    let mut search = schedule();
    let mut seen = Vec::new();
    while let Some(due) = search.poll_timeout() {
        seen.push((due, search.handle_timeout(due), search.has_ended(), search.poll_event()));
        assert!(seen.len() < 10, "{seen:?}");
    }
    assert_eq!(
        seen,
        [
            (at(0), Due::Request, false, None),
            (at(100), Due::Request, false, None),
            (at(200), Due::Request, false, None),
            (at(400), Due::Nothing, true, Some(SearchEnded)),
        ]
    );
}

#[test]
fn nothing_is_due_before_its_time() {
    let mut search = schedule();
    assert_eq!(search.handle_timeout(at(0)), Due::Request);
    assert_eq!(search.handle_timeout(at(99)), Due::Nothing);
    assert_eq!(search.handle_timeout(at(200)), Due::Request);
    // Between the last request and the end, no fourth one.
    for millis in [201, 300, 399] {
        assert_eq!(search.handle_timeout(at(millis)), Due::Nothing);
        assert!(!search.has_ended());
        assert_eq!(search.poll_timeout(), Some(at(400)));
    }
}

#[test]
fn a_driver_that_was_late_for_several_requests_sends_one() {
    let mut search = schedule();
    assert_eq!(search.handle_timeout(at(150)), Due::Request);
    assert_eq!(search.handle_timeout(at(151)), Due::Nothing);
    assert_eq!(search.poll_timeout(), Some(at(200)));
}

#[test]
fn the_end_is_reported_once_and_nothing_follows_it() {
    let mut search = schedule();
    assert_eq!(search.handle_timeout(at(1_000)), Due::Nothing);
    assert_eq!((search.poll_event(), search.poll_event()), (Some(SearchEnded), None));
    assert_eq!(search.handle_timeout(at(1_001)), Due::Nothing);
    assert_eq!((search.poll_event(), search.poll_timeout()), (None, None));
}

#[test]
fn devices_spread_their_answers_over_a_quarter_of_the_search() {
    assert_eq!(schedule().spread(), Duration::from_millis(100));
}

#[test]
fn a_device_that_answers_again_keeps_its_place_with_its_newer_answer() {
    let mut answers = Answers::default();
    for answer in [(1, "old"), (2, "other"), (1, "new"), (1, "newer")] {
        answers.keep(answer, |a, b| a.0 == b.0);
    }
    answers.ignore();
    answers.ignore();
    answers.ignore();
    assert_eq!(answers.devices(), [(1, "newer"), (2, "other")]);
    assert_eq!(answers.counters(), SearchCounters { repeated: 2, ignored: 3, surplus: 0 });
}

#[test]
fn devices_beyond_the_limit_are_counted_and_those_known_may_still_answer() {
    let mut answers = Answers::default();
    for device in 0..MOST_DEVICES + 2 {
        answers.keep(device, |a, b| a == b);
    }
    answers.keep(0, |a, b| a == b);
    assert_eq!(answers.devices().len(), MOST_DEVICES);
    assert_eq!(answers.devices().last(), Some(&(MOST_DEVICES - 1)));
    assert_eq!(answers.counters(), SearchCounters { repeated: 1, ignored: 0, surplus: 2 });
}
