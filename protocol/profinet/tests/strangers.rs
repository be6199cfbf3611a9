//! A stranger changes nothing between an IO-Controller and its IO-Device.
//!
//! The pair connects, exchanges data and parts, once alone and once while a station with other addresses sends altered
//! copies of all its frames, also of those that the pair sends later, to both. The pair must send the same bytes at the
//! same instants and report the same events, and while data are exchanged no frame of the stranger may cost heap memory.
//! It counts what the whole process allocates, so it has no test harness. `STRANGER_RUNS` sets the number of runs.

#![expect(clippy::expect_used, reason = "a test without a harness")]

use std::alloc::System;
use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Allowed, Duration, Instant, LinkEvent, Peer};
use profinet::rt::Transport;
use profinet::{ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig, Parameter};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use virtual_time::hostile::{Member, MemberEvent, Sent, Stranger, Watched};
use virtual_time::{Network, StationId};

#[expect(dead_code, reason = "other tests use the others")]
#[path = "profinet/samples.rs"]
mod samples;

use samples::LEN;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const STATIONS: [(Mac, Ipv4Addr); 2] = [
    (Mac([2, 0, 0, 0, 0, 1]), Ipv4Addr::new(192, 168, 64, 1)),
    (Mac([2, 0, 0, 0, 0, 2]), Ipv4Addr::new(192, 168, 64, 2)),
];
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

fn allocations() -> u64 {
    let stats = INSTRUMENTED_SYSTEM.stats();
    (stats.allocations + stats.reallocations) as u64
}

type Station = Member<Controller, Device>;
/// An event of the controller or of the device, and when.
type Reported = (Instant, MemberEvent<LinkEvent, LinkEvent>);

struct Cell {
    network: Network<Station>,
    controller: StationId,
    device: StationId,
    ar: ArId,
    events: Vec<Reported>,
    /// Data that arrived, one entry a millisecond: the first byte at the controller and at the device.
    images: Vec<[Option<u8>; 2]>,
}

/// What a run left behind.
#[derive(PartialEq)]
struct Record {
    sent: [Vec<Sent>; 2],
    events: Vec<Reported>,
    images: Vec<[Option<u8>; 2]>,
}

impl Cell {
    /// Creates a pair whose stations know each other by address if `listed`.
    fn new(transport: Transport, listed: bool) -> Self {
        let [(controller_mac, controller), (device_mac, device)] = STATIONS;
        let listed_peer = Peer { address: Some(controller), mac: Some(controller_mac), serial_number: None };
        let config = ControllerConfig {
            mac: controller_mac,
            station_name: "controller".into(),
            address: controller,
            mask: MASK,
            description: samples::CONTROLLER,
            seed: 1,
        };
        let mut master = Controller::new(config).expect("a valid configuration");
        let config = ArConfig {
            station_name: "device".into(),
            mac: listed.then_some(device_mac),
            address: device,
            description: samples::DEVICE,
            parameters: vec![Parameter::interface_adjust()],
            transport,
            cycle: Duration::from_millis(1),
            watchdog_cycles: 10,
        };
        let ar = master.connect(config, Instant::ZERO).expect("a valid configuration");
        let slave = Device::new(
            DeviceConfig {
                mac: device_mac,
                station_name: b"device".to_vec(),
                address: None,
                mask: MASK,
                description: samples::DEVICE,
                controllers: Allowed(if listed { vec![listed_peer] } else { Vec::new() }),
            },
            Instant::ZERO,
        );
        let mut network = Network::new(Duration::from_micros(25));
        let watched = Member::A(Watched::new(master, allocations));
        let id = network.add(watched, controller_mac, Some(controller));
        let watched = Member::B(Watched::new(slave, allocations));
        let device = network.add(watched, device_mac, None);
        Self { network, controller: id, device, ar, events: Vec::new(), images: Vec::new() }
    }

    fn controller<R>(&mut self, command: impl FnOnce(&mut Watched<Controller>, Instant) -> R) -> R {
        let done = self.network.command(self.controller, |station, now| match station {
            Member::A(watched) => Some(command(watched, now)),
            _ => None,
        });
        done.flatten().expect("the controller")
    }

    fn device<R>(&mut self, command: impl FnOnce(&mut Watched<Device>, Instant) -> R) -> R {
        let done = self.network.command(self.device, |station, now| match station {
            Member::B(watched) => Some(command(watched, now)),
            _ => None,
        });
        done.flatten().expect("the device")
    }

    /// Runs to `until`; both sides change their data every millisecond.
    fn run(&mut self, until: Instant) {
        while self.network.now() < until {
            let step = self.network.now() + Duration::from_millis(1);
            while let Some((_, event)) = self.network.next_event(step) {
                let now = self.network.now();
                match event {
                    MemberEvent::B(LinkEvent::SetAddress { address, .. }) => {
                        self.events.push((now, MemberEvent::B(LinkEvent::Up)));
                        self.network.set_address(self.device, Some(address));
                        self.device(|device, now| device.machine.address_set(now, true));
                    }
                    MemberEvent::A((_, LinkEvent::Foreign(_))) | MemberEvent::B(LinkEvent::Foreign(_)) => {}
                    MemberEvent::A((_, event)) => self.events.push((now, MemberEvent::A(event))),
                    MemberEvent::B(event) => self.events.push((now, MemberEvent::B(event))),
                }
            }
            let value = (self.images.len() % 251) as u8;
            let ar = self.ar;
            let input = self.controller(|controller, _| {
                let ar = controller.machine.ar_mut(ar)?;
                ar.set_output(1, 1, &[value; LEN]).expect("256 bytes");
                ar.input(1, 1).map(|data| data[0])
            });
            let output = self.device(|device, _| {
                device.machine.set_input(1, 1, &[value; LEN]).expect("256 bytes");
                device.machine.output(1, 1).map(|data| data[0])
            });
            self.images.push([input, output]);
        }
    }

    /// Connects, exchanges data for 300 ms, parts, and waits; returns what was sent and reported.
    fn whole_life(mut self, stranger: Option<Stranger>) -> (Record, [u64; 2]) {
        if let Some(stranger) = stranger {
            let (mac, address) = (virtual_time::hostile::STRANGER_MAC, virtual_time::hostile::STRANGER);
            self.network.add(Member::Stranger(stranger), mac, Some(address));
        }
        self.run(Instant::from_millis(50));
        let before = [self.controller(|c, _| c.allocations), self.device(|d, _| d.allocations)];
        self.run(Instant::from_millis(350));
        let after = [self.controller(|c, _| c.allocations), self.device(|d, _| d.allocations)];
        assert_eq!(after, before, "allocations for frames of a stranger while data are exchanged");
        let foreign = [self.controller(|c, _| c.foreign), self.device(|d, _| d.foreign)];
        let ar = self.ar;
        self.controller(|controller, now| controller.machine.ar_mut(ar).map(|ar| ar.disconnect(now)));
        self.run(Instant::from_millis(360));
        let sent = [
            self.controller(|c, _| core::mem::take(&mut c.sent)),
            self.device(|d, _| core::mem::take(&mut d.sent)),
        ];
        (Record { sent, events: self.events, images: self.images }, foreign)
    }
}

/// Returns the first frame that differs.
fn difference(alone: &Record, disturbed: &Record) -> String {
    for (side, name) in ["controller", "device"].into_iter().enumerate() {
        let pairs = alone.sent[side].iter().zip(&disturbed.sent[side]);
        if let Some((one, other)) = pairs.into_iter().find(|(one, other)| one != other) {
            return format!("the {name} sent\n{other:02x?}\ninstead of\n{one:02x?}");
        }
    }
    let (one, other) = (alone.sent.each_ref().map(Vec::len), disturbed.sent.each_ref().map(Vec::len));
    format!("{one:?} and {other:?} frames; events {:?} instead of {:?}", disturbed.events, alone.events)
}

fn main() {
    let runs = std::env::var("STRANGER_RUNS").ok().and_then(|runs| runs.parse().ok()).unwrap_or(6);
    let mut total = [0_u64; 2];
    for transport in [Transport::Rt1, Transport::Udp] {
        // Without lists a station may be a controller or a device like any other while there is no connection: the stranger
        // begins when the device has accepted the Connect, and ends with the connection.
        for (listed, start_us, end_us) in [(false, 160, 350_000), (true, 0, 360_000)] {
            let (alone, _) = Cell::new(transport, listed).whole_life(None);
            assert!(alone.images[60..350].iter().all(|image| image[0].is_some() && image[1].is_some()));
            let heard = alone.sent.concat();
            for seed in 0..runs {
                let time = (Instant::from_micros(start_us), Instant::from_micros(end_us));
                let stranger = Stranger::new(seed, &heard, STATIONS, None, time);
                let (disturbed, foreign) = Cell::new(transport, listed).whole_life(Some(stranger));
                assert!(
                    alone == disturbed,
                    "{transport:?}, listed: {listed}, seed {seed}: {}",
                    difference(&alone, &disturbed)
                );
                total = [total[0] + foreign[0], total[1] + foreign[1]];
            }
        }
    }
    assert!(total.iter().all(|frames| *frames > 1_000 * runs), "{total:?}");
    println!(
        "frames of strangers: {} to the controller, {} to the device; nothing changed",
        total[0], total[1]
    );
}
