use super::*;

const MS: u64 = 1_000_000;

fn at(ns: u64) -> Instant {
    Instant::from_nanos(ns)
}

/// A clock that is as exact as its local clock, with the registers after power-on.
fn clock(start_ns: u64, error_ppb: i64) -> (Clock, Memory) {
    let mut memory = Memory::new(0);
    memory.reset();
    (Clock::new(Instant::ZERO, LocalClock { start_ns, error_ppb }), memory)
}

/// Compares the clock with a system time from which its own differs by so much.
fn compare(clock: &mut Clock, memory: &mut Memory, now: Instant, ahead: i32) {
    let local = clock.system(now, memory) as u32;
    clock.compare(now, local.wrapping_sub(ahead as u32), memory);
}

#[test]
fn a_clock_with_a_positive_error_runs_too_fast() {
    for (error_ppb, after_a_second) in [(0, 1_000_000_000), (500, 1_000_000_500), (-500, 999_999_500)] {
        assert_eq!(clock(7, error_ppb).0.local(at(1_000 * MS)), 7 + after_a_second, "{error_ppb}");
    }
}

#[test]
fn the_difference_that_is_shown_is_filtered_by_the_depth_in_its_register() {
    let (mut clock, mut memory) = clock(0, 0);
    let mut shown = |depth: u8, ahead| {
        memory.set(0x0934, &[depth]);
        compare(&mut clock, &mut memory, at(5 * MS), ahead);
        memory.u32(SYSTEM_TIME_DIFFERENCE)
    };
    // 1600 / 16; then a sixteenth of what is left; then half of it; then all of it.
    assert_eq!(shown(4, 1600), 0x8000_0000 + 100);
    assert_eq!(shown(4, 1600), 0x8000_0000 + 193);
    assert_eq!(shown(1, 1593), 0x8000_0000 + 893);
    assert_eq!(shown(0, -20), 20, "behind");
}

#[test]
fn a_difference_is_taken_back_by_a_sixteenth_at_each_comparison() {
    for (ahead, gained) in [(1_000, -63_476), (-1_000, 63_476)] {
        let (mut clock, mut memory) = clock(0, 0);
        compare(&mut clock, &mut memory, at(MS), 0);
        compare(&mut clock, &mut memory, at(2 * MS), ahead);
        // Of 1000 ns in 1 ms: 62.5 ns in each further 1 ms, and 976 ppb for good.
        assert_eq!(clock.local(at(1_002 * MS)) as i64, 1_002 * MS as i64 + gained);
    }
}

#[test]
fn two_comparisons_at_one_time_correct_nothing() {
    let (mut clock, mut memory) = clock(0, 0);
    compare(&mut clock, &mut memory, at(MS), 1_000);
    compare(&mut clock, &mut memory, at(MS), 1_000);
    assert_eq!(clock.local(at(1_001 * MS)), 1_001 * MS);
}

#[test]
fn a_clock_far_off_is_corrected_by_the_most_that_a_chip_can_and_learns_nothing_from_that() {
    // The second difference asks for just that limit.
    for (bandwidth, ahead) in [(0x1000_u16, 1_000_000), (0x0100, 781)] {
        for ahead in [ahead, -ahead] {
            let (mut clock, mut memory) = clock(0, 0);
            memory.set(SPEED_COUNTER_START, &bandwidth.to_le_bytes());
            compare(&mut clock, &mut memory, at(MS), 0);
            let elapsed = if bandwidth == 0x0100 { 999_680 } else { MS };
            compare(&mut clock, &mut memory, at(MS + elapsed), ahead);
            let start = clock.local(at(2 * MS)) as i64;
            let gained = clock.local(at(1_002 * MS)) as i64 - start - 1_000 * MS as i64;
            assert_eq!(gained, -i64::from(ahead.signum()) * MAX_CORRECTION_PPB, "{ahead}");
            compare(&mut clock, &mut memory, at(1_002 * MS), 0);
            let start = clock.local(at(1_002 * MS));
            assert_eq!(clock.local(at(2_002 * MS)) - start, 1_000 * MS, "{ahead}");
        }
    }
}

#[test]
fn what_a_clock_has_learned_shows_in_ticks_of_its_speed_counter() {
    for (ahead, shown) in [(10_000, -3_i16), (-10_000, 3)] {
        let (mut clock, mut memory) = clock(0, 0);
        for number in 1..200 {
            compare(&mut clock, &mut memory, at(number * MS), ahead);
        }
        // 0.781 per mille of 4096 ticks.
        assert_eq!(memory.u16(SPEED_COUNTER_DIFFERENCE) as i16, shown);
    }
}

#[test]
fn half_of_all_times_are_ahead_of_another_and_half_behind() {
    for (time, system, ahead) in [
        (1, 0, true),
        (0, 0, false),
        (0, 1, false),
        (u64::MAX / 2, 0, true),
        (u64::MAX / 2 + 1, 0, false),
        (3, u64::MAX, true),
    ] {
        assert_eq!(is_ahead(time, system), ahead, "{time} from {system}");
    }
}

/// Starts SYNC signals at a system time.
fn start(clock: &mut Clock, memory: &mut Memory, activation: u8, start: u64, cycle: u32) {
    memory.set(SYNC_START, &start.to_le_bytes());
    memory.set(SYNC0_CYCLE, &cycle.to_le_bytes());
    memory.set(SYNC_ACTIVATION, &[activation]);
    clock.activate(Instant::ZERO, memory);
}

#[test]
fn a_signal_is_due_when_the_system_time_reaches_its_start() {
    for (start_ns, due) in [(0, 50_000), (1_000, 49_000)] {
        let (mut clock, mut memory) = clock(start_ns, 0);
        start(&mut clock, &mut memory, 0x03, 50_000, 10_000);
        assert_eq!(clock.deadline(&memory), Some(at(due)));
        assert_eq!(clock.pulse(at(due - 1), &memory), None);
        assert_eq!(clock.pulse(at(due), &memory), Some((Sync::Sync0, 50_000)));
        assert_eq!(clock.deadline(&memory), Some(at(due + 10_000)));
    }
}

#[test]
fn a_cycle_no_longer_than_a_pulse_makes_no_signal() {
    for (cycle, makes) in [(50_000, false), (50_001, true), (0, true)] {
        let (mut clock, mut memory) = clock(0, 0);
        memory.set(PULSE_LENGTH, &5_000_u16.to_le_bytes()); // of 10 ns
        start(&mut clock, &mut memory, 0x03, 100_000, cycle);
        assert_eq!(clock.makes_pulses(), makes, "{cycle}");
    }
}

#[test]
fn a_clock_makes_signals_while_one_that_is_switched_on_has_pulses_left() {
    for (activation, start_at, makes) in [
        (0x03, 100_000, true),
        (0x05, 100_000, true),
        (0x07, 100_000, true),
        (0x01, 100_000, false),
        (0x06, 100_000, false),
        (0x05, 0, false),
        (0x07, 0, false),
    ] {
        let (mut clock, mut memory) = clock(1, 0);
        start(&mut clock, &mut memory, activation, start_at, 10_000);
        assert_eq!(clock.makes_pulses(), makes, "{activation:#04x} from {start_at}");
    }
}
