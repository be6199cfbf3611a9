//! A controller and any number of devices on one switch.

use std::net::Ipv4Addr;

use machine::arp::ArpPacket;
use machine::ethernet::{EthernetHeader, Mac};
use machine::{
    Counters, Duration, Instant, InterfaceId, LinkEvent, Machine, Port, PortRequest, Source, Transmit,
};
use profinet::rt::Transport;
use profinet::{ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig, ETHER_TYPE, dcp};
use virtual_time::{Network, NodeId, StationConfig, SwitchConfig, SwitchId};

use crate::samples::{self, LEN};

/// Half of what a frame takes from one station to another, since the switch takes no time.
const CABLE: Duration = Duration::from_nanos(12_500);

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const CONTROLLER: (Mac, Ipv4Addr) = (Mac([2, 0, 0, 0, 0, 1]), Ipv4Addr::new(192, 168, 64, 1));

/// What a stranger sends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Stranger {
    /// Cyclic data with the FrameID of an AR, from another station.
    OtherMac,
    /// Cyclic data of a device, with a FrameID of no AR.
    OtherFrameId,
    /// An answer to a search that nobody began.
    OtherXid,
    /// A question by ARP.
    Arp,
}

/// A station of the network.
#[expect(clippy::large_enum_variant, reason = "a test")]
enum Station {
    Controller(Controller),
    Device(Device),
}

macro_rules! each {
    ($station:ident, $machine:ident => $call:expr) => {
        match $station {
            Station::Controller($machine) => $call,
            Station::Device($machine) => $call,
        }
    };
}

impl Machine for Station {
    type Event = (Option<ArId>, LinkEvent);

    fn ports(&self) -> &[PortRequest] {
        each!(self, machine => machine.ports())
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        each!(self, machine => machine.handle_frame(now, from, frame));
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        each!(self, machine => Machine::neighbour(machine, address))
    }

    fn handle_timeout(&mut self, now: Instant) {
        each!(self, machine => machine.handle_timeout(now));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        each!(self, machine => machine.poll_transmit(now, buf))
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        match self {
            Self::Controller(controller) => controller.poll_event().map(|(ar, event)| (Some(ar), event)),
            Self::Device(device) => device.poll_event().map(|event| (None, event)),
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        each!(self, machine => machine.poll_timeout())
    }
}

pub(crate) struct Cell {
    network: Network<Station>,
    controller: NodeId,
    devices: Vec<NodeId>,
    ars: Vec<ArId>,
}

fn station(device: usize) -> (Mac, Ipv4Addr) {
    let number = 2 + device as u8;
    (Mac([2, 0, 0, 0, 0, number]), Ipv4Addr::new(192, 168, 64, number))
}

impl Cell {
    /// Creates a controller and devices that exchange data every 1 ms: inputs are the device's number, outputs its complement.
    pub(crate) fn new(devices: usize, transport: Transport) -> Self {
        let (mac, address) = CONTROLLER;
        let mut controller = Controller::new(ControllerConfig {
            mac,
            station_name: "controller".into(),
            address,
            mask: MASK,
            description: samples::CONTROLLER,
            seed: 1,
        })
        .unwrap();
        let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
        let mut cell_ars = Vec::new();
        let mut stations = Vec::new();
        for device in 0..devices {
            let (mac, address) = station(device);
            let config = ArConfig {
                station_name: format!("device-{device}"),
                mac: None,
                address,
                description: samples::DEVICE,
                parameters: Vec::new(),
                transport,
                cycle: Duration::from_millis(1),
                watchdog_cycles: 10,
            };
            let id = controller.connect(config, Instant::ZERO).unwrap();
            controller.ar_mut(id).unwrap().set_output(1, 1, &[!device as u8; LEN]).unwrap();
            cell_ars.push(id);
            let config = DeviceConfig {
                mac,
                station_name: format!("device-{device}").into(),
                permanent: None,
                address: None,
                mask: MASK,
                description: samples::DEVICE,
                controllers: machine::Allowed::default(),
            };
            let mut machine = Device::new(config, Instant::ZERO);
            machine.set_input(1, 1, &[device as u8; LEN]).unwrap();
            stations.push(network.add_station(
                SwitchId::FIRST,
                "device",
                Station::Device(machine),
                StationConfig::new(mac, None, CABLE),
            ));
        }
        let controller = network.add_station(
            SwitchId::FIRST,
            "controller",
            Station::Controller(controller),
            StationConfig::new(mac, Some(address), CABLE),
        );
        Self { network, controller, devices: stations, ars: cell_ars }
    }

    /// Runs for so many ms and returns what the controller reports meanwhile, by device. A device gets the address that it is
    /// to have.
    pub(crate) fn run(&mut self, millis: u64) -> Vec<(usize, LinkEvent)> {
        let until = self.network.now() + Duration::from_millis(millis);
        let mut reported = Vec::new();
        while let Some((station, (ar, event))) = self.network.next_event(until) {
            let device = ar.and_then(|ar| self.ars.iter().position(|known| *known == ar));
            reported.extend(device.map(|device| (device, event)));
            if let LinkEvent::SetAddress { address, .. } = event {
                self.network.set_address(station, InterfaceId::FIRST, Some(address));
                let command = |station: &mut Station, now| match station {
                    Station::Device(device) => device.address_set(now, true),
                    Station::Controller(_) => panic!("the controller has its address"),
                };
                self.network.command(station, command).unwrap();
            }
        }
        reported
    }

    fn controller<R>(&mut self, command: impl FnOnce(&mut Controller, Instant) -> R) -> R {
        let command = |station: &mut Station, now| match station {
            Station::Controller(controller) => command(controller, now),
            Station::Device(_) => panic!("the controller is one"),
        };
        self.network.command(self.controller, command).unwrap()
    }

    fn device<R>(&mut self, device: usize, command: impl FnOnce(&mut Device, Instant) -> R) -> R {
        let command = |station: &mut Station, now| match station {
            Station::Device(device) => command(device, now),
            Station::Controller(_) => panic!("a device"),
        };
        self.network.command(self.devices[device], command).unwrap()
    }

    /// Returns the first byte of the input and of the output of a device.
    pub(crate) fn data(&mut self, device: usize) -> (Option<u8>, Option<u8>) {
        let first = |data: Option<&[u8]>| data.map(|data| data[0]);
        let ar = self.ars[device];
        let input = self.controller(|controller, _| first(controller.ar(ar)?.input(1, 1)));
        (input, self.device(device, |device, _| first(device.output(1, 1))))
    }

    pub(crate) fn counters(&mut self, device: usize) -> Counters {
        let ar = self.ars[device];
        self.controller(|controller, _| controller.ar(ar).unwrap().counters())
    }

    /// Returns how many frames belonged to no AR.
    pub(crate) fn foreign(&mut self) -> u64 {
        self.controller(|controller, _| controller.counters().foreign)
    }

    pub(crate) fn disconnect(&mut self, device: usize) {
        self.device(device, |device, now| device.disconnect(now));
    }

    /// Lets a stranger's frame arrive at the controller.
    pub(crate) fn stranger(&mut self, stranger: Stranger) {
        let (mac, _) = CONTROLLER;
        let unknown = Mac([2, 0, 0, 0, 9, 9]);
        let header = |source| EthernetHeader { destination: mac, source, tag: None, ether_type: ETHER_TYPE };
        let mut frame = [0; 128];
        let len = match stranger {
            Stranger::OtherMac => {
                header(unknown).emit(&mut frame, |writer| writer.bytes(&[0x80, 0, 1, 2, 3]))
            }
            Stranger::OtherFrameId => {
                header(station(3).0).emit(&mut frame, |writer| writer.bytes(&[0xBF, 0, 1, 2, 3]))
            }
            Stranger::OtherXid => header(unknown).emit(&mut frame, |writer| {
                dcp::emit(writer, dcp::Service::IdentifyResponse, 0xDEAD_BEEF, 0, []);
            }),
            Stranger::Arp => {
                let asks = Ipv4Addr::new(192, 168, 64, 200);
                let packet = ArpPacket::question(unknown, asks, Ipv4Addr::new(192, 168, 64, 201));
                Ok(packet.emit_frame(&mut frame).unwrap())
            }
        };
        let len = len.unwrap();
        let from = Source { port: Port::Ethernet, peer: None };
        self.controller(|controller, now| controller.handle_frame(now, from, &frame[..len]));
    }
}
