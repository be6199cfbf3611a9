//! An IO-Controller and an IO-Device on a switch, watched: alone, or beside a stranger.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Allowed, Duration, Instant, Peer};
use profinet::rt::Transport;
use profinet::{ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig, Parameter};
use virtual_time::hostile::{Choices, PairRun, PairStation, StationPair};

use super::samples::{self, LEN};

/// MAC and IP addresses of the pair.
pub(crate) const STATIONS: [(Mac, Ipv4Addr); 2] = [
    (Mac([2, 0, 0, 0, 0, 1]), Ipv4Addr::new(192, 168, 64, 1)),
    (Mac([2, 0, 0, 0, 0, 2]), Ipv4Addr::new(192, 168, 64, 2)),
];
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// A controller and its device, by their AR.
pub(crate) struct ControllerAndDevice(ArId);

impl ControllerAndDevice {
    /// Creates a pair whose stations know each other by address if `listed`.
    pub(crate) fn new<C: Choices>(
        transport: Transport,
        listed: bool,
        allocations: fn() -> u64,
    ) -> PairRun<Self, C> {
        let [(controller_mac, plc), (device_mac, robot)] = STATIONS;
        let listed_peer = Peer { address: Some(plc), mac: Some(controller_mac), serial_number: None };
        let config = ControllerConfig {
            mac: controller_mac,
            station_name: "controller".into(),
            address: plc,
            mask: MASK,
            description: samples::CONTROLLER,
            seed: 1,
        };
        let mut controller = Controller::new(config).expect("a valid configuration");
        let config = ArConfig {
            station_name: "device".into(),
            mac: listed.then_some(device_mac),
            address: robot,
            description: samples::DEVICE,
            parameters: vec![Parameter::interface_adjust()],
            transport,
            cycle: Duration::from_millis(1),
            watchdog_cycles: 10,
        };
        let ar = controller.connect(config, Instant::ZERO).expect("a valid configuration");
        let config = DeviceConfig {
            mac: device_mac,
            station_name: b"device".to_vec(),
            permanent: None,
            address: None,
            mask: MASK,
            description: samples::DEVICE,
            controllers: Allowed(if listed { vec![listed_peer] } else { Vec::new() }),
        };
        let device = Device::new(config, Instant::ZERO);
        let controller = PairStation { machine: controller, mac: controller_mac, address: Some(plc) };
        let device = PairStation { machine: device, mac: device_mac, address: None };
        PairRun::new(Self(ar), controller, device, allocations)
    }
}

impl StationPair for ControllerAndDevice {
    type Id = ArId;
    type A = Controller;
    type B = Device;
    const NAMES: [&'static str; 2] = ["controller", "device"];
    const ASKS_FOR_ADDRESS: bool = true;

    fn exchange_a(&self, controller: &mut Controller, value: u8) -> Option<u8> {
        let ar = controller.ar_mut(self.0)?;
        ar.set_output(1, 1, &[value; LEN]).expect("256 bytes");
        ar.input(1, 1).map(|data| data[0])
    }

    fn exchange_b(&self, device: &mut Device, value: u8) -> Option<u8> {
        device.set_input(1, 1, &[value; LEN]).expect("256 bytes");
        device.output(1, 1).map(|data| data[0])
    }

    fn disconnect(&self, controller: &mut Controller, now: Instant) {
        if let Some(ar) = controller.ar_mut(self.0) {
            ar.disconnect(now);
        }
    }

    fn address_set(&self, device: &mut Device, now: Instant) {
        device.address_set(now, true);
    }
}
