//! A device among others on one EtherCAT cable, each of its own ESI file.

use driven_device::{DriveConfig, DriveEvent, DrivenBus, DrivenDevice, OutputScript};
use emulated_device::{EmulatedDevice, EmulatedDevices};
use machine::Instant;
use virtual_time::{Event, Pair};

use crate::cell::{
    Chosen, ESI, bus_config, chosen, devices, drive_config, drive_file, driven, emulated, file_device,
    pair_config,
};

/// Three devices: four digital outputs, an analog terminal, and one of another maker's file.
fn on_cable() -> [Chosen; 3] {
    let other = ESI
        .replace("<Id>#xFFFE</Id>", "<Id>#xFFFD</Id>")
        .replace("ProductCode=\"#x77\"", "ProductCode=\"#x99\"")
        .replace("<BitLen>15</BitLen>", "<BitLen>31</BitLen>");
    [
        chosen("made-up-terminal.xml", ESI, "device_name = \"MU2004\""),
        chosen("made-up-terminal.xml", ESI, "device_name = \"MU1002\""),
        chosen("other.xml", &other, "device_name = \"MU1002\""),
    ]
}

/// Drives a device at this position, from 1, of the cable of three.
fn drive(device: &Chosen, position: u16) -> (Pair<DrivenBus, EmulatedDevices>, Vec<DriveEvent>) {
    let config = DriveConfig { position: Some(position), ..drive_config() };
    let devices = on_cable().map(|it| {
        let is_echo = it.device == device.device && position > 1;
        let echo = "[[inputs]]\nplace = \"0x6000:11\"\necho = { place = \"0x7000:01\" }\n";
        let script = if is_echo { echo } else { "" };
        emulated(it.device, script)
    });
    let line = EmulatedDevices::new(devices.into()).unwrap();
    let mut pair = Pair::new(driven(device, "", &config), line, pair_config());
    let events = run_to(&mut pair, 3_000);
    (pair, events)
}

fn run_to(pair: &mut Pair<DrivenBus, EmulatedDevices>, millis: u64) -> Vec<DriveEvent> {
    let mut events = Vec::new();
    while let Some(event) = pair.next_event(Instant::from_millis(millis)) {
        if let Event::A((_, event)) = event {
            events.push(event);
        }
    }
    events
}

/// Returns whether a device has process data of a MainDevice.
fn is_driven(device: &EmulatedDevice) -> bool {
    device.output("outputs").is_some()
}

#[test]
fn a_device_at_any_position_of_a_cable_is_driven_and_the_others_get_no_process_data() {
    let [digital, analog, other] = on_cable();
    let places = [
        (digital, "Channels/Channel 2", "1"),
        (analog, "Outputs/Output", "258"),
        (other, "Outputs/Output", "258"),
    ];
    for (index, (device, output, value)) in places.iter().enumerate() {
        let (mut pair, events) = drive(device, index as u16 + 1);
        assert!(pair.a().devices()[0].is_up() && !pair.a().devices()[0].differs(), "{index}: {events:?}");
        pair.command_a(|device, _| device.set(output, value)).unwrap();
        let events = run_to(&mut pair, 3_500);
        assert_eq!(
            pair.b().devices()[index].output("outputs"),
            Some(pair.a().devices()[0].outputs().bytes()),
            "{events:?}"
        );
        let driven: Vec<_> = pair.b().devices().iter().map(is_driven).collect();
        assert_eq!(driven, [0, 1, 2].map(|it| it == index));
        if index > 0 {
            assert_eq!(
                pair.a().devices()[0].input("Inputs/Value").map(|it| it.to_string()).as_deref(),
                Some("258")
            );
        }
        let counters = pair.a().devices()[0].counters();
        assert_eq!((counters.lost, counters.foreign, counters.malformed), (0, 0, 0));
    }
}

#[test]
fn a_cable_with_fewer_devices_is_said_with_their_number_and_none_is_driven() {
    let (pair, events) = drive(&on_cable()[1], 5);
    let said = events.iter().find_map(|event| match event {
        DriveEvent::Down(down, details) => Some(format!("{down}; {details}")),
        _ => None,
    });
    let said = said.unwrap();
    assert!(
        said.ends_with("device 5 is missing: check its power and the cable between devices 4 and 5; the cable has 3 devices"),
        "{said}"
    );
    assert!(!pair.a().devices()[0].has_been_up() && !pair.b().devices().iter().any(is_driven));
}

#[test]
fn a_device_of_another_file_at_the_position_is_named_and_refused() {
    let (pair, events) = drive(&on_cable()[1], 3);
    let is_named = |event: &DriveEvent| matches!(event, DriveEvent::Down(_, details) if details.starts_with("device 3 is another one: expected vendor 0x0000FFFE"));
    assert!(events.iter().any(is_named), "{events:?}");
    assert!(pair.a().devices()[0].differs() && !pair.a().devices()[0].has_been_up());
}

#[test]
fn all_devices_of_a_cable_are_driven_and_come_back_after_one_of_them_was_silent() {
    let config = |position| DriveConfig { position: Some(position), ..drive_config() };
    let places = (1..).zip(["digital", "analog", "other"]).zip(on_cable());
    let driven = places.map(|((position, name), device)| file_device(&device, name, config(position)));
    let bus = DrivenBus::new(driven.collect(), &bus_config(), Instant::ZERO).unwrap();
    let silent = "[[faults]]\nat = 4\nseconds = 1\nkind = \"silent\"\n";
    let scripted = on_cable().into_iter().zip(["", silent, ""]);
    let line = scripted.map(|(it, script)| emulated(it.device, script)).collect();
    let mut pair = Pair::new(bus, EmulatedDevices::new(line).unwrap(), pair_config());
    run_to(&mut pair, 3_500);
    for (output, value) in
        [("Channel 2", "1"), ("analog/Outputs/Output", "258"), ("other/Outputs/Output", "772")]
    {
        pair.command_a(|bus, _| bus.set(output, value)).unwrap();
    }
    run_to(&mut pair, 3_900);
    for (driven, emulated) in pair.a().devices().iter().zip(pair.b().devices()) {
        assert_eq!(emulated.output("outputs"), Some(driven.outputs().bytes()), "{}", driven.name());
        assert_eq!((driven.counters().lost, driven.counters().late), (0, 0), "{}", driven.name());
    }
    let up = |pair: &Pair<DrivenBus, EmulatedDevices>| {
        pair.a().devices().iter().map(DrivenDevice::is_up).collect::<Vec<_>>()
    };
    assert_eq!(up(&pair), [true; 3]);
    // What the silent one does not pass on comes back to nobody.
    run_to(&mut pair, 4_900);
    assert_eq!(up(&pair), [false; 3]);
    run_to(&mut pair, 30_000);
    assert_eq!(up(&pair), [true; 3]);
}

#[test]
fn devices_of_one_process_are_of_one_bus() {
    let [digital, ..] = on_cable();
    let [adapter, ..] = devices();
    let both = vec![emulated(digital.device, ""), emulated(adapter.device, "")];
    let said = EmulatedDevices::new(both).unwrap_err().to_string();
    assert_eq!(
        said,
        "devices of EtherCAT and of EtherNet/IP: one process has one bus; start another process for the other"
    );
    let said = EmulatedDevices::new(Vec::new()).unwrap_err().to_string();
    assert_eq!(said, "0 devices: one process has 1 to 255");
}

#[test]
fn positions_count_from_1() {
    let Chosen { file, device } = devices()[2].clone();
    let config = DriveConfig { position: Some(0), ..drive_config() };
    let refused = drive_file(file, device, OutputScript::default(), &config).unwrap_err();
    assert_eq!(refused.to_string(), "position 0: positions on the cable count from 1");
}
