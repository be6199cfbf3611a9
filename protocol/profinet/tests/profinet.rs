//! An IO-Controller and an IO-Device on one cable, in virtual time.

use std::net::Ipv4Addr;
use std::time::Duration;

use machine::Instant;
use machine::ethernet::Mac;
use machine::{DownCause, LinkEvent};
use profinet::rt::Transport;
use profinet::{Controller, ControllerConfig, Device, DeviceConfig, description};
use profinet::{IO_DATA_LEN, IoData};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig, Side};

const CONTROLLER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const DEVICE: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const CABLE: Impairment = Impairment {
    delay: Duration::from_micros(25),
    jitter: Duration::ZERO,
    loss_ppm: 0,
    duplicate_ppm: 0,
    reorder_ppm: 0,
    reorder_by: Duration::ZERO,
    corrupt_ppm: 0,
};

type Bus = Pair<Controller, Device>;

/// A controller and a device that does not have an address yet.
#[expect(clippy::expect_used, reason = "a setup that is wrong fails the test")]
fn bus(transport: Transport, watchdog_cycles: u16, seed: u64) -> Bus {
    let clocks = [
        Clock { offset_ns: 3_000_000_000, drift_ppb: 30_000 },
        Clock { offset_ns: 7_123_456_789, drift_ppb: -30_000 },
    ];
    let controller = Controller::new(
        ControllerConfig {
            mac: Mac([2, 0, 0, 0, 0, 1]),
            station_name: "skillbench-plc".into(),
            address: CONTROLLER,
            mask: MASK,
            device_station_name: "skillbench-robot".into(),
            device_address: DEVICE,
            description: description::ROBOT,
            parameters: Vec::new(),
            transport,
            cycle: Duration::from_millis(1),
            watchdog_cycles,
            seed,
        },
        Instant::from_nanos(clocks[0].offset_ns),
    );
    let device = Device::new(
        DeviceConfig {
            mac: Mac([2, 0, 0, 0, 0, 2]),
            station_name: b"skillbench-robot".to_vec(),
            address: None,
            mask: MASK,
            description: description::ROBOT,
        },
        Instant::from_nanos(clocks[1].offset_ns),
    );
    let config = PairConfig { seed, clocks, links: [CABLE; 2], addresses: [Some(CONTROLLER), None] };
    let mut bus = Pair::new(controller.expect("a cycle of 1 ms"), device, config);
    bus.command_a(|controller, _| controller.set_output(&image(0x11)));
    bus.command_b(|device, _| device.set_output(&image(0x22)));
    bus
}

fn image(fill: u8) -> IoData {
    let mut image = [fill; IO_DATA_LEN];
    image.iter_mut().enumerate().for_each(|(index, byte)| *byte = byte.wrapping_add(index as u8));
    image
}

/// The next event of either side; the address that DCP sets is put on the device's interface on the way.
fn next_event(bus: &mut Bus, within: Duration) -> Option<Event<LinkEvent, LinkEvent>> {
    let until = bus.now() + within;
    while let Some(event) = bus.next_event(until) {
        let Event::B(LinkEvent::SetAddress { address, .. }) = event else { return Some(event) };
        bus.set_address(Side::B, Some(address));
        bus.command_b(|device, now| device.address_set(now, true));
    }
    None
}

/// Runs until both sides are up, and returns how long that took.
fn connect(bus: &mut Bus, within: Duration) -> Option<Duration> {
    let start = bus.now();
    let until = start + within;
    let (mut a, mut b) = (false, false);
    while !(a && b) {
        match next_event(bus, until.since(bus.now()))? {
            Event::A(event) => a = event == LinkEvent::Up,
            Event::B(event) => b = event == LinkEvent::Up,
        }
    }
    Some(bus.now().since(start))
}

fn run(bus: &mut Bus, for_: Duration) -> Vec<Event<LinkEvent, LinkEvent>> {
    let until = bus.now() + for_;
    std::iter::from_fn(|| next_event(bus, until.since(bus.now()))).collect()
}

const BOTH: [Transport; 2] = [Transport::Udp, Transport::Rt1];

#[test]
fn images_go_both_ways_within_a_tenth_of_a_second_of_power_on() {
    for transport in BOTH {
        let mut bus = bus(transport, 20, 1);
        let took = connect(&mut bus, Duration::from_secs(1)).expect("a connection");
        assert!(took < Duration::from_millis(100), "{transport:?}: {took:?}");
        assert_eq!(run(&mut bus, Duration::from_secs(10)), []);
        assert_eq!(bus.b().input(), Some(&image(0x11)), "{transport:?}");
        assert_eq!(bus.a().input(), Some(&image(0x22)), "{transport:?}");
        for counters in [bus.a().counters(), bus.b().counters()] {
            assert!((10_000..10_100).contains(&counters.sent), "{counters:?}");
            assert!((10_000..10_100).contains(&counters.received), "{counters:?}");
            assert_eq!((counters.lost, counters.late, counters.malformed), (0, 0, 0));
        }
    }
}

/// What a side said last about the end of its connection.
fn downs(events: &[Event<LinkEvent, LinkEvent>]) -> Vec<(Side, DownCause, u32)> {
    let down = |event: &_| match event {
        Event::A(LinkEvent::Down(down)) => Some((Side::A, down.cause, down.code)),
        Event::B(LinkEvent::Down(down)) => Some((Side::B, down.cause, down.code)),
        _ => None,
    };
    events.iter().filter_map(down).collect()
}

#[test]
fn a_cut_cable_trips_both_watchdogs_in_time_and_the_mended_one_connects_again() {
    for transport in BOTH {
        let mut bus = bus(transport, 20, 2);
        connect(&mut bus, Duration::from_secs(1)).expect("a connection");
        run(&mut bus, Duration::from_millis(500));
        bus.set_cut(true);
        let cut_at = bus.now();
        let mut last_down = cut_at;
        let mut events = Vec::new();
        while let Some(event) = next_event(&mut bus, Duration::from_millis(100)) {
            last_down = bus.now();
            events.push(event);
        }
        let mut downs = downs(&events);
        downs.sort_by_key(|(side, ..)| *side == Side::B);
        let watchdog = |side| (side, DownCause::Watchdog, 0xCF81_FD05);
        assert_eq!(downs, [watchdog(Side::A), watchdog(Side::B)], "{transport:?}");
        let took = last_down.since(cut_at);
        assert!((19..22).contains(&took.as_millis()), "{transport:?}: {took:?}");
        assert_eq!((bus.a().input(), bus.b().input()), (None, None));

        bus.set_cut(false);
        let took = connect(&mut bus, Duration::from_secs(5)).expect("a connection again");
        assert!(took < Duration::from_secs(2), "{transport:?}: {took:?}");
    }
}

#[test]
fn a_release_ends_the_connection_on_both_sides_without_a_watchdog() {
    for transport in BOTH {
        let mut bus = bus(transport, 20, 3);
        connect(&mut bus, Duration::from_secs(1)).expect("a connection");
        bus.command_a(|controller, now| controller.disconnect(now));
        let downs = downs(&run(&mut bus, Duration::from_secs(5)));
        assert!(downs.contains(&(Side::B, DownCause::ClosedByPeer, 0)), "{transport:?}: {downs:?}");
        assert!(downs.iter().all(|(_, cause, _)| *cause != DownCause::Watchdog), "{downs:?}");
        assert_eq!(bus.b().input(), None);
        let sent = bus.b().counters().sent;
        run(&mut bus, Duration::from_secs(1));
        assert_eq!(bus.b().counters().sent, sent, "nothing is sent any more");
    }
}

#[test]
fn a_device_that_aborts_says_so_and_the_controller_connects_again() {
    for transport in BOTH {
        let mut bus = bus(transport, 20, 4);
        connect(&mut bus, Duration::from_secs(1)).expect("a connection");
        bus.command_b(|device, now| device.disconnect(now));
        let mut downs = downs(&run(&mut bus, Duration::from_millis(1)));
        downs.sort_by_key(|(side, ..)| *side == Side::B);
        let aborted = 0xCF81_FD0D;
        assert_eq!(
            downs,
            [(Side::A, DownCause::ClosedByPeer, aborted), (Side::B, DownCause::ClosedHere, aborted)]
        );
        connect(&mut bus, Duration::from_secs(2)).expect("a connection again");
    }
}

#[test]
fn a_killed_controller_is_missed_by_the_device() {
    let mut bus = bus(Transport::Udp, 20, 5);
    connect(&mut bus, Duration::from_secs(1)).expect("a connection");
    bus.kill(Side::A);
    let downs = downs(&run(&mut bus, Duration::from_secs(1)));
    assert_eq!(downs, [(Side::B, DownCause::Watchdog, 0xCF81_FD05)]);
}

#[test]
fn the_same_seed_gives_the_same_frames_at_the_same_nanoseconds() {
    let trace = || {
        let mut bus = bus(Transport::Udp, 20, 6);
        let (sink, frames) = std::sync::mpsc::channel();
        bus.set_tap(move |tapped| {
            let _ = sink.send((tapped.at, tapped.end, tapped.from, tapped.frame.to_vec()));
        });
        let noisy = Impairment { jitter: Duration::from_micros(200), loss_ppm: 10_000, ..CABLE };
        bus.set_impairment(Side::A, noisy);
        run(&mut bus, Duration::from_secs(2));
        drop(bus);
        frames.iter().collect::<Vec<_>>()
    };
    let first = trace();
    assert!(first.len() > 4_000);
    assert!(first == trace());
}

#[test]
fn a_bad_cable_costs_frames_and_time_but_never_the_wrong_data() {
    let mut table =
        String::from("cable                  cyclic  up after    downs  received  lost  late  malformed\n");
    let faults = [
        ("perfect", CABLE),
        ("loss 1 %", Impairment { loss_ppm: 10_000, ..CABLE }),
        ("loss 10 %", Impairment { loss_ppm: 100_000, ..CABLE }),
        ("loss 30 %", Impairment { loss_ppm: 300_000, ..CABLE }),
        ("duplicates 20 %", Impairment { duplicate_ppm: 200_000, ..CABLE }),
        (
            "reordered 10 %",
            Impairment { reorder_ppm: 100_000, reorder_by: Duration::from_micros(2_500), ..CABLE },
        ),
        ("corrupted 5 %", Impairment { corrupt_ppm: 50_000, ..CABLE }),
        ("jitter 5 ms", Impairment { jitter: Duration::from_millis(5), ..CABLE }),
    ];
    for (name, impairment) in faults {
        for transport in BOTH {
            let mut bus = bus(transport, 50, 7);
            for side in [Side::A, Side::B] {
                bus.set_impairment(side, impairment);
            }
            let took = connect(&mut bus, Duration::from_secs(30)).expect(name);
            let downs = downs(&run(&mut bus, Duration::from_secs(10))).len();
            let counters = bus.b().counters();
            if impairment.corrupt_ppm == 0 && downs == 0 {
                assert_eq!(bus.b().input(), Some(&image(0x11)), "{name}");
            }
            table += &format!(
                "{name:<22} {:<7} {:>6} ms  {downs:>7} {:>9} {:>5} {:>5} {:>10}\n",
                format!("{transport:?}").to_lowercase(),
                took.as_millis(),
                counters.received,
                counters.lost,
                counters.late,
                counters.malformed,
            );
        }
    }
    insta::assert_snapshot!(table);
}
