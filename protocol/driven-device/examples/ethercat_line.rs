//! A drive and two terminals of ESI files on an EtherCAT line, driven in virtual time until the cable is cut.

#![expect(clippy::expect_used, reason = "an example")]

use std::net::Ipv4Addr;

use device_files::{ChosenDevice, DeviceChoice, DeviceFile, choose, read};
use driven_device::{BusConfig, DriveConfig, DriveEvent, DrivenBus, DrivenDevice, FileDevice, OutputScript};
use emulated_device::{DeviceEvent, DeviceScript, EmulatedDevice, EmulationConfig};
use machine::ethernet::Mac;
use machine::{Duration, Instant, InterfaceId};
use virtual_time::{Clock, Either, Event, Impairment, Network, Plug};

const DRIVE: &str = include_str!("../../../scripts/interop/files/made-up-drive.xml");
const TERMINALS: &str = include_str!("../../../scripts/interop/files/made-up-terminal.xml");

/// The drive is switched on, and its axis is where it is sent.
const DRIVE_SCRIPT: &str = "\
[[inputs]]
place = \"0x6041:00\"
type = \"uint16\"
value = 0x1237
[[inputs]]
place = \"0x6064:00\"
echo = { place = \"0x607A:00\" }
";

/// Reads an ESI, and chooses one of its devices.
fn device(text: &str, name: &str) -> (DeviceFile, ChosenDevice) {
    let file = read("device.xml", text.into()).expect("an ESI");
    let choice = DeviceChoice { device_name: Some(name.to_owned()), ..DeviceChoice::default() };
    let chosen = choose(&file, &choice).expect("a device of the file");
    (file, chosen)
}

fn main() {
    let devices = [
        ("axis", device(DRIVE, "MU402"), DRIVE_SCRIPT),
        ("analog", device(TERMINALS, "MU1002"), ""),
        ("digital", device(TERMINALS, "MU2004"), ""),
    ];

    // The controller: a MainDevice that expects the three in this order, every 2 ms.
    let driven = devices.iter().zip(1..).map(|((name, (file, chosen), _), position)| FileDevice {
        name: (*name).to_owned(),
        file: file.clone(),
        chosen: chosen.clone(),
        script: OutputScript::default(),
        config: DriveConfig {
            device_address: None,
            station_name: None,
            position: Some(position),
            interval: Some(Duration::from_millis(2)),
            output_interval: None,
            input_interval: None,
            is_running: true,
            report_every: Duration::from_millis(100),
        },
    });
    let own = BusConfig { mac: Mac([2, 0, 0, 0, 0, 1]), address: None, mask: Ipv4Addr::UNSPECIFIED, seed: 1 };
    let bus = DrivenBus::new(driven.collect(), &own, Instant::ZERO).expect("a bus");

    // The line: the controller and each device have a cable to the next one.
    let mut network = Network::new(1);
    let line = network.add_line();
    let mut plug_in = |name: &str, machine| {
        let node = network.add_node(name, machine, Clock::default());
        let nic = network.add_nic(node, &[InterfaceId::FIRST], None, None);
        let ends = [Plug::Nic(nic), Plug::Switch(line)];
        (node, network.connect(ends, [Impairment::default(); 2]).expect("a free plug"))
    };
    let (controller, cable) = plug_in("controller", Either::A(bus));
    let nodes = devices.map(|(name, (_, chosen), script)| {
        let script = DeviceScript::from_toml(script).expect("a script");
        let config = EmulationConfig {
            mac: Mac([2, 0, 0, 0, 0, 2]),
            address: None,
            mask: Ipv4Addr::UNSPECIFIED,
            gateway: Ipv4Addr::UNSPECIFIED,
            station_name: None,
            permanent: None,
            serial_number: 7,
            first_id: 1,
        };
        let device = EmulatedDevice::new(chosen, script, config, Instant::ZERO).expect("a device");
        plug_in(name, Either::B(device)).0
    });

    // Events of both ends until the cut at 1.2 s, and for a second after it.
    let mut seen = Vec::new();
    let mut run_to = |network: &mut Network<_>, millis| {
        while let Some((node, event)) = network.next_event(Instant::from_millis(millis)) {
            match event {
                Event::A((number, DriveEvent::Down(down, _))) => seen.push(format!("{number} down: {down}")),
                Event::B(DeviceEvent::State(state, code)) => seen.push(format!("{node:?} {state} {code}")),
                _ => {}
            }
        }
        std::mem::take(&mut seen)
    };
    let set = |network: &mut Network<Either<DrivenBus, EmulatedDevice>>, name: &str, value: &str| {
        network.command(controller, |machine, _| {
            if let Either::A(bus) = machine {
                bus.set(name, value).expect("an output of the file");
            }
        });
    };
    set(&mut network, "axis/Target position", "-1000");
    set(&mut network, "digital/Channel 3", "1");
    let before = run_to(&mut network, 1_200);
    println!("before the cut: {before:#?}");
    let position = network.command(controller, |machine, _| match machine {
        Either::A(bus) => bus
            .devices()
            .first()
            .and_then(|axis| axis.input("Position actual value"))
            .map(|it| it.to_string()),
        Either::B(_) => None,
    });
    assert_eq!(position.flatten().as_deref(), Some("-1000"), "the axis is where the controller sent it");
    let channels = network.machine(nodes[2]).and_then(|machine| match machine {
        Either::B(terminal) => terminal.output("outputs").map(<[u8]>::to_vec),
        Either::A(_) => None,
    });
    assert_eq!(channels.as_deref(), Some(&[0b0100][..]), "the terminal has its third channel on");

    network.set_cut(cable, true);
    let after = run_to(&mut network, 2_200);
    println!("after it: {after:#?}");
    let downs = after.iter().filter(|line| line.contains("down")).count();
    assert_eq!(downs, 3, "the controller lost each device once");
    let are_up = network.command(controller, |machine, _| match machine {
        Either::A(bus) => bus.devices().iter().filter(|device| DrivenDevice::is_up(device)).count(),
        Either::B(_) => 0,
    });
    assert_eq!(are_up, Some(0));
    for node in nodes {
        let has_outputs = network.machine(node).map(|machine| match machine {
            Either::B(device) => device.outputs().1,
            Either::A(_) => true,
        });
        assert_eq!(has_outputs, Some(false), "the watchdog of each device ended its outputs");
    }
}

#[test]
fn both_ends_see_the_cut() {
    main();
}
