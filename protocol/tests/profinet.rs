//! An IO-Controller and an IO-Device on one cable, in virtual time.

use std::net::Ipv4Addr;
use std::time::Duration;

use protocol::Instant;
use protocol::fieldbus::{DownCause, Fieldbus, LinkEvent};
use protocol::image::{IMAGE_LEN, Image};
use protocol::profinet::ethernet::Mac;
use protocol::profinet::rt::Transport;
use protocol::profinet::{Controller, ControllerConfig, Device, DeviceConfig, description};
use protocol::virtual_time::{Clock, Event, Impairment, Pair, PairConfig, Side};

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
    let mut bus = Pair::new(controller.unwrap(), device, config);
    bus.command_a(|controller, _| controller.set_output(&image(0x11)));
    bus.command_b(|device, _| device.set_output(&image(0x22)));
    bus
}

fn image(fill: u8) -> Image {
    let mut image = [fill; IMAGE_LEN];
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
