//! Who is at the other end: stations that share a name or an address, on one switch, with hosts whose tables of neighbours do
//! not age.

use std::net::Ipv4Addr;

use machine::arp::{AddressClaim, AddressConflict, ClaimEvent};
use machine::ethernet::Mac;
use machine::{
    DownCause, Duration, Instant, InterfaceId, LinkEvent, Machine, PortRequest, Source, StationConflict,
    Transmit,
};
use profinet::rt::Transport;
use profinet::{ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig};
use virtual_time::{Network, NodeId, StationConfig, SwitchConfig, SwitchId};

use crate::samples::{self, LEN};

/// Delay of the cable of each station: between two a frame takes twice as long.
const CABLE: Duration = Duration::from_nanos(20_000);

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const PLC: Ipv4Addr = Ipv4Addr::new(10, 7, 3, 1);
const ROBOT: Ipv4Addr = Ipv4Addr::new(10, 7, 3, 9);
const MACS: [Mac; 4] = [mac(1), mac(2), mac(3), mac(4)];
const BOTH: [Transport; 2] = [Transport::Udp, Transport::Rt1];

const fn mac(last: u8) -> Mac {
    Mac([2, 0, 0, 7, 0, last])
}

#[expect(clippy::large_enum_variant, reason = "there are four of them")]
enum Station {
    Controller(Controller),
    Device(Device),
    /// A station that uses an address and speaks no bus.
    Stranger(AddressClaim),
}

macro_rules! each {
    ($station:ident, $machine:ident => $call:expr) => {
        match $station {
            Station::Controller($machine) => $call,
            Station::Device($machine) => $call,
            Station::Stranger($machine) => $call,
        }
    };
}

impl Machine for Station {
    type Event = LinkEvent;

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

    fn poll_event(&mut self) -> Option<LinkEvent> {
        match self {
            Self::Controller(controller) => controller.poll_event().map(|(_, event)| event),
            Self::Device(device) => device.poll_event(),
            Self::Stranger(claim) => {
                while let Some(event) = claim.poll_event() {
                    assert!(matches!(event, ClaimEvent::Conflict(_)), "{event:?}");
                }
                None
            }
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        each!(self, machine => machine.poll_timeout())
    }
}

struct Cell {
    network: Network<Station>,
    controller: NodeId,
    ar: ArId,
    /// What the controller reported, and when.
    reported: Vec<(Instant, LinkEvent)>,
    /// What each other station reported.
    others: Vec<(NodeId, LinkEvent)>,
}

impl Cell {
    /// Creates a controller that looks for the station `arm`.
    fn new(transport: Transport, mac: Option<Mac>) -> Self {
        let mut controller = Controller::new(ControllerConfig {
            mac: MACS[0],
            station_name: "line".into(),
            address: PLC,
            mask: MASK,
            description: samples::CONTROLLER,
            seed: 7,
        })
        .unwrap();
        let config = ArConfig {
            station_name: "arm".into(),
            mac,
            address: ROBOT,
            description: samples::DEVICE,
            parameters: Vec::new(),
            transport,
            cycle: Duration::from_millis(1),
            watchdog_cycles: 20,
        };
        let ar = controller.connect(config, Instant::ZERO).unwrap();
        controller.ar_mut(ar).unwrap().set_output(1, 1, &[0xA0; LEN]).unwrap();
        let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
        let controller = network.add_station(
            SwitchId::FIRST,
            "controller",
            Station::Controller(controller),
            StationConfig::new(MACS[0], Some(PLC), CABLE),
        );
        Self { network, controller, ar, reported: Vec::new(), others: Vec::new() }
    }

    fn device(&mut self, mac: Mac, name: &str, address: Option<Ipv4Addr>) -> NodeId {
        let config = DeviceConfig {
            mac,
            station_name: name.into(),
            permanent: None,
            address,
            mask: MASK,
            description: samples::DEVICE,
            controllers: machine::Allowed::default(),
        };
        let mut device = Device::new(config, self.network.now());
        device.set_input(1, 1, &[mac.0[5]; LEN]).unwrap();
        self.network.add_station(
            SwitchId::FIRST,
            "device",
            Station::Device(device),
            StationConfig::new(mac, address, CABLE),
        )
    }

    fn stranger(&mut self, mac: Mac, address: Ipv4Addr) -> NodeId {
        let mut claim = AddressClaim::new(mac);
        claim.claim(self.network.now(), address);
        self.network.add_station(
            SwitchId::FIRST,
            "stranger",
            Station::Stranger(claim),
            StationConfig::new(mac, Some(address), CABLE),
        )
    }

    fn run(&mut self, millis: u64) {
        let until = self.network.now() + Duration::from_millis(millis);
        while let Some((station, event)) = self.network.next_event(until) {
            if let LinkEvent::SetAddress { address, .. } = event {
                self.network.set_address(
                    station,
                    InterfaceId::FIRST,
                    Some(address).filter(|it| !it.is_unspecified()),
                );
                self.network.command(station, |station, now| match station {
                    Station::Device(device) => device.address_set(now, true),
                    _ => panic!("only a device has its address from others"),
                });
            } else if station == self.controller {
                self.reported.push((self.network.now(), event));
            } else {
                self.others.push((station, event));
            }
        }
    }

    fn of<R>(&self, id: NodeId, of: impl FnOnce(&Device) -> R) -> R {
        match self.network.machine(id) {
            Some(Station::Device(device)) => of(device),
            _ => panic!("{id:?} is a device"),
        }
    }

    /// Returns whether a station has ever been connected to.
    fn is_untouched(&self, id: NodeId) -> bool {
        self.of(id, |device| !device.has_controller() && device.counters().received == 0)
            && !self.others.iter().any(|(other, event)| *other == id && *event == LinkEvent::Up)
    }

    fn ups(&self) -> Vec<Instant> {
        self.reported.iter().filter(|(_, event)| *event == LinkEvent::Up).map(|(at, _)| *at).collect()
    }

    fn refusals(&self) -> Vec<&'static str> {
        let refused = self.reported.iter().filter_map(|(_, event)| match event {
            LinkEvent::Down(down) if down.cause == DownCause::Refused => Some(down.text),
            _ => None,
        });
        refused.collect()
    }

    fn explanation(&self) -> String {
        let Some(Station::Controller(controller)) = self.network.machine(self.controller) else { panic!() };
        let mut words = String::new();
        controller.ar(self.ar).unwrap().explain(&mut words).unwrap();
        words
    }

    /// Returns the first byte of the controller's input.
    fn input(&self) -> Option<u8> {
        let Some(Station::Controller(controller)) = self.network.machine(self.controller) else { panic!() };
        controller.ar(self.ar)?.input(1, 1).map(|data| data[0])
    }
}

#[test]
fn a_robot_that_kept_the_address_is_neither_connected_to_nor_sent_data() {
    for transport in BOTH {
        for (wanted, may_correct) in [(None, true), (Some(MACS[2]), true), (None, false)] {
            let mut cell = Cell::new(transport, wanted);
            let old = cell.device(MACS[1], "old-arm", Some(ROBOT));
            let new = cell.device(MACS[2], "arm", None);
            let controller = cell.controller;
            cell.network.set_may_correct(controller, InterfaceId::FIRST, may_correct);
            cell.run(5_000);
            assert!(cell.is_untouched(old) && cell.is_untouched(new), "{transport:?} {wanted:?}");
            let [text] = cell.refusals()[..] else { panic!("{:?}", cell.reported) };
            assert!(text.starts_with("another station has this IP address"), "{text}");
            let words = cell.explanation();
            let macs = [MACS[1], MACS[2]].map(|mac| words.contains(&mac.to_string()));
            assert_eq!((macs, words.contains("10.7.3.9")), ([true; 2], true), "{words}");
            // The old one is switched off: now the new one gets the address and is connected to.
            cell.network.kill(old);
            cell.run(1_000);
            assert_eq!((cell.ups().len(), cell.input()), (1, Some(3)), "{:?}", cell.reported);
        }
    }
}

#[test]
fn of_two_stations_with_one_name_neither_is_addressed_and_both_are_named_as_long_as_both_are_there() {
    for transport in BOTH {
        for addresses in [[None, None], [Some(ROBOT), None], [None, Some(Ipv4Addr::new(10, 7, 3, 50))]] {
            let mut cell = Cell::new(transport, None);
            let twins = [1, 2].map(|index: usize| cell.device(MACS[index], "arm", addresses[index - 1]));
            cell.run(10_000);
            assert!(twins.iter().all(|twin| cell.is_untouched(*twin)), "{transport:?} {addresses:?}");
            assert_eq!(cell.refusals().len(), 1, "said once: {:?}", cell.reported);
            let words = cell.explanation();
            assert!(words.starts_with("two stations answer to the device's name"), "{words}");
            assert!([MACS[1], MACS[2]].iter().all(|mac| words.contains(&mac.to_string())), "{words}");
            cell.network.kill(twins[0]);
            cell.run(2_000);
            assert_eq!((cell.ups().len(), cell.input()), (1, Some(3)), "{:?}", cell.reported);
        }
    }
}

#[test]
fn with_its_mac_address_the_right_one_of_two_is_used_and_the_other_named_once_counted_and_not_addressed() {
    for transport in BOTH {
        for wanted in [1, 2] {
            let mut cell = Cell::new(transport, Some(MACS[wanted]));
            let twins = [1, 2].map(|index: usize| cell.device(MACS[index], "arm", None));
            cell.run(3_000);
            let ignored = MACS[3 - wanted];
            let conflict = StationConflict::Name { device: MACS[wanted], ignored };
            let events: Vec<_> = cell.reported.iter().map(|(_, event)| *event).collect();
            assert_eq!(events.len(), 2, "{events:?}");
            assert!(events.contains(&LinkEvent::Up) && events.contains(&LinkEvent::Conflict(conflict)));
            assert!(cell.is_untouched(twins[2 - wanted]) && cell.others.len() == 1, "{:?}", cell.others);
            assert_eq!(cell.input(), Some(MACS[wanted].0[5]));
        }
    }
}

#[test]
fn from_the_first_answer_of_a_device_to_data_it_takes_400_ms_at_most() {
    for transport in BOTH {
        for address in [None, Some(ROBOT), Some(Ipv4Addr::new(10, 7, 3, 77))] {
            for wanted in [None, Some(MACS[1])] {
                // Whenever in a window the device comes up.
                for start in [0, 1, 90, 199, 200, 333] {
                    let mut cell = Cell::new(transport, wanted);
                    cell.run(start);
                    let _ = cell.device(MACS[1], "arm", address);
                    // The next Identify is at the next multiple of 200 ms, and is answered at once.
                    let answered = Instant::from_millis((start + 1).next_multiple_of(200));
                    cell.run(1_000);
                    let [up] = cell.ups()[..] else { panic!("{:?}", cell.reported) };
                    let took = up.since(answered);
                    assert!(
                        took <= Duration::from_millis(400),
                        "{transport:?} {address:?} {start}: {took:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_device_that_is_replaced_by_another_one_of_its_name_has_data_within_1_s() {
    for transport in BOTH {
        // Without the right to correct the table of neighbours, the device's announcement does it.
        for may_correct in [true, false] {
            // The new one comes at once, or while the controller searches, or pauses, or calls the old one.
            for gap in [0, 5, 19, 25, 60, 130, 300, 1_000, 2_500, 10_000] {
                let mut cell = Cell::new(transport, None);
                let controller = cell.controller;
                cell.network.set_may_correct(controller, InterfaceId::FIRST, may_correct);
                let old = cell.device(MACS[1], "arm", None);
                cell.run(2_000);
                assert_eq!(cell.input(), Some(2));
                cell.network.kill(old);
                cell.run(gap);
                cell.device(MACS[2], "arm", None);
                let replaced = cell.network.now();
                cell.run(3_000);
                let ups = cell.ups();
                let took = ups.get(1).map(|up| up.since(replaced));
                let in_time = took.is_some_and(|took| took <= Duration::from_secs(1));
                assert!(in_time, "{transport:?} {may_correct} {gap}: {took:?} {:?}", cell.reported);
                assert_eq!(cell.input(), Some(3));
            }
        }
    }
}

#[test]
fn a_device_that_is_replaced_while_it_does_not_answer_a_connect_has_data_within_1_s() {
    for transport in BOTH {
        for gap in [201, 262, 300, 900, 2_000] {
            let mut cell = Cell::new(transport, None);
            let old = cell.device(MACS[1], "arm", Some(ROBOT));
            // It has answered by DCP and by ARP, and is gone before the Connect, at 200 ms.
            cell.run(199);
            cell.network.kill(old);
            cell.run(gap - 199);
            cell.device(MACS[2], "arm", Some(ROBOT));
            cell.run(1_000);
            assert_eq!(
                (cell.ups().len(), cell.input()),
                (1, Some(3)),
                "{transport:?} {gap}: {:?}",
                cell.reported
            );
        }
    }
}

#[test]
fn whoever_takes_the_address_of_the_robot_or_of_the_controller_later_ends_the_connection_and_is_named_at_both_ends()
 {
    for transport in BOTH {
        for address in [ROBOT, PLC] {
            let mut cell = Cell::new(transport, None);
            let robot = cell.device(MACS[1], "arm", None);
            cell.run(1_000);
            assert_eq!(cell.input(), Some(2));
            let stranger = cell.stranger(MACS[3], address);
            cell.run(5_000);
            let conflict = StationConflict::Address(AddressConflict { address, mac: MACS[3] });
            let reported: Vec<_> = cell.reported.iter().map(|(_, event)| *event).collect();
            assert!(
                reported.contains(&LinkEvent::Conflict(conflict)),
                "{transport:?} {address}: {reported:?}"
            );
            let [text] = cell.refusals()[..] else { panic!("{reported:?}") };
            assert!(text.starts_with("another station has this IP address"), "{text}");
            assert!(cell.explanation().contains(&MACS[3].to_string()), "{}", cell.explanation());
            assert_eq!(cell.input(), None);
            assert!(cell.others.contains(&(robot, LinkEvent::Conflict(conflict))), "{:?}", cell.others);
            cell.network.kill(stranger);
            cell.run(2_000);
            assert_eq!(
                (cell.ups().len(), cell.input()),
                (2, Some(2)),
                "{transport:?} {address}: {:?}",
                cell.reported
            );
        }
    }
}

#[test]
fn an_address_that_a_stranger_has_is_found_before_it_is_set_and_the_device_does_not_take_it_either() {
    let mut cell = Cell::new(Transport::Udp, None);
    cell.stranger(MACS[3], ROBOT);
    let robot = cell.device(MACS[1], "arm", None);
    cell.run(3_000);
    assert!(cell.is_untouched(robot));
    assert_eq!(cell.others, [], "nothing was set");
    assert!(cell.explanation().contains(&MACS[3].to_string()));
}
