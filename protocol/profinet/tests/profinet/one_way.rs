//! Devices with data in one direction only: both sides report that they are up.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent};
use profinet::description::{Description, Module, Submodule};
use profinet::rt::Transport;
use profinet::{ArConfig, Controller, ControllerConfig, Device, DeviceConfig};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

use crate::samples;

const CONTROLLER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const DEVICE: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

const fn submodule(ident: u32, input_len: u16, output_len: u16) -> Submodule {
    Submodule { subslot: 1, ident, input_len, output_len, parameters: &[] }
}

const ACCESS_POINT: Module = Module { slot: 0, ident: 1, submodules: &[submodule(1, 0, 0)] };

const INPUTS: Description = Description {
    modules: &[ACCESS_POINT, Module { slot: 1, ident: 2, submodules: &[submodule(2, 2, 0)] }],
    ..samples::DEVICE
};

const OUTPUTS: Description = Description {
    modules: &[ACCESS_POINT, Module { slot: 1, ident: 3, submodules: &[submodule(3, 0, 2)] }],
    ..samples::DEVICE
};

const NO_DATA: Description = Description { modules: &[ACCESS_POINT], ..samples::DEVICE };

/// Returns who has reported that it is up after 100 ms, the controller's input and the device's output.
fn run(description: Description, transport: Transport) -> ([bool; 2], Option<Vec<u8>>, Option<Vec<u8>>) {
    let mut controller = Controller::new(ControllerConfig {
        mac: Mac([2, 0, 0, 0, 0, 1]),
        station_name: "controller".into(),
        address: CONTROLLER,
        mask: MASK,
        description: samples::CONTROLLER,
        seed: 1,
    })
    .unwrap();
    let config = ArConfig {
        station_name: "device".into(),
        mac: None,
        address: DEVICE,
        description,
        parameters: Vec::new(),
        transport,
        cycle: Duration::from_millis(1),
        watchdog_cycles: 3,
    };
    let ar = controller.connect(config, Instant::ZERO).unwrap();
    let mut device = Device::new(
        DeviceConfig {
            mac: Mac([2, 0, 0, 0, 0, 2]),
            station_name: b"device".to_vec(),
            permanent: None,
            address: Some(DEVICE),
            mask: MASK,
            description,
            controllers: machine::Allowed::default(),
        },
        Instant::ZERO,
    );
    // Each is refused where there are no data of its direction.
    let _ = controller.ar_mut(ar).unwrap().set_output(1, 1, &[3, 4]);
    let _ = device.set_input(1, 1, &[1, 2]);
    let cable = Impairment { delay: Duration::from_micros(25), ..Impairment::default() };
    let addresses = [Some(CONTROLLER), Some(DEVICE)];
    let config = PairConfig { seed: 1, clocks: [Clock::default(); 2], links: [cable; 2], addresses };
    let mut pair = Pair::new(controller, device, config);
    let mut up = [false; 2];
    while let Some(event) = pair.next_event(Instant::from_millis(400)) {
        match event {
            Event::A((_, event)) => up[0] = event == LinkEvent::Up,
            Event::B(event) => up[1] = event == LinkEvent::Up,
        }
    }
    let input = pair.a().ar(ar).unwrap().input(1, 1).map(<[u8]>::to_vec);
    (up, input, pair.b().output(1, 1).map(<[u8]>::to_vec))
}

#[test]
fn a_device_with_inputs_only_and_one_with_outputs_only_are_up_on_both_sides() {
    for transport in [Transport::Rt1, Transport::Udp] {
        assert_eq!(run(INPUTS, transport), ([true; 2], Some(vec![1, 2]), None), "{transport:?}");
        assert_eq!(run(OUTPUTS, transport), ([true; 2], None, Some(vec![3, 4])), "{transport:?}");
        assert_eq!(run(NO_DATA, transport), ([true; 2], None, None), "{transport:?}");
    }
}
