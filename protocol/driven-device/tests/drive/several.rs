//! Several devices of one bus under one controller, by their names.

use std::net::Ipv4Addr;

use driven_device::{DriveConfig, DriveEvent, DrivenBus, DrivenDevice, FileDevice};
use emulated_device::{DeviceEvent, DeviceScript, EmulatedDevice, EmulationConfig};
use machine::ethernet::Mac;
use machine::{Duration, Instant, InterfaceId, LinkEvent};
use virtual_time::{CableId, Clock, Either, Event, Impairment, Network, NodeId, Plug, SwitchConfig};

use crate::cell::{
    CONTROLLER, Chosen, EDS, ESI, GSDML, bus_config, chosen, devices, drive_config, emulation_config,
    file_device,
};

/// A controller and its devices on a switch, or on an EtherCAT line.
struct Several {
    network: Network<Either<DrivenBus, EmulatedDevice>>,
    controller: NodeId,
    devices: Vec<(NodeId, CableId)>,
    events: Vec<(usize, DriveEvent)>,
}

const fn address(number: u8) -> Ipv4Addr {
    Ipv4Addr::new(192, 168, 64, 10 + number)
}

impl Several {
    /// Connects a controller to emulated devices, each with a script.
    fn new(driven: Vec<FileDevice>, emulated: &[(&Chosen, &str)]) -> Self {
        let bus = DrivenBus::new(driven, &bus_config(), Instant::ZERO).unwrap();
        let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
        let line = network.add_line();
        let plug = if bus.bus() == "EtherCAT" { line } else { virtual_time::SwitchId::FIRST };
        // Devices of an EtherCAT line take every frame.
        let mac = |last: u8| (plug != line).then_some(Mac([2, 0, 0, 0, 0, last]));
        let mut add = |name: &str, machine, mac, address| {
            let node = network.add_node(name, machine, Clock::default());
            let nic = network.add_nic(node, &[InterfaceId::FIRST], mac, Some(address));
            let ends = [Plug::Nic(nic), Plug::Switch(plug)];
            (node, network.connect(ends, [Impairment::default(); 2]).unwrap())
        };
        let (controller, _) = add("controller", Either::A(bus), mac(1), CONTROLLER);
        let devices = emulated.iter().enumerate().map(|(number, (chosen, script))| {
            let number = number as u8;
            let config = EmulationConfig {
                mac: Mac([2, 0, 0, 0, 0, 0x10 + number]),
                address: Some(address(number)),
                station_name: Some(format!("io-{number}").into_bytes()),
                serial_number: 7 + u32::from(number),
                first_id: 1 + (u32::from(number) << 16),
                ..emulation_config()
            };
            let script = DeviceScript::from_toml(script).unwrap();
            let device = EmulatedDevice::new(chosen.device.clone(), script, config, Instant::ZERO).unwrap();
            add(&format!("device {number}"), Either::B(device), mac(0x10 + number), address(number))
        });
        let devices = devices.collect();
        Self { network, controller, devices, events: Vec::new() }
    }

    fn run_to(&mut self, millis: u64) {
        while let Some((node, event)) = self.network.next_event(Instant::from_millis(millis)) {
            match event {
                Event::A(event) => self.events.push(event),
                Event::B(DeviceEvent::Link(LinkEvent::SetAddress { address, mask, .. })) => {
                    self.network.command(node, |machine, now| {
                        if let Either::B(device) = machine {
                            device.address_set(now, Some(address), mask);
                        }
                    });
                }
                Event::B(_) => {}
            }
        }
    }

    fn bus<T>(&mut self, call: impl FnOnce(&mut DrivenBus) -> T) -> T {
        let called = self.network.command(self.controller, |machine, _| match machine {
            Either::A(bus) => call(bus),
            Either::B(_) => panic!("the controller is a bus"),
        });
        called.unwrap()
    }

    fn device<T>(&mut self, number: usize, call: impl FnOnce(&mut EmulatedDevice, Instant) -> T) -> T {
        let called = self.network.command(self.devices[number].0, |machine, now| match machine {
            Either::B(device) => call(device, now),
            Either::A(_) => panic!("a device is emulated"),
        });
        called.unwrap()
    }

    fn output(&mut self, number: usize, place: &str) -> Option<Vec<u8>> {
        self.device(number, |device, _| device.output(place).map(<[u8]>::to_vec))
    }

    fn up(&mut self) -> Vec<bool> {
        self.bus(|bus| bus.devices().iter().map(DrivenDevice::is_up).collect())
    }
}

/// Two devices, the script of each, and an output of each with its place at the device.
type TwoDevices = ([Chosen; 2], [&'static str; 2], [(&'static str, &'static str); 2]);

/// Returns for each bus two devices of different files or choices.
fn pairs() -> [TwoDevices; 3] {
    let [adapter, io_device, terminal] = devices();
    let small = chosen("GSDML-V2.35-a.xml", GSDML, "[modules]\n2 = \"M_2AO\"\n");
    let other = EDS.replace("\"Outputs\"", "\"Commands\"");
    let digital = chosen("made-up-terminal.xml", ESI, "device_name = \"MU2004\"");
    [
        (
            [adapter, chosen("other.eds", &other, "")],
            ["[[inputs]]\nplace = \"101\"\necho = { place = \"102\" }\n"; 2],
            [("Outputs", "102"), ("Commands", "102")],
        ),
        (
            [io_device, small],
            ["[[inputs]]\nplace = \"2.1\"\necho = { place = \"2.1\" }\n"; 2],
            [("2.1/2 analog outputs", "2.1"), ("2.1/2 analog outputs", "2.1")],
        ),
        (
            [terminal, digital],
            ["[[inputs]]\nplace = \"0x6000:11\"\necho = { place = \"0x7000:01\" }\n", ""],
            [("Outputs/Output", "0x7000:01"), ("Channels/Channel 2", "outputs")],
        ),
    ]
}

fn config(number: u8) -> DriveConfig {
    DriveConfig {
        device_address: Some(address(number)),
        station_name: Some(format!("io-{number}")),
        position: Some(u16::from(number) + 1),
        ..drive_config()
    }
}

fn driven(chosen: &[Chosen; 2]) -> Vec<FileDevice> {
    let names = ["left", "right"];
    let devices = chosen.iter().zip(names).zip(0..);
    devices.map(|((chosen, name), number)| file_device(chosen, name, config(number))).collect()
}

fn two(chosen: &[Chosen; 2], scripts: [&str; 2]) -> Several {
    let emulated: Vec<_> = chosen.iter().zip(scripts).collect();
    Several::new(driven(chosen), &emulated)
}

#[test]
fn two_devices_of_a_bus_get_each_its_own_outputs_by_name() {
    for (chosen, scripts, outputs) in pairs() {
        let mut several = two(&chosen, scripts);
        several.run_to(5_000);
        let bus = several.bus(|bus| bus.bus());
        assert_eq!(several.up(), [true, true], "{bus}: {:?}", several.events);
        for (name, (output, _)) in ["left", "RIGHT"].iter().zip(outputs) {
            let value = match several.bus(|bus| {
                let device = bus.devices().iter().find(|it| it.name().eq_ignore_ascii_case(name)).unwrap();
                device.outputs().find(output).unwrap().bits
            }) {
                1 => "1",
                32 => "01020304",
                _ => "258",
            };
            several.bus(|bus| bus.set(&format!("{name}/{output}"), value)).unwrap();
        }
        several.run_to(6_000);
        for (number, (_, place)) in outputs.into_iter().enumerate() {
            let set = several.bus(|bus| bus.devices()[number].outputs().bytes().to_vec());
            assert!(set.iter().any(|byte| *byte != 0), "{bus} {number}");
            assert_eq!(several.output(number, place), Some(set), "{bus} {number}");
        }
        let counters =
            several.bus(|bus| bus.devices().iter().map(DrivenDevice::counters).collect::<Vec<_>>());
        assert!(counters.iter().all(|it| it.lost == 0 && it.received > 100), "{bus}: {counters:?}");
        let ups: Vec<_> =
            several.events.iter().filter(|(_, event)| *event == DriveEvent::Up).map(|(it, _)| *it).collect();
        assert_eq!(ups.iter().filter(|it| **it == 0).count(), 1, "{bus}: {ups:?}");
        assert_eq!(ups.len(), 2, "{bus}: {ups:?}");
    }
}

#[test]
fn a_device_that_is_gone_does_not_stop_the_other_and_comes_back() {
    for (chosen, scripts, _) in pairs() {
        let emulated: Vec<_> = chosen.iter().zip(scripts).collect();
        let mut several = Several::new(driven(&chosen), &emulated);
        several.run_to(5_000);
        let bus = several.bus(|bus| bus.bus());
        // The last one, since nothing reaches what is after a cut on an EtherCAT line.
        let (_, cable) = several.devices[1];
        several.network.set_cut(cable, true);
        several.run_to(7_000);
        assert_eq!(several.up(), [true, false], "{bus}");
        let before = several.bus(|bus| bus.devices()[0].counters());
        let of = |number, events: &[(usize, DriveEvent)]| {
            events.iter().filter(|(it, event)| *it == number && matches!(event, DriveEvent::Down(..))).count()
        };
        assert_eq!(of(0, &several.events), 0, "{bus}");
        assert!(of(1, &several.events) > 0, "{bus}");
        several.network.set_cut(cable, false);
        several.run_to(30_000);
        assert_eq!(several.up(), [true, true], "{bus}");
        let counters = several.bus(|bus| bus.devices()[0].counters()).since(&before);
        assert_eq!((counters.lost, counters.late), (0, 0), "{bus}: {counters:?}");
    }
}

#[test]
fn a_name_that_several_devices_have_needs_that_of_its_device() {
    let [(adapters, ..), (io_devices, ..), _] = pairs();
    let mut bus = DrivenBus::new(driven(&io_devices), &bus_config(), Instant::ZERO).unwrap();
    let said = bus.set("2.1/2 analog outputs", "1").unwrap_err().to_string();
    assert_eq!(
        said,
        "output `2.1/2 analog outputs`: several devices have it; put the name of a device in front: \
         left/2.1/2 analog outputs, right/2.1/2 analog outputs"
    );
    bus.set("left/2 analog outputs", "1").unwrap();
    assert_eq!(bus.devices().iter().map(|it| it.outputs().bytes()[1]).collect::<Vec<_>>(), [1, 0]);
    let said = bus.set("left/nothing", "1").unwrap_err().to_string();
    assert!(said.starts_with("output `nothing` is not in the file; choose from 2.1"), "{said}");
    let said = bus.read_parameter("0.1:0xF000").unwrap_err().to_string();
    assert!(said.ends_with("in front: left/0.1:0xF000, right/0.1:0xF000"), "{said}");
    let said = bus.run(Some("middle"), true).unwrap_err().to_string();
    assert_eq!(said, "device `middle` is not in the file; choose from left, right");
    // What only one of them has needs no name.
    let mut bus = DrivenBus::new(driven(&adapters), &bus_config(), Instant::ZERO).unwrap();
    bus.set("Commands", "01020304").unwrap();
    assert!(bus.devices()[0].outputs().bytes().iter().all(|byte| *byte == 0));
}

#[test]
fn two_devices_that_are_one_are_refused() {
    let [_, (io_devices, ..), (terminals, ..)] = pairs();
    let mut twice = driven(&io_devices);
    twice[1].name = "LEFT".to_owned();
    let said = DrivenBus::new(twice, &bus_config(), Instant::ZERO).unwrap_err().to_string();
    assert_eq!(said, "two devices are called `LEFT`; give each its own name");
    let mut twice = driven(&io_devices);
    twice[1].config.station_name = twice[0].config.station_name.clone();
    let said = DrivenBus::new(twice, &bus_config(), Instant::ZERO).unwrap_err().to_string();
    assert_eq!(said, "devices `left` and `right` have one station name; give each its own, or leave one out");
    let mut twice = driven(&terminals);
    twice[1].config.position = Some(1);
    let said = DrivenBus::new(twice, &bus_config(), Instant::ZERO).unwrap_err().to_string();
    assert_eq!(said, "devices `left` and `right` have one position; give each its own, or leave one out");
    let mut without = driven(&terminals);
    without[1].config.position = None;
    let said = DrivenBus::new(without, &bus_config(), Instant::ZERO).unwrap_err().to_string();
    assert_eq!(said, "a position of a device is unknown; give each its own, as in --at 3");
    let mut other = driven(&terminals);
    other[1].config.interval = Some(Duration::from_millis(3));
    other[0].config.interval = Some(Duration::from_millis(4));
    let said = DrivenBus::new(other, &bus_config(), Instant::ZERO).unwrap_err().to_string();
    assert_eq!(said, "the devices of an EtherCAT cable have one interval; give the same --interval to all");
    let mixed = vec![driven(&io_devices).remove(0), driven(&terminals).remove(1)];
    let said = DrivenBus::new(mixed, &bus_config(), Instant::ZERO).unwrap_err().to_string();
    assert!(said.contains("`left` and `right` are of different buses"), "{said}");
}

#[test]
fn outputs_of_one_device_run_while_those_of_the_other_stand() {
    for (chosen, scripts, outputs) in pairs().into_iter().take(2) {
        let mut driven = driven(&chosen);
        driven.iter_mut().for_each(|device| device.config.is_running = false);
        let emulated: Vec<_> = chosen.iter().zip(scripts).collect();
        let mut several = Several::new(driven, &emulated);
        several.run_to(5_000);
        let value = if outputs[0].0 == "Outputs" { "01020304" } else { "258" };
        for (name, (output, _)) in ["left", "right"].iter().zip(outputs) {
            several.bus(|bus| bus.set(&format!("{name}/{output}"), value)).unwrap();
        }
        several.bus(|bus| bus.run(Some("right"), true)).unwrap();
        several.run_to(6_000);
        let is_zero = |bytes: Option<Vec<u8>>| bytes.is_none_or(|bytes| bytes.iter().all(|byte| *byte == 0));
        assert!(is_zero(several.output(0, outputs[0].1)));
        assert!(!is_zero(several.output(1, outputs[1].1)));
    }
}

#[test]
fn two_connections_of_one_eds_to_one_adapter_exchange_data_at_the_same_time() {
    let owner = chosen("made-up-adapter.eds", EDS, "connection = \"Exclusive Owner\"");
    let input_only = chosen("made-up-adapter.eds", EDS, "connection = \"Input Only\"");
    let drive = |chosen, name| file_device(chosen, name, config(0));
    let script = "[[inputs]]\nplace = \"101\"\necho = { place = \"102\" }\n";
    let driven = vec![drive(&owner, "owner"), drive(&input_only, "watcher")];
    let mut several = Several::new(driven, &[(&owner, script)]);
    several.run_to(5_000);
    assert_eq!(several.up(), [true, true], "{:?}", several.events);
    several.bus(|bus| bus.set("owner/Outputs", "01020304")).unwrap();
    several.run_to(6_000);
    let shown: Vec<_> = several.bus(|bus| {
        bus.devices().iter().map(|device| device.input("Inputs").map(|it| it.to_string())).collect()
    });
    assert_eq!(shown, [Some("0102030400000000".to_owned()), Some("0102030400000000".to_owned())]);
    // The same connection twice is one.
    let twice = vec![drive(&owner, "a"), drive(&owner, "b")];
    let said = DrivenBus::new(twice, &bus_config(), Instant::ZERO).unwrap_err().to_string();
    assert_eq!(
        said,
        "devices `a` and `b` have one address and one connection; give each its own, or leave one out"
    );
}
