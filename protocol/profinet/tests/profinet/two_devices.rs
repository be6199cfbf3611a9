//! One controller with two devices on one switch.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{DownCause, Duration, Instant, InterfaceId, LinkEvent, Machine, PortRequest, Source, Transmit};
use profinet::rt::Transport;
use profinet::{Ar, ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig};
use virtual_time::{Network, NodeId, StationConfig, SwitchConfig, SwitchId};

use crate::samples::{self, LEN};

/// Delay of the cable of each station: between two a frame takes twice as long.
const CABLE: Duration = Duration::from_nanos(12_500);

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const CONTROLLER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const DEVICES: [Ipv4Addr; 2] = [Ipv4Addr::new(192, 168, 64, 2), Ipv4Addr::new(192, 168, 64, 3)];
const NAMES: [&str; 2] = ["left", "right"];

/// A station of the network.
#[expect(clippy::large_enum_variant, reason = "there are three of them")]
enum Station {
    Controller(Controller),
    Device(Device),
}

/// What a station reports; the AR if it is the controller.
type Reported = (Option<ArId>, LinkEvent);

macro_rules! each {
    ($station:ident, $machine:ident => $call:expr) => {
        match $station {
            Station::Controller($machine) => $call,
            Station::Device($machine) => $call,
        }
    };
}

impl Machine for Station {
    type Event = Reported;

    fn ports(&self) -> &[PortRequest] {
        each!(self, machine => machine.ports())
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        each!(self, machine => machine.handle_frame(now, from, frame));
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        each!(self, machine => Machine::neighbour(machine, address))
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        each!(self, machine => machine.handle_wrong_neighbour(now, address, found));
    }

    fn handle_timeout(&mut self, now: Instant) {
        each!(self, machine => machine.handle_timeout(now));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        each!(self, machine => machine.poll_transmit(now, buf))
    }

    fn poll_event(&mut self) -> Option<Reported> {
        match self {
            Self::Controller(controller) => controller.poll_event().map(|(ar, event)| (Some(ar), event)),
            Self::Device(device) => device.poll_event().map(|event| (None, event)),
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        each!(self, machine => machine.poll_timeout())
    }
}

struct Cell {
    network: Network<Station>,
    controller: NodeId,
    devices: [NodeId; 2],
    ars: [ArId; 2],
}

fn ar(index: usize, transport: Transport) -> ArConfig {
    ArConfig {
        station_name: NAMES[index].into(),
        mac: None,
        address: DEVICES[index],
        description: samples::DEVICE,
        parameters: Vec::new(),
        transport,
        cycle: Duration::from_millis(1 << index),
        watchdog_cycles: 10,
    }
}

impl Cell {
    /// Creates a controller of two devices: the first wants its data by `transports[0]` every 1 ms, the second by
    /// `transports[1]` every 2 ms.
    fn new(transports: [Transport; 2]) -> Self {
        let mut controller = Controller::new(ControllerConfig {
            mac: Mac([2, 0, 0, 0, 0, 1]),
            station_name: "controller".into(),
            address: CONTROLLER,
            mask: MASK,
            description: samples::CONTROLLER,
            seed: 1,
        })
        .unwrap();
        let ars = [0, 1].map(|index| {
            let id = controller.connect(ar(index, transports[index]), Instant::ZERO).unwrap();
            controller.ar_mut(id).unwrap().set_output(1, 1, &[0xA0 + index as u8; LEN]).unwrap();
            id
        });
        let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
        let devices = [0, 1].map(|index| {
            let config = DeviceConfig {
                mac: Mac([2, 0, 0, 0, 0, 2 + index as u8]),
                station_name: NAMES[index].into(),
                permanent: None,
                address: None,
                mask: MASK,
                description: samples::DEVICE,
                controllers: machine::Allowed::default(),
            };
            let mac = config.mac;
            let mut device = Device::new(config, Instant::ZERO);
            device.set_input(1, 1, &[0xD0 + index as u8; LEN]).unwrap();
            network.add_station(
                SwitchId::FIRST,
                "device",
                Station::Device(device),
                StationConfig::new(mac, None, CABLE),
            )
        });
        let station = Station::Controller(controller);
        let controller = network.add_station(
            SwitchId::FIRST,
            "controller",
            station,
            StationConfig::new(Mac([2, 0, 0, 0, 0, 1]), Some(CONTROLLER), CABLE),
        );
        Self { network, controller, devices, ars }
    }

    /// Runs for so many ms and returns what the controller reports meanwhile. A device gets the address that it is to have.
    fn run(&mut self, millis: u64) -> Vec<(ArId, LinkEvent)> {
        let until = self.network.now() + Duration::from_millis(millis);
        let mut reported = Vec::new();
        while let Some((station, (ar, event))) = self.network.next_event(until) {
            reported.extend(ar.map(|ar| (ar, event)));
            if let LinkEvent::SetAddress { address, .. } = event {
                self.network.set_address(station, InterfaceId::FIRST, Some(address));
                self.device(station, |device, now| device.address_set(now, true));
            }
        }
        reported
    }

    fn device<R>(&mut self, id: NodeId, command: impl FnOnce(&mut Device, Instant) -> R) -> R {
        let command = |station: &mut Station, now| match station {
            Station::Device(device) => command(device, now),
            Station::Controller(_) => panic!("{id:?} is the controller"),
        };
        self.network.command(id, command).unwrap()
    }

    fn controller<R>(&mut self, command: impl FnOnce(&mut Controller, Instant) -> R) -> R {
        let command = |station: &mut Station, now| match station {
            Station::Controller(controller) => command(controller, now),
            Station::Device(_) => panic!("the controller is one"),
        };
        self.network.command(self.controller, command).unwrap()
    }

    /// Returns the first byte of the input of each AR, and of the output of each device.
    fn data(&mut self) -> [[Option<u8>; 2]; 2] {
        let first = |data: Option<&[u8]>| data.map(|data| data[0]);
        let ars = self.ars;
        let inputs = self.controller(|controller, _| ars.map(|ar| first(controller.ar(ar)?.input(1, 1))));
        let outputs = self.devices.map(|id| self.device(id, |device, _| first(device.output(1, 1))));
        [inputs, outputs]
    }
}

const EACH_WAY: [[Transport; 2]; 3] =
    [[Transport::Rt1, Transport::Rt1], [Transport::Udp, Transport::Udp], [Transport::Rt1, Transport::Udp]];

const DATA: [[Option<u8>; 2]; 2] = [[Some(0xD0), Some(0xD1)], [Some(0xA0), Some(0xA1)]];

#[test]
fn two_devices_are_two_ars_of_one_controller_on_one_port_34964() {
    for transports in EACH_WAY {
        let mut cell = Cell::new(transports);
        let mut up = cell.run(400);
        up.sort_by_key(|(ar, _)| *ar);
        assert_eq!(up, cell.ars.map(|ar| (ar, LinkEvent::Up)), "{transports:?}");
        assert_eq!(cell.data(), DATA);
        assert_eq!(cell.run(1_000), []);
        let ars = cell.ars;
        let [fast, slow] = cell.controller(|controller, _| {
            assert_eq!(controller.ports(), profinet::PORTS);
            assert_eq!(controller.counters(), machine::Counters::default(), "no frame belongs to no AR");
            ars.map(|ar| controller.ar(ar).unwrap().counters())
        });
        assert!((1_130..=1_150).contains(&fast.received), "{fast:?}");
        assert!((565..=575).contains(&slow.received), "{slow:?}");
        assert_eq!((fast.lost, slow.lost, fast.foreign, slow.foreign), (0, 0, 0, 0));
    }
}

#[test]
fn a_device_that_ends_its_ar_is_connected_again_and_the_other_one_misses_nothing() {
    for transports in EACH_WAY {
        let mut cell = Cell::new(transports);
        cell.run(400);
        let second = cell.devices[1];
        cell.device(second, |device, now| device.disconnect(now));
        let events = cell.run(1_000);
        let [(first, LinkEvent::Down(down)), (again, LinkEvent::Up)] = events[..] else {
            panic!("{transports:?}: {events:?}")
        };
        assert_eq!([first, again], [cell.ars[1]; 2]);
        assert_eq!(down.cause, DownCause::ClosedByPeer);
        assert_eq!(cell.data(), DATA);
        let ar = cell.ars[0];
        let counters = cell.controller(|controller, _| controller.ar(ar).unwrap().counters());
        assert_eq!((counters.lost, counters.late), (0, 0));
    }
}

#[test]
fn an_ar_that_is_removed_makes_room_for_a_new_one() {
    let mut cell = Cell::new(EACH_WAY[0]);
    cell.run(400);
    let [first, second] = cell.ars;
    cell.controller(|controller, now| controller.ar_mut(second).unwrap().disconnect(now));
    let closed = cell.run(400);
    assert!(
        matches!(closed[..], [(ar, LinkEvent::Down(down))] if ar == second && down.cause == DownCause::ClosedHere),
        "{closed:?}"
    );
    let anew = cell.controller(|controller, now| {
        let removed = controller.remove(second);
        assert!(removed.is_some_and(|ar| !ar.is_up()) && controller.ar(second).is_none());
        let id = controller.connect(ar(1, Transport::Udp), now).unwrap();
        controller.ar_mut(id).unwrap().set_output(1, 1, &[0xA1; LEN]).unwrap();
        id
    });
    assert_eq!(cell.run(1_000), [(anew, LinkEvent::Up)]);
    cell.ars = [first, anew];
    assert_eq!(cell.data(), DATA);
    let all = cell.controller(|controller, _| controller.ars().filter(|(_, ar)| Ar::is_up(ar)).count());
    assert_eq!(all, 2);
}

#[test]
fn a_controller_names_each_ar_whose_data_have_arrived_once() {
    for transports in EACH_WAY {
        let mut cell = Cell::new(transports);
        cell.run(400);
        let received = |cell: &mut Cell| {
            cell.controller(|controller, _| {
                let mut ars: Vec<_> = core::iter::from_fn(|| controller.poll_received()).collect();
                ars.sort();
                ars
            })
        };
        assert_eq!(received(&mut cell), cell.ars);
        assert_eq!(received(&mut cell), []);
        cell.run(10);
        assert_eq!(received(&mut cell), cell.ars, "{transports:?}");
    }
}
