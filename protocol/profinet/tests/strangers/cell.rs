//! An IO-Controller and an IO-Device on a switch, watched: alone, or beside a stranger.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Allowed, Duration, Instant, LinkEvent, Peer};
use profinet::rt::Transport;
use profinet::{ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig, Parameter};
use virtual_time::hostile::{Choices, Member, MemberEvent, STRANGER, STRANGER_MAC, Sent, Stranger, Watched};
use virtual_time::{Network, StationId};

use super::samples::{self, LEN};

/// MAC and IP addresses of the pair.
pub(crate) const STATIONS: [(Mac, Ipv4Addr); 2] = [
    (Mac([2, 0, 0, 0, 0, 1]), Ipv4Addr::new(192, 168, 64, 1)),
    (Mac([2, 0, 0, 0, 0, 2]), Ipv4Addr::new(192, 168, 64, 2)),
];
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

type Station<C> = Member<Controller, Device, C>;
/// An event of the controller or of the device, and when.
pub(crate) type Reported = (Instant, MemberEvent<LinkEvent, LinkEvent>);

/// The pair on its switch, and a place for a stranger.
pub(crate) struct Cell<C: Choices> {
    network: Network<Station<C>>,
    controller: StationId,
    device: StationId,
    ar: ArId,
    events: Vec<Reported>,
    /// Data that arrived, one entry a millisecond: the first byte at the controller and at the device.
    images: Vec<[Option<u8>; 2]>,
}

/// When what happens in the life of the pair.
#[derive(Clone, Copy)]
pub(crate) struct Phases {
    /// Data are exchanged by then; from now on nothing of a stranger may cost heap memory.
    pub(crate) up: Instant,
    /// The pair parts.
    pub(crate) parting: Instant,
    /// The end.
    pub(crate) end: Instant,
}

/// What a run left behind.
#[derive(PartialEq)]
pub(crate) struct Record {
    /// Bytes and instants of each side's frames.
    pub(crate) sent: [Vec<Sent>; 2],
    /// What both reported.
    pub(crate) events: Vec<Reported>,
    /// Data that arrived, one entry a millisecond: the first byte at each side.
    pub(crate) images: Vec<[Option<u8>; 2]>,
}

impl<C: Choices> Cell<C> {
    /// Creates a pair whose stations know each other by address if `listed`.
    pub(crate) fn new(transport: Transport, listed: bool, allocations: fn() -> u64) -> Self {
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

    /// Connects, exchanges data, parts, and waits; returns what was sent and reported, and how many frames of a stranger each
    /// side got.
    pub(crate) fn whole_life(mut self, stranger: Option<Stranger<C>>, phases: Phases) -> (Record, [u64; 2]) {
        if let Some(stranger) = stranger {
            let (mac, address) = (STRANGER_MAC, STRANGER);
            self.network.add(Member::Stranger(stranger), mac, Some(address));
        }
        self.run(phases.up);
        let before = [self.controller(|c, _| c.allocations), self.device(|d, _| d.allocations)];
        self.run(phases.parting);
        let after = [self.controller(|c, _| c.allocations), self.device(|d, _| d.allocations)];
        assert_eq!(after, before, "allocations for frames of a stranger while data are exchanged");
        let foreign = [self.controller(|c, _| c.foreign), self.device(|d, _| d.foreign)];
        let ar = self.ar;
        self.controller(|controller, now| controller.machine.ar_mut(ar).map(|ar| ar.disconnect(now)));
        self.run(phases.end);
        let sent = [
            self.controller(|c, _| core::mem::take(&mut c.sent)),
            self.device(|d, _| core::mem::take(&mut d.sent)),
        ];
        (Record { sent, events: self.events, images: self.images }, foreign)
    }

    /// Lives beside a station that sends from the addresses of one of the pair. Whether it ends the connection is not judged.
    pub(crate) fn forged_life(
        mut self,
        stranger: Stranger<C>,
        (mac, address): (Mac, Ipv4Addr),
        end: Instant,
    ) {
        self.network.add(Member::Stranger(stranger.forging(mac)), mac, Some(address));
        self.run(end);
    }
}

/// Returns the first frame that differs.
pub(crate) fn difference(alone: &Record, disturbed: &Record) -> String {
    for (side, name) in ["controller", "device"].into_iter().enumerate() {
        let pairs = alone.sent[side].iter().zip(&disturbed.sent[side]);
        if let Some((one, other)) = pairs.into_iter().find(|(one, other)| one != other) {
            return format!("the {name} sent\n{other:02x?}\ninstead of\n{one:02x?}");
        }
    }
    let (one, other) = (alone.sent.each_ref().map(Vec::len), disturbed.sent.each_ref().map(Vec::len));
    format!("{one:?} and {other:?} frames; events {:?} instead of {:?}", disturbed.events, alone.events)
}
