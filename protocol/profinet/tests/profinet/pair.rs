//! An IO-Controller and an IO-Device on one cable, in virtual time.

use std::net::Ipv4Addr;
use std::time::Duration;

use crate::samples::{self, LEN};
use machine::Instant;
use machine::ethernet::Mac;
use machine::{DownCause, LinkEvent};
use profinet::rt::Transport;
use profinet::{Ar, ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig};
use virtual_time::{Clock, Event, FrameFaults, Impairment, Pair, PairConfig, Side};

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
    corrupt_on_wire_ppm: 0,
    frame_faults: FrameFaults::NONE,
};

/// What either side reports.
type Reported = Event<(ArId, LinkEvent), LinkEvent>;

/// A controller with one AR, and its device.
struct PairBus {
    pair: Pair<Controller, Device>,
    ar: ArId,
}

impl PairBus {
    fn ar(&self) -> &Ar {
        self.pair.a().ar(self.ar).unwrap()
    }

    /// Returns the newest input data of the controller, and output data of the device.
    fn data(&self) -> [Option<&[u8]>; 2] {
        [self.ar().input(1, 1), self.pair.b().output(1, 1)]
    }
}

/// Returns a controller and a device that does not have an address yet.
fn bus(transport: Transport, watchdog_cycles: u16, seed: u64) -> PairBus {
    let clocks = [
        Clock { offset_ns: 3_000_000_000, drift_ppb: 30_000 },
        Clock { offset_ns: 7_123_456_789, drift_ppb: -30_000 },
    ];
    let mut controller = Controller::new(ControllerConfig {
        mac: Mac([2, 0, 0, 0, 0, 1]),
        station_name: "sample-controller".into(),
        address: CONTROLLER,
        mask: MASK,
        description: samples::CONTROLLER,
        seed,
    })
    .unwrap();
    let config = ArConfig {
        station_name: "sample-device".into(),
        mac: None,
        address: DEVICE,
        description: samples::DEVICE,
        parameters: Vec::new(),
        transport,
        cycle: Duration::from_millis(1),
        watchdog_cycles,
    };
    let ar = controller.connect(config, Instant::from_nanos(clocks[0].offset_ns)).unwrap();
    controller.ar_mut(ar).unwrap().set_output(1, 1, &data(0x11)).unwrap();
    let mut device = Device::new(
        DeviceConfig {
            mac: Mac([2, 0, 0, 0, 0, 2]),
            station_name: b"sample-device".to_vec(),
            permanent: None,
            address: None,
            mask: MASK,
            description: samples::DEVICE,
            controllers: machine::Allowed::default(),
        },
        Instant::from_nanos(clocks[1].offset_ns),
    );
    let config = PairConfig { seed, clocks, links: [CABLE; 2], addresses: [Some(CONTROLLER), None] };
    device.set_input(1, 1, &data(0x22)).unwrap();
    PairBus { pair: Pair::new(controller, device, config), ar }
}

fn data(fill: u8) -> [u8; LEN] {
    core::array::from_fn(|index| fill.wrapping_add(index as u8))
}

/// Returns the next event of either side. Meanwhile it sets the address that DCP requests on the device's interface.
fn next_event(bus: &mut PairBus, within: Duration) -> Option<Reported> {
    let until = bus.pair.now() + within;
    while let Some(event) = bus.pair.next_event(until) {
        let Event::B(LinkEvent::SetAddress { address, .. }) = event else { return Some(event) };
        bus.pair.set_address(Side::B, Some(address));
        bus.pair.command_b(|device, now| device.address_set(now, true));
    }
    None
}

/// Runs until both sides are up, and returns how long that took.
fn connect(bus: &mut PairBus, within: Duration) -> Option<Duration> {
    let start = bus.pair.now();
    let until = start + within;
    let (mut a, mut b) = (false, false);
    while !(a && b) {
        match next_event(bus, until.since(bus.pair.now()))? {
            Event::A((_, event)) => a = event == LinkEvent::Up,
            Event::B(event) => b = event == LinkEvent::Up,
        }
    }
    Some(bus.pair.now().since(start))
}

fn run(bus: &mut PairBus, for_: Duration) -> Vec<Reported> {
    let until = bus.pair.now() + for_;
    std::iter::from_fn(|| next_event(bus, until.since(bus.pair.now()))).collect()
}

const BOTH: [Transport; 2] = [Transport::Udp, Transport::Rt1];

#[test]
fn data_go_both_ways_within_400_ms_of_power_on() {
    for transport in BOTH {
        let mut bus = bus(transport, 20, 1);
        let took = connect(&mut bus, Duration::from_secs(1)).expect("a connection");
        assert!(took < Duration::from_millis(400), "{transport:?}: {took:?}");
        assert_eq!(run(&mut bus, Duration::from_secs(10)), []);
        assert_eq!(bus.data(), [Some(&data(0x22)[..]), Some(&data(0x11)[..])], "{transport:?}");
        for counters in [bus.ar().counters(), bus.pair.b().counters()] {
            assert!((10_000..10_100).contains(&counters.sent), "{counters:?}");
            assert!((10_000..10_100).contains(&counters.received), "{counters:?}");
            assert_eq!((counters.lost, counters.late, counters.malformed), (0, 0, 0));
        }
    }
}

/// Returns the ends of connections that the sides reported.
fn downs(events: &[Reported]) -> Vec<(Side, DownCause, u32)> {
    let down = |event: &_| match event {
        Event::A((_, LinkEvent::Down(down))) => Some((Side::A, down.cause, down.code)),
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
        bus.pair.set_cut(true);
        let cut_at = bus.pair.now();
        let mut last_down = cut_at;
        let mut events = Vec::new();
        while let Some(event) = next_event(&mut bus, Duration::from_millis(100)) {
            last_down = bus.pair.now();
            events.push(event);
        }
        let mut downs = downs(&events);
        downs.sort_by_key(|(side, ..)| *side == Side::B);
        let watchdog = |side| (side, DownCause::Watchdog, 0xCF81_FD05);
        assert_eq!(downs, [watchdog(Side::A), watchdog(Side::B)], "{transport:?}");
        let took = last_down.since(cut_at);
        assert!((19..22).contains(&took.as_millis()), "{transport:?}: {took:?}");
        assert_eq!(bus.data(), [None, None]);

        bus.pair.set_cut(false);
        let took = connect(&mut bus, Duration::from_secs(5)).expect("a connection again");
        assert!(took < Duration::from_secs(2), "{transport:?}: {took:?}");
    }
}

#[test]
fn a_release_ends_the_connection_on_both_sides_without_a_watchdog() {
    for transport in BOTH {
        let mut bus = bus(transport, 20, 3);
        connect(&mut bus, Duration::from_secs(1)).expect("a connection");
        let ar = bus.ar;
        bus.pair.command_a(|controller, now| controller.ar_mut(ar).unwrap().disconnect(now));
        let downs = downs(&run(&mut bus, Duration::from_secs(5)));
        assert!(downs.contains(&(Side::B, DownCause::ClosedByPeer, 0)), "{transport:?}: {downs:?}");
        assert!(downs.iter().all(|(_, cause, _)| *cause != DownCause::Watchdog), "{downs:?}");
        assert_eq!(bus.pair.b().output(1, 1), None);
        let sent = bus.pair.b().counters().sent;
        run(&mut bus, Duration::from_secs(1));
        assert_eq!(bus.pair.b().counters().sent, sent, "nothing is sent any more");
    }
}

#[test]
fn a_device_that_aborts_says_so_and_the_controller_connects_again() {
    for transport in BOTH {
        let mut bus = bus(transport, 20, 4);
        connect(&mut bus, Duration::from_secs(1)).expect("a connection");
        bus.pair.command_b(|device, now| device.disconnect(now));
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
    bus.pair.kill(Side::A);
    let downs = downs(&run(&mut bus, Duration::from_secs(1)));
    assert_eq!(downs, [(Side::B, DownCause::Watchdog, 0xCF81_FD05)]);
}

#[test]
fn the_same_seed_gives_the_same_frames_at_the_same_nanoseconds() {
    let trace = || {
        let mut bus = bus(Transport::Udp, 20, 6);
        let (sink, frames) = std::sync::mpsc::channel();
        bus.pair.set_tap(move |tapped| {
            let _ = sink.send((tapped.at, tapped.end, tapped.from, tapped.frame.to_vec()));
        });
        let noisy = Impairment { jitter: Duration::from_micros(200), loss_ppm: 10_000, ..CABLE };
        bus.pair.set_impairment(Side::A, noisy);
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
                bus.pair.set_impairment(side, impairment);
            }
            let took = connect(&mut bus, Duration::from_secs(30)).expect(name);
            let downs = downs(&run(&mut bus, Duration::from_secs(10))).len();
            let counters = bus.pair.b().counters();
            if impairment.corrupt_ppm == 0 && downs == 0 {
                assert_eq!(bus.pair.b().output(1, 1), Some(&data(0x11)[..]), "{name}");
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

#[test]
fn both_ends_of_the_cable_know_each_other_at_once_and_forget_each_other_when_it_is_cut() {
    for transport in BOTH {
        let mut bus = bus(transport, 20, 1);
        connect(&mut bus, Duration::from_secs(1)).expect("a connection");
        let neighbours = |bus: &PairBus| {
            [bus.pair.a().neighbour(), bus.pair.b().neighbour()].map(|neighbour| {
                neighbour.map(|one| (String::from_utf8_lossy(one.alias()).into_owned(), one.mac()))
            })
        };
        let [of_controller, of_device] = [("port-001.sample-device", 2), ("port-001.sample-controller", 1)]
            .map(|(alias, number)| Some((alias.to_owned(), Mac([2, 0, 0, 0, 0, number]))));
        assert_eq!(neighbours(&bus), [of_controller.clone(), of_device.clone()]);
        run(&mut bus, Duration::from_secs(60));
        assert_eq!(neighbours(&bus), [of_controller, of_device]);

        bus.pair.set_cut(true);
        run(&mut bus, Duration::from_millis(14_900));
        assert!(neighbours(&bus).iter().all(Option::is_some), "within the time to live");
        run(&mut bus, Duration::from_millis(5_200));
        assert_eq!(neighbours(&bus), [None, None]);
    }
}
