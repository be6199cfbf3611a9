//! The IO-Controller against the IO-Device on a cable that loses, and with devices that are not what was expected.

use std::fmt::Write;
use std::net::Ipv4Addr;
use std::time::Duration;

use crate::samples::{self, LEN};
use machine::ethernet::Mac;
use machine::{Down, DownCause, LinkEvent};
use machine::{Instant, Machine, PortRequest, Source, Transmit};
use profinet::description::{Description, Identity, Module};
use profinet::rt::Transport;
use profinet::{Ar, ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig, Parameter};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig, Side};

const CONTROLLER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const DEVICE: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const BOTH: [Transport; 2] = [Transport::Udp, Transport::Rt1];

/// A machine whose frames of these numbers, counted from 0, are lost on the way.
struct Losing<M> {
    machine: M,
    sent: usize,
    lost: Vec<usize>,
}

impl<M> Losing<M> {
    fn new(machine: M, lost: &[usize]) -> Self {
        Self { machine, sent: 0, lost: lost.to_vec() }
    }
}

impl<M: Machine> Machine for Losing<M> {
    type Event = M::Event;

    fn ports(&self) -> &[PortRequest] {
        self.machine.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.machine.handle_frame(now, from, frame);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.machine.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        loop {
            let transmit = self.machine.poll_transmit(now, buf)?;
            self.sent += 1;
            if !self.lost.contains(&(self.sent - 1)) {
                return Some(transmit);
            }
        }
    }

    fn poll_event(&mut self) -> Option<M::Event> {
        self.machine.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.machine.poll_timeout()
    }
}

type Bus = Pair<Losing<Controller>, Losing<Device>>;

/// Returns the first AR of the controller.
fn ar(bus: &Bus) -> (ArId, &Ar) {
    let controller = &bus.a().machine;
    controller.ars().next().unwrap()
}

/// Returns the newest input data of the controller, and output data of the device.
fn data(bus: &Bus) -> [Option<&[u8]>; 2] {
    [ar(bus).1.input(1, 1), bus.b().machine.output(1, 1)]
}

#[derive(Clone)]
struct Cell {
    transport: Transport,
    description: Description,
    seed: u64,
    loss_ppm: u32,
    lost: [Vec<usize>; 2],
}

impl Cell {
    fn new(transport: Transport) -> Self {
        Self { transport, description: samples::DEVICE, seed: 1, loss_ppm: 0, lost: [Vec::new(), Vec::new()] }
    }

    /// Returns a controller that sends this byte repeatedly.
    fn controller(&self, start: Instant, byte: u8) -> Controller {
        let mut controller = Controller::new(ControllerConfig {
            mac: Mac([2, 0, 0, 0, 0, 1]),
            station_name: "controller".into(),
            address: CONTROLLER,
            mask: MASK,
            description: samples::CONTROLLER,
            seed: self.seed,
        })
        .unwrap();
        let config = ArConfig {
            station_name: "device".into(),
            mac: None,
            address: DEVICE,
            description: samples::DEVICE,
            parameters: vec![Parameter::interface_adjust()],
            transport: self.transport,
            cycle: Duration::from_millis(1),
            watchdog_cycles: 20,
        };
        let ar = controller.connect(config, start).unwrap();
        controller.ar_mut(ar).unwrap().set_output(1, 1, &[byte; LEN]).unwrap();
        controller
    }

    fn device(&self, now: Instant, address: Option<Ipv4Addr>) -> Device {
        let config = DeviceConfig {
            mac: Mac([2, 0, 0, 0, 0, 2]),
            station_name: b"device".to_vec(),
            permanent: None,
            address,
            mask: MASK,
            description: self.description,
            controllers: machine::Allowed::default(),
        };
        let mut device = Device::new(config, now);
        device.set_inputs(|_, _, data| data.fill(2));
        device
    }

    fn build(&self) -> Bus {
        let clocks = [
            Clock { offset_ns: 5_000_000_000, drift_ppb: 30_000 },
            Clock { offset_ns: 9_000_333_777, drift_ppb: -30_000 },
        ];
        let starts = clocks.map(|clock| Instant::from_nanos(clock.offset_ns));
        let cable =
            Impairment { delay: Duration::from_micros(25), loss_ppm: self.loss_ppm, ..Impairment::default() };
        Pair::new(
            Losing::new(self.controller(starts[0], 1), &self.lost[0]),
            Losing::new(self.device(starts[1], None), &self.lost[1]),
            PairConfig { seed: self.seed, clocks, links: [cable; 2], addresses: [Some(CONTROLLER), None] },
        )
    }
}

/// Returns the next event of the controller. Meanwhile it sets the address that DCP requests on the device's interface.
fn next_of_controller(bus: &mut Bus, until: Instant) -> Option<LinkEvent> {
    loop {
        match bus.next_event(until)? {
            Event::A((_, event)) => return Some(event),
            Event::B(LinkEvent::SetAddress { address, .. }) => {
                bus.set_address(Side::B, Some(address));
                bus.command_b(|device, now| device.machine.address_set(now, true));
            }
            Event::B(_) => {}
        }
    }
}

/// Runs for a while and returns what the controller reported.
fn reported(bus: &mut Bus, within: Duration) -> Vec<LinkEvent> {
    let until = bus.now() + within;
    std::iter::from_fn(|| next_of_controller(bus, until)).collect()
}

/// Runs until images go both ways, and returns how long that took.
fn up_within(bus: &mut Bus, within: Duration) -> Option<Duration> {
    let start = bus.now();
    let until = start + within;
    while data(bus).contains(&None) {
        if bus.now() >= until {
            return None;
        }
        let next = bus.now() + Duration::from_millis(1);
        while next_of_controller(bus, next).is_some() {}
    }
    Some(bus.now().since(start))
}

fn down(events: &[LinkEvent]) -> Option<Down> {
    match events {
        [LinkEvent::Down(down)] => Some(*down),
        _ => None,
    }
}

#[test]
fn the_connection_comes_up_within_a_second_whichever_frame_is_lost() {
    for transport in BOTH {
        for side in [0, 1] {
            for nth in 0..40 {
                let mut cell = Cell::new(transport);
                cell.lost[side] = vec![nth];
                let took = up_within(&mut cell.build(), Duration::from_secs(1));
                assert!(took.is_some(), "{transport:?}: frame {nth} of side {side}");
            }
        }
    }
}

/// How long the connection takes, to a millisecond, if the nth frame of one side is lost. A frame that nobody waits for and
/// one of three questions by ARP cost nothing, a request or an answer costs one repetition.
#[test]
fn what_each_lost_frame_costs() {
    let mut table = String::from("lost  controller's  device's\n");
    for nth in 0..22 {
        let millis = [0, 1].map(|side| {
            let mut cell = Cell::new(Transport::Udp);
            cell.lost[side] = vec![nth];
            up_within(&mut cell.build(), Duration::from_secs(1)).map(|took| took.as_millis())
        });
        let [controller, device] =
            millis.map(|millis| millis.map_or("never".into(), |millis| format!("{millis} ms")));
        writeln!(table, "{nth:4} {controller:>13} {device:>9}").unwrap();
    }
    insta::assert_snapshot!(table, @r"
    lost  controller's  device's
       0        462 ms    262 ms
       1        262 ms    462 ms
       2        262 ms    262 ms
       3        262 ms    262 ms
       4        262 ms    262 ms
       5        262 ms    262 ms
       6        262 ms    402 ms
       7        262 ms    262 ms
       8        262 ms    462 ms
       9        262 ms    262 ms
      10        462 ms    461 ms
      11        282 ms    461 ms
      12        462 ms    461 ms
      13        461 ms    262 ms
      14        461 ms    262 ms
      15        461 ms    262 ms
      16        263 ms    262 ms
      17        262 ms    262 ms
      18        262 ms    262 ms
      19        262 ms    262 ms
      20        262 ms    262 ms
      21        262 ms    262 ms
    ");
}

#[test]
fn the_connection_comes_up_whichever_two_frames_are_lost() {
    for first in 0..10 {
        for second in 0..10 {
            for sides in [[0, 0], [0, 1], [1, 1]] {
                let mut cell = Cell::new(Transport::Udp);
                cell.lost[sides[0]].push(first);
                cell.lost[sides[1]].push(second + usize::from(sides[0] == sides[1]) * (first + 1));
                let took = up_within(&mut cell.build(), Duration::from_secs(3));
                assert!(took.is_some(), "{:?}", cell.lost);
            }
        }
    }
}

#[test]
fn a_cable_that_loses_a_fifth_of_all_frames_delays_the_connection_but_does_not_prevent_it() {
    for transport in BOTH {
        for seed in 0..20 {
            let cell = Cell { seed, loss_ppm: 200_000, ..Cell::new(transport) };
            let took = up_within(&mut cell.build(), Duration::from_secs(10));
            assert!(took.is_some(), "{transport:?}, seed {seed}");
        }
    }
}

#[test]
fn a_device_that_is_off_is_reported_once_after_3_s() {
    let mut bus = Cell::new(Transport::Udp).build();
    bus.kill(Side::B);
    assert_eq!(reported(&mut bus, Duration::from_millis(2_999)), []);
    let down = down(&reported(&mut bus, Duration::from_secs(30))).expect("one event");
    assert_eq!((down.cause, down.code), (DownCause::NoAnswer, 0));
    assert!(down.text.starts_with("no station answers to the device's name"), "{down}");
}

#[test]
fn another_device_under_the_name_is_refused_with_its_identity() {
    let identity = Identity { vendor: 0x0493, device: 2 };
    let cell = Cell { description: Description { identity, ..samples::DEVICE }, ..Cell::new(Transport::Udp) };
    let down = down(&reported(&mut cell.build(), Duration::from_secs(5))).expect("one event");
    assert_eq!((down.cause, down.code), (DownCause::Refused, 0x0493_0002));
}

#[test]
fn a_missing_and_a_wrong_module_are_refused_with_their_slot() {
    const WITHOUT_SLOT_1: &[Module] = &[samples::DEVICE.modules[0]];
    const OTHER_IN_SLOT_1: &[Module] =
        &[samples::DEVICE.modules[0], Module { ident: 0x4711, ..samples::DEVICE.modules[1] }];
    for (modules, words) in
        [(WITHOUT_SLOT_1, "the device has no module"), (OTHER_IN_SLOT_1, "the device has another module")]
    {
        let cell =
            Cell { description: Description { modules, ..samples::DEVICE }, ..Cell::new(Transport::Udp) };
        let mut bus = cell.build();
        let down = down(&reported(&mut bus, Duration::from_secs(5))).expect("one event");
        assert_eq!((down.cause, down.code), (DownCause::Refused, 0x0001_0000), "{down}");
        assert!(down.text.starts_with(words), "{down}");
        assert_eq!(ar(&bus).1.module_diff()[0].slot, 1);
    }
}

#[test]
fn a_cut_cable_trips_the_watchdog_and_mending_it_brings_the_data_back() {
    for transport in BOTH {
        let mut bus = Cell::new(transport).build();
        up_within(&mut bus, Duration::from_secs(1)).expect("a connection");
        bus.set_cut(true);
        let down = down(&reported(&mut bus, Duration::from_secs(5))).expect("one event");
        assert_eq!(down.cause, DownCause::Watchdog);
        assert_eq!(data(&bus)[0], None);
        bus.set_cut(false);
        let took = up_within(&mut bus, Duration::from_secs(3));
        assert!(took.is_some(), "{transport:?}");
    }
}

#[test]
fn a_device_that_restarts_is_connected_again() {
    for transport in BOTH {
        let cell = Cell::new(transport);
        let mut bus = cell.build();
        up_within(&mut bus, Duration::from_secs(1)).expect("a connection");
        bus.command_b(|device, now| device.machine = cell.device(now, Some(DEVICE)));
        let down = down(&reported(&mut bus, Duration::from_millis(50))).expect("one event");
        assert_eq!(down.cause, DownCause::Watchdog);
        let took = up_within(&mut bus, Duration::from_secs(1));
        assert!(took.is_some(), "{transport:?}");
    }
}

#[test]
fn a_controller_that_restarts_gets_its_device_back() {
    for transport in BOTH {
        let cell = Cell::new(transport);
        let mut bus = cell.build();
        up_within(&mut bus, Duration::from_secs(1)).expect("a connection");
        bus.command_a(|controller, now| controller.machine = cell.controller(now, 3));
        let took = up_within(&mut bus, Duration::from_secs(2));
        assert!(took.is_some(), "{transport:?}");
        assert_eq!(data(&bus)[1], Some(&[3; LEN][..]));
    }
}

#[test]
fn disconnect_releases_the_device_and_both_sides_say_so() {
    let mut bus = Cell::new(Transport::Rt1).build();
    up_within(&mut bus, Duration::from_secs(1)).expect("a connection");
    let id = ar(&bus).0;
    bus.command_a(|controller, now| controller.machine.ar_mut(id).unwrap().disconnect(now));
    let down = down(&reported(&mut bus, Duration::from_secs(2))).expect("one event");
    assert_eq!(down.cause, DownCause::ClosedHere);
    assert_eq!(data(&bus), [None, None]);
    let next = bus.a().poll_timeout();
    assert_eq!(
        next,
        Some(Instant::from_nanos(10_000_000_000)),
        "a released controller only announces itself"
    );
}
