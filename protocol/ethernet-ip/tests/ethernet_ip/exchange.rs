//! What scanner and adapter do together.
//!
//! In one file, because all of its short tests begin with the same set-up of a pair.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::rc::Rc;

use crate::samples::{CONSUMED, DEVICE, PRODUCED};
use crate::single_connection::{SCANNER, SingleConnection};
use ethernet_ip::connection::TimeoutMultiplier;
use ethernet_ip::description::{Assembly, Description, Role};
use ethernet_ip::{Adapter, AdapterConfig, ConnectionConfig, ENCAPSULATION_PORT, IO_PORT, ScannerConfig};
use machine::{Down, DownCause, LinkEvent};
use machine::{Duration, Instant, Machine, Port, StreamChange, StreamId};
use virtual_time::{Carrier, Clock, Event, Impairment, PairConfig, Side};

use crate::cell::{Bus, News, PLC, ROBOT, adapter, adapter_config, bus_of, cable, data, run, up, wanted};

fn cause(news: &News) -> (Side, Option<DownCause>) {
    let down = |event: &LinkEvent| match event {
        LinkEvent::Down(Down { cause, .. }) => Some(*cause),
        _ => None,
    };
    match news {
        Event::A(event) => (Side::A, down(event)),
        Event::B(event) => (Side::B, down(event)),
    }
}

fn causes(events: &[(u64, News)]) -> Vec<(u64, Side, Option<DownCause>)> {
    events.iter().map(|(at, news)| (*at, cause(news).0, cause(news).1)).collect()
}

/// Cyclic frames as they leave: when, by whom, and the bytes.
type Frames = Rc<RefCell<Vec<(Instant, Side, Vec<u8>)>>>;

fn tap_frames(bus: &mut Bus) -> Frames {
    let frames = Frames::default();
    let tapped = Rc::clone(&frames);
    bus.set_tap(move |tap| {
        let is_io = matches!(tap.carrier, Carrier::Udp { source, .. } if source.port() == IO_PORT);
        if is_io && tap.end == tap.from {
            tapped.borrow_mut().push((tap.at, tap.from, tap.frame.to_vec()));
        }
    });
    frames
}

#[test]
fn data_go_both_ways_within_10_ms_of_the_start() {
    let mut bus = bus_of(wanted(), cable(), 1);
    bus.command_a(|scanner, _| scanner.set_output(&data(1)));
    bus.command_b(|adapter, _| adapter.set_produced(PRODUCED, &data(7)).unwrap());
    let events = run(&mut bus, 50);
    assert!(events.len() == 2 && events.iter().all(|(at, _)| *at < 10), "{events:?}");
    assert_eq!((bus.b().consumed(CONSUMED), bus.a().input()), (Some(&data(1)[..]), Some(&data(7)[..])));
    bus.command_a(|scanner, _| scanner.set_output(&data(2)));
    bus.command_b(|adapter, _| adapter.set_produced(PRODUCED, &data(8)).unwrap());
    run(&mut bus, 2);
    assert_eq!((bus.b().consumed(CONSUMED), bus.a().input()), (Some(&data(2)[..]), Some(&data(8)[..])));
}

#[test]
fn frames_have_280_and_276_bytes_and_leave_on_the_senders_grid_without_drift() {
    let mut bus = up(wanted());
    let frames = tap_frames(&mut bus);
    run(&mut bus, 20_000);
    let of = |side| {
        let frames = frames.borrow();
        let frames = frames.iter().filter(|(_, from, _)| *from == side);
        frames.map(|(at, _, frame)| (*at, frame.clone())).collect::<Vec<_>>()
    };
    let (o_t, t_o) = (of(Side::A), of(Side::B));
    assert!(o_t.iter().all(|(_, frame)| frame.len() == 280));
    assert!(t_o.iter().all(|(_, frame)| frame.len() == 276));
    let first = o_t[0].0;
    for (index, (at, frame)) in o_t.iter().enumerate() {
        assert_eq!(*at, first + Duration::from_millis(index as u64));
        let sequence = u32::from_le_bytes(frame[10..14].try_into().unwrap());
        let first = u32::from_le_bytes(o_t[0].1[10..14].try_into().unwrap());
        assert_eq!(sequence, first + index as u32);
    }
    // The adapter's clock gains 30 ppm: 20 s hold half a frame more, and so 20 000 or 20 001.
    assert!((20_000..=20_001).contains(&t_o.len()), "{}", t_o.len());
}

#[test]
fn no_frame_is_lost_or_late_on_a_cable_that_loses_none() {
    let mut bus = up(wanted());
    run(&mut bus, 5_000);
    for counters in [bus.a().counters(), bus.b().counters()] {
        assert!(counters.received > 5_000 && counters.sent > 5_000, "{counters:?}");
        assert_eq!(counters.lost + counters.late + counters.malformed + counters.foreign, 0, "{counters:?}");
    }
}

#[test]
fn a_disconnect_closes_the_connection_and_the_session_in_order() {
    let mut bus = up(wanted());
    let at = bus.now().as_nanos() / 1_000_000;
    bus.command_a(|scanner, now| scanner.disconnect(now));
    assert_eq!(bus.a().input(), None);
    let events = run(&mut bus, 100);
    let expected = [(at, Side::B, Some(DownCause::ClosedByPeer)), (at, Side::A, Some(DownCause::ClosedHere))];
    assert_eq!(causes(&events), expected);
    assert_eq!((bus.b().connections(), bus.b().sessions()), ((0, 0), 0));
    assert_eq!(run(&mut bus, 10_000), [], "nobody begins anew");
    assert_eq!(bus.a().poll_timeout(), None);
}

#[test]
fn an_adapter_that_disconnects_is_missed_by_its_watchdog_and_refuses_new_connections() {
    let mut bus = up(wanted());
    bus.command_b(|adapter, now| adapter.disconnect(now));
    let events = run(&mut bus, 3_000);
    let causes: Vec<_> = events.iter().map(|(_, news)| cause(news)).collect();
    let expected =
        [(Side::B, DownCause::ClosedHere), (Side::A, DownCause::Watchdog), (Side::A, DownCause::Refused)];
    assert_eq!(causes, expected.map(|(side, cause)| (side, Some(cause))));
    assert!(bus.a().connection().refusal().unwrap().to_string().contains("not configured for connections"));
}

#[test]
fn a_cut_cable_is_noticed_after_the_timeout_and_the_connection_comes_back() {
    let mut bus = up(wanted());
    let at = bus.now().as_nanos() / 1_000_000;
    bus.set_cut(true);
    let events = run(&mut bus, 10_000);
    assert_eq!(events.len(), 3, "{events:?}");
    for (event, side) in causes(&events).iter().zip([Side::A, Side::B]) {
        let missed = event.0 - at;
        assert!((127..=128).contains(&missed) && event.2 == Some(DownCause::Watchdog), "{side:?} {event:?}");
    }
    assert_eq!(cause(&events[2].1), (Side::A, Some(DownCause::NoAnswer)), "told once, not at every attempt");
    assert_eq!((bus.a().input(), bus.b().consumed(CONSUMED)), (None, None));
    bus.set_cut(false);
    let events = run(&mut bus, 2_500);
    assert_eq!(events.iter().filter(|(_, news)| cause(news).1.is_none()).count(), 2, "{events:?}");
    assert!(bus.a().input().is_some() && bus.b().consumed(CONSUMED).is_some());
}

#[test]
fn an_adapter_that_restarts_is_found_again() {
    let mut bus = up(wanted());
    bus.command_b(|robot, _| *robot = adapter());
    let events = run(&mut bus, 3_000);
    assert_eq!(cause(&events[0].1), (Side::A, Some(DownCause::Watchdog)));
    assert!(bus.a().input().is_some() && bus.b().consumed(CONSUMED).is_some(), "{events:?}");
}

#[test]
fn an_adapter_that_starts_late_is_waited_for() {
    let mut bus = bus_of(wanted(), cable(), 1);
    bus.set_address(Side::B, None);
    let events = run(&mut bus, 5_000);
    assert_eq!(
        events.iter().map(|(_, news)| cause(news)).collect::<Vec<_>>(),
        [(Side::A, Some(DownCause::NoAnswer))]
    );
    bus.set_address(Side::B, Some(ROBOT));
    run(&mut bus, 2_500);
    assert!(bus.a().input().is_some() && bus.b().consumed(CONSUMED).is_some());
}

#[test]
fn after_the_owner_died_another_scanner_waits_for_its_timeout_and_takes_over() {
    let mut bus = up(wanted());
    let died = bus.now();
    let retry_after = Duration::from_millis(20);
    let heir = ScannerConfig { serial_number: 2, first_id: 0x7700_0000, ..SCANNER };
    let config = ConnectionConfig { retry_after, ..wanted() };
    bus.command_a(|scanner, now| *scanner = SingleConnection::of(heir, config, now));
    let events = run(&mut bus, 400);
    let refusal = Some(DownCause::Refused);
    let told: Vec<_> = events.iter().map(|(_, news)| cause(news)).collect();
    assert_eq!(told[0], (Side::A, refusal));
    let timeout = told.iter().position(|news| *news == (Side::B, Some(DownCause::Watchdog))).unwrap();
    let after = events[timeout].0 - died.as_nanos() / 1_000_000;
    assert!((127..=128).contains(&after), "the owner's timeout is 128 × 1 ms, this was {after} ms");
    assert_eq!(told.iter().filter(|news| news.1.is_none()).count(), 2, "{events:?}");
    assert!(bus.a().input().is_some() && bus.b().consumed(CONSUMED).is_some());
}

#[test]
fn both_sides_give_up_after_exactly_the_intervals_of_each_multiplier() {
    let mut table = String::new();
    for code in 0..=7 {
        let multiplier = TimeoutMultiplier::new(code).unwrap();
        let mut bus = up(ConnectionConfig { multiplier, ..wanted() });
        bus.set_cut(true);
        let at = bus.now();
        let mut gone = [None; 2];
        while gone.contains(&None) {
            let event = bus.next_event(at + Duration::from_secs(2)).unwrap();
            let (side, cause) = cause(&event);
            assert_eq!(cause, Some(DownCause::Watchdog));
            gone[usize::from(side == Side::B)] = Some(bus.now().since(at).as_micros());
        }
        let [scanner, adapter] = gone.map(Option::unwrap);
        let _ = writeln!(table, "code {code}: scanner after {scanner:>6} µs, adapter after {adapter:>6} µs");
    }
    insta::assert_snapshot!(table, @r"
    code 0: scanner after   3673 µs, adapter after   3199 µs
    code 1: scanner after   7673 µs, adapter after   7199 µs
    code 2: scanner after  15673 µs, adapter after  15199 µs
    code 3: scanner after  31673 µs, adapter after  31199 µs
    code 4: scanner after  63673 µs, adapter after  63198 µs
    code 5: scanner after 127673 µs, adapter after 127196 µs
    code 6: scanner after 255673 µs, adapter after 255192 µs
    code 7: scanner after 511673 µs, adapter after 511184 µs
    ");
}

#[test]
fn an_idle_plc_takes_its_outputs_back_and_a_running_one_gives_them_again() {
    let mut bus = up(wanted());
    bus.command_a(|scanner, _| scanner.connection_mut().set_run(false));
    let events = run(&mut bus, 10);
    assert_eq!(cause(&events[0].1), (Side::B, Some(DownCause::PeerIdle)));
    assert_eq!(bus.b().consumed(CONSUMED), None);
    bus.command_a(|scanner, _| scanner.connection_mut().set_run(true));
    let events = run(&mut bus, 10);
    assert_eq!(cause(&events[0].1), (Side::B, None));
    assert!(bus.b().consumed(CONSUMED).is_some());
}

#[test]
fn a_session_lasts_longer_than_the_inactivity_timeout_and_still_closes_in_order() {
    let mut bus = up(wanted());
    assert_eq!(run(&mut bus, 300_000), []);
    bus.command_a(|scanner, now| scanner.disconnect(now));
    assert_eq!(run(&mut bus, 10).len(), 2);
}

#[test]
fn the_stream_may_be_cut_into_any_pieces() {
    for seed in 0..40 {
        let mut bus = bus_of(wanted(), cable(), seed);
        run(&mut bus, 50);
        assert!(bus.a().input().is_some() && bus.b().consumed(CONSUMED).is_some(), "seed {seed}");
    }
}

#[test]
fn the_same_seed_gives_the_same_run() {
    let run_once = || {
        let link = Impairment { loss_ppm: 30_000, jitter: Duration::from_micros(300), ..cable() };
        let mut bus = bus_of(wanted(), link, 9);
        (run(&mut bus, 5_000), bus.a().counters(), bus.b().counters())
    };
    assert_eq!(run_once(), run_once());
}

/// Ten seconds under loss and jitter, 8 and 128 intervals of patience.
#[test]
fn loss_and_jitter_cost_frames_and_only_short_timeouts_cost_the_connection() {
    let mut table = String::from("timeout  loss  jitter |   sent  received   lost   late | times down\n");
    for (code, timeout) in [(1, "8 ms"), (5, "128 ms")] {
        for loss_ppm in [0, 10_000, 100_000, 300_000] {
            for jitter_us in [0, 500, 3_000] {
                let multiplier = TimeoutMultiplier::new(code).unwrap();
                let jitter = Duration::from_micros(jitter_us);
                let reorder_by = Duration::from_micros(jitter_us);
                let reorder_ppm = if jitter_us > 1_000 { 10_000 } else { 0 };
                let link = Impairment { loss_ppm, jitter, reorder_ppm, reorder_by, ..cable() };
                let config =
                    ConnectionConfig { multiplier, retry_after: Duration::from_millis(50), ..wanted() };
                let mut bus = bus_of(config, link, 5);
                let events = run(&mut bus, 10_000);
                let down = |(_, news): &&(u64, News)| cause(news) == (Side::B, Some(DownCause::Watchdog));
                let downs = events.iter().filter(down).count();
                let sent = bus.a().counters().sent;
                let counters = bus.b().counters();
                let _ = writeln!(
                    table,
                    "{timeout:>7} {:>4}% {jitter_us:>4} µs | {sent:>6} {:>9} {:>6} {:>6} | {downs:>10}",
                    loss_ppm / 10_000,
                    counters.received,
                    counters.lost,
                    counters.late,
                );
            }
        }
    }
    insta::assert_snapshot!(table, @r"
    timeout  loss  jitter |   sent  received   lost   late | times down
       8 ms    0%    0 µs |   9999      9999      0      0 |          0
       8 ms    0%  500 µs |   9997      9996      0      0 |          0
       8 ms    0% 3000 µs |   9983      9888     93     93 |          0
       8 ms    1%    0 µs |   9999      9911     88      0 |          0
       8 ms    1%  500 µs |   9997      9908     88      0 |          0
       8 ms    1% 3000 µs |   9983      9798    182     83 |          0
       8 ms   10%    0 µs |   9799      8814    985      0 |          0
       8 ms   10%  500 µs |   9597      8625    971      0 |          0
       8 ms   10% 3000 µs |   9583      8540   1041     92 |          0
       8 ms   30%    0 µs |   6350      4383   1950      0 |          1
       8 ms   30%  500 µs |   2044      1410    615      0 |          1
       8 ms   30% 3000 µs |   4086      2763   1305     23 |          1
     128 ms    0%    0 µs |   9999      9999      0      0 |          0
     128 ms    0%  500 µs |   9997      9996      0      0 |          0
     128 ms    0% 3000 µs |   9983      9888     93     93 |          0
     128 ms    1%    0 µs |   9999      9911     88      0 |          0
     128 ms    1%  500 µs |   9997      9908     88      0 |          0
     128 ms    1% 3000 µs |   9983      9798    182     83 |          0
     128 ms   10%    0 µs |   9799      8814    985      0 |          0
     128 ms   10%  500 µs |   9597      8625    971      0 |          0
     128 ms   10% 3000 µs |   9583      8540   1041     92 |          0
     128 ms   30%    0 µs |   8799      6070   2727      0 |          0
     128 ms   30%  500 µs |   8597      5982   2611      0 |          0
     128 ms   30% 3000 µs |   8584      5875   2704     52 |          0
    ");
}

#[test]
fn an_adapter_of_another_address_is_not_listened_to() {
    let mut bus = up(wanted());
    bus.command_a(|scanner, now| {
        let source = machine::Source {
            port: Port::Udp(IO_PORT),
            peer: Some(std::net::SocketAddrV4::new(PLC, IO_PORT)),
        };
        scanner.handle_frame(
            now,
            source,
            &[2, 0, 2, 0x80, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xB1, 0, 2, 0, 0, 0],
        );
    });
    assert_eq!(bus.a().counters().foreign, 1);
}

#[test]
fn a_scanner_that_lost_its_session_keeps_the_images_going_and_connects_again_to_close() {
    let mut bus = up(wanted());
    bus.command_a(|scanner, now| scanner.handle_stream(now, StreamId(1), StreamChange::Closed));
    bus.command_b(|robot, now| robot.handle_stream(now, StreamId(1), StreamChange::Closed));
    assert_eq!(run(&mut bus, 1_000), []);
    bus.command_a(|scanner, now| scanner.disconnect(now));
    let events = run(&mut bus, 100);
    let told: Vec<_> = events.iter().map(|(_, news)| cause(news)).collect();
    assert_eq!(told, [(Side::B, Some(DownCause::ClosedByPeer)), (Side::A, Some(DownCause::ClosedHere))]);
    assert_eq!(bus.b().sessions(), 0);
}

#[test]
fn a_disconnect_before_the_connection_is_up_gives_the_attempt_up() {
    for micros in [900, 1_010, 1_040, 1_080, 1_120, 1_170, 1_220] {
        let mut bus = bus_of(wanted(), cable(), 1);
        bus.next_event(Instant::from_micros(micros));
        bus.command_a(|scanner, now| scanner.disconnect(now));
        let events = run(&mut bus, 20_000);
        assert_eq!(cause(&events.last().unwrap().1), (Side::A, Some(DownCause::ClosedHere)), "{micros} µs");
        assert_eq!((bus.b().connections(), bus.b().sessions()), ((0, 0), 0), "{micros} µs");
        assert_eq!(bus.a().poll_timeout(), None);
    }
}

#[test]
fn a_scanner_that_asks_for_a_multicast_joins_the_group_that_the_adapter_names_and_leaves_it_at_the_end() {
    let group = Some(std::net::Ipv4Addr::new(239, 192, 1, 32));
    let mut bus = up(ConnectionConfig { multicast: true, ..wanted() });
    assert_eq!(bus.a().group(Port::Udp(IO_PORT), 0), group);
    assert_eq!(bus.a().group(Port::Udp(ENCAPSULATION_PORT), 0), None);
    let to = Rc::new(RefCell::new(Vec::new()));
    let tapped = Rc::clone(&to);
    bus.set_tap(move |tap| {
        if let (Side::B, Side::B, Carrier::Udp { source, to }) = (tap.from, tap.end, tap.carrier)
            && source.port() == IO_PORT
        {
            tapped.borrow_mut().push(Some(*to.ip()));
        }
    });
    bus.command_b(|robot, _| robot.set_produced(PRODUCED, &data(9)).unwrap());
    run(&mut bus, 1_000);
    assert_eq!(bus.a().input(), Some(&data(9)[..]));
    assert!(to.borrow().len() >= 1_000 && to.borrow().iter().all(|to| *to == group));
    let counters = bus.a().counters();
    assert_eq!((counters.lost, counters.late, counters.foreign, counters.malformed), (0, 0, 0, 0));
    bus.command_a(|scanner, now| scanner.disconnect(now));
    run(&mut bus, 10);
    assert_eq!((bus.a().group(Port::Udp(IO_PORT), 0), bus.b().connections()), (None, (0, 0)));
}

#[test]
fn a_scanner_that_asked_for_frames_to_itself_belongs_to_no_group() {
    let bus = up(wanted());
    assert_eq!(bus.a().group(Port::Udp(IO_PORT), 0), None);
}

/// Another device than the robot: small assemblies, no configuration, numbers above 255.
static CONVEYOR: Description = Description {
    vendor: 77,
    assemblies: &[
        Assembly { instance: 0x301, role: Role::Produced, size: 16, name: "Position" },
        Assembly { instance: 0x302, role: Role::Consumed, size: 4, name: "Speed" },
    ],
    ..DEVICE
};

#[test]
fn an_adapter_with_other_assemblies_sizes_and_intervals_is_driven_all_the_same() {
    let config = ConnectionConfig {
        o_t_rpi_us: 4_000,
        t_o_rpi_us: 10_000,
        multiplier: TimeoutMultiplier::new(0).unwrap(),
        ..ConnectionConfig::exclusive_owner(ROBOT, &CONVEYOR, 1_000)
    };
    let device = AdapterConfig { description: &CONVEYOR, ..adapter_config() };
    let addresses = [Some(PLC), Some(ROBOT)];
    let pair = PairConfig { seed: 1, clocks: [Clock::default(); 2], links: [cable(); 2], addresses };
    let mut bus =
        Bus::new(SingleConnection::new(config, Instant::from_millis(1)), Adapter::new(device), pair);
    bus.command_a(|scanner, _| scanner.set_output(&[1, 2, 3, 4]));
    bus.command_b(|device, _| device.set_produced(0x301, &[9; 16]).unwrap());
    run(&mut bus, 1_000);
    assert_eq!(bus.b().consumed(0x302), Some(&[1, 2, 3, 4][..]));
    assert_eq!(bus.a().input(), Some(&[9; 16][..]));
    // Each sends on its own grid. The adapter's begins half an interval after the connection was opened.
    assert_eq!((bus.a().counters().sent, bus.b().counters().sent), (250, 100));
}
