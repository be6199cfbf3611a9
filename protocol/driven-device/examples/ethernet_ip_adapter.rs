//! An adapter of an EDS, driven in virtual time until the cable is cut.

#![expect(clippy::expect_used, reason = "an example")]

use std::net::Ipv4Addr;

use device_files::{DeviceChoice, choose, read};
use driven_device::{BusConfig, DriveConfig, DriveEvent, DrivenBus, FileDevice, OutputScript};
use emulated_device::{DeviceEvent, DeviceScript, EmulatedDevice, EmulationConfig};
use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

const FILE: &str = include_str!("../../../scripts/interop/files/made-up-adapter.eds");
const CONTROLLER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const DEVICE: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// The outputs come back as inputs.
const SCRIPT: &str = "\
[[inputs]]
place = \"101\"
echo = { place = \"102\" }
";

fn main() {
    // The only connection of the file that owns outputs.
    let file = read("made-up-adapter.eds", FILE.into()).expect("a device file");
    let choice = DeviceChoice::from_toml("").expect("a choice");
    let chosen = choose(&file, &choice).expect("a device of the file");

    // One end of the cable is the device, the other one its controller.
    let config = EmulationConfig {
        mac: Mac([2, 0, 0, 0, 0, 2]),
        address: Some(DEVICE),
        mask: MASK,
        gateway: Ipv4Addr::UNSPECIFIED,
        station_name: None,
        permanent: None,
        serial_number: 7,
        first_id: 1,
    };
    let script = DeviceScript::from_toml(SCRIPT).expect("a script");
    let device = EmulatedDevice::new(chosen.clone(), script, config, Instant::ZERO).expect("a device");
    let driven = FileDevice {
        name: "device".to_owned(),
        file,
        chosen,
        script: OutputScript::default(),
        config: DriveConfig {
            device_address: Some(DEVICE),
            station_name: None,
            position: None,
            interval: Some(Duration::from_millis(10)),
            output_interval: None,
            input_interval: None,
            is_running: true,
            report_every: Duration::from_millis(100),
        },
    };
    let own = BusConfig { mac: Mac([2, 0, 0, 0, 0, 1]), address: Some(CONTROLLER), mask: MASK, seed: 1 };
    let bus = DrivenBus::new(vec![driven], &own, Instant::ZERO).expect("a bus");
    let config = PairConfig {
        seed: 1,
        clocks: [Clock::default(); 2],
        links: [Impairment::default(); 2],
        addresses: [Some(CONTROLLER), Some(DEVICE)],
    };
    let mut pair = Pair::new(bus, device, config);

    // What both ends see of the connection, until a time after the start.
    let run_to = |pair: &mut Pair<DrivenBus, EmulatedDevice>, millis| {
        let mut seen = Vec::new();
        while let Some(event) = pair.next_event(Instant::from_millis(millis)) {
            match event {
                Event::A((_, DriveEvent::Up)) => seen.push("controller: up".to_owned()),
                Event::A((_, DriveEvent::Down(down, _))) => seen.push(format!("controller: {down}")),
                Event::B(DeviceEvent::Link(LinkEvent::Up)) => seen.push("device: up".to_owned()),
                Event::B(DeviceEvent::Link(LinkEvent::Down(down))) => seen.push(format!("device: {down}")),
                _ => {}
            }
        }
        seen
    };
    pair.command_a(|bus, _| bus.set("Outputs", "01020304")).expect("an output of the file");
    let before = run_to(&mut pair, 1_200);
    println!("before the cut: {before:#?}");
    assert_eq!(pair.b().output("102"), Some(&[1, 2, 3, 4][..]), "the device has what the controller set");
    let input = pair.a().devices()[0].input("Inputs").map(|value| value.to_string());
    assert_eq!(input.as_deref(), Some("0102030400000000"), "the controller shows what the device sends");

    pair.set_cut(true);
    let after = run_to(&mut pair, 2_200);
    println!("after it: {after:#?}");
    assert!(after.iter().any(|line| line.starts_with("controller: ")), "the controller sees the loss");
    assert!(after.iter().any(|line| line.starts_with("device: ")), "so does the device");
    assert!(!pair.a().devices()[0].is_up() && !pair.b().outputs().1);
}

#[test]
fn both_ends_see_the_cut() {
    main();
}
