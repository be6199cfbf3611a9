//! Modules of an ESI in their slots: chosen, emulated, written to the device, and compared with those that it reports.

use device_files::{ChosenDevice, DeviceChoice, DeviceFile, choose_detected, read, sub_device_head};
use ethercat_maindevice::{Config, ExpectedDevice, MainDevice, SubDeviceId};
use machine::{Duration, Instant};
use virtual_time::Pair;

use crate::cell::{Chosen, DrivenPair, bus_config, chosen, drive_config, driven, emulated, pair_config};

const COUPLER: &str = include_str!("../../../../scripts/interop/files/made-up-coupler.xml");

fn coupler(modules: &str) -> Chosen {
    chosen("made-up-coupler.xml", COUPLER, &format!("[modules]\n{modules}"))
}

#[test]
fn modules_bring_their_process_data_and_objects_to_the_places_of_their_slots() {
    let device = coupler("2 = \"MU-2A\"\n4 = \"0x31\"\n");
    let echo = "[[inputs]]\nplace = \"0x6030:01\"\necho = { place = \"0x7030:01\" }\n";
    let mut cell = DrivenPair::of(&device, echo, "", &drive_config());
    cell.pair.command_a(|bus, _| {
        bus.set("Analog/Output#2", "258").unwrap();
        for name in
            ["0xF030:00:1", "0xF030:01", "0xF030:03", "0xF030:04", "0x8030:00:2", "Filter", "0x8000:00:2"]
        {
            bus.read_parameter(name).unwrap();
        }
    });
    cell.run_to(4_000);
    assert_eq!(cell.output("0x7030:01"), Some(vec![2, 1]), "{:?}", cell.texts());
    assert_eq!(cell.output("0x7010:01"), Some(vec![0, 0]));
    assert_eq!(cell.input("Analog/Input#2").as_deref(), Some("258"));
    let answers: Vec<_> = cell.texts().into_iter().filter(|text| text.starts_with("answer")).collect();
    let found: Vec<_> = answers.iter().map(|text| text.rsplit(' ').next().unwrap()).collect();
    // The list of modules, then the filters of slots 4 and 2 with the value of their init command.
    assert_eq!(found[..6], ["4", "17", "0", "49", "7", "7"], "{answers:?}");
    assert!(answers[6].contains("the device refuses it"), "slot 1 has no filter: {answers:?}");
    let texts = cell.texts();
    assert!(!texts.iter().any(|text| text.starts_with("difference")), "{texts:?}");
}

#[test]
fn modules_other_than_the_expected_ones_are_told_slot_by_slot() {
    // The same sizes, so that the data run.
    let expected = coupler("2 = \"MU-8DI\"\n3 = \"MU-2A\"\n");
    let there = COUPLER
        .replace("ModuleIdent=\"#x20\"", "ModuleIdent=\"#x22\"")
        .replace("DownloadModuleIdentList=\"1\"", "DownloadModuleIdentList=\"0\"");
    let there = chosen("other.xml", &there, "[modules]\n2 = \"MU-8DI\"\n3 = \"MU-2A\"\n");
    let mut cell = DrivenPair::between(driven(&expected, "", &drive_config()), emulated(there.device, ""));
    cell.run_to(4_000);
    let differences: Vec<_> =
        cell.texts().into_iter().filter(|text| text.starts_with("difference")).collect();
    assert_eq!(
        differences,
        [
            "difference slot 2: expected MU-8DI (0x00000020), found module 0x00000022; choose it with --module 2=0x00000022"
        ]
    );
    assert!(cell.device().is_up() && cell.device().differs());
}

#[test]
fn a_module_that_is_missing_at_the_device_changes_its_process_data_and_is_refused() {
    let expected = coupler("2 = \"MU-8DI\"\n");
    let there = coupler("");
    let mut cell = DrivenPair::between(driven(&expected, "", &drive_config()), emulated(there.device, ""));
    cell.run_to(4_000);
    assert!(!cell.device().has_been_up() && cell.device().differs(), "{:?}", cell.texts());
}

#[test]
fn a_device_that_takes_a_list_of_modules_refuses_another_one_than_its_own() {
    let expected = coupler("2 = \"MU-8DI\"\n3 = \"MU-2A\"\n");
    let there = COUPLER.replace("ModuleIdent=\"#x20\"", "ModuleIdent=\"#x22\"");
    let there = chosen("other.xml", &there, "[modules]\n2 = \"MU-8DI\"\n3 = \"MU-2A\"\n");
    let mut cell = DrivenPair::between(driven(&expected, "", &drive_config()), emulated(there.device, ""));
    cell.run_to(4_000);
    assert!(!cell.device().has_been_up() && cell.device().differs(), "{:?}", cell.texts());
    assert!(cell.texts().iter().any(|text| text.contains("0x0070")), "{:?}", cell.texts());
}

/// Reads which modules a device detects.
fn detected(device: ChosenDevice) -> Result<Vec<(u8, u32)>, String> {
    let ChosenDevice::Esi(chosen) = &device else { panic!("{device:?}") };
    let expected = ExpectedDevice {
        vendor: chosen.vendor_id,
        product: chosen.product_code,
        revision: None,
        output_bytes: 0,
        input_bytes: 0,
    };
    let time = Duration::from_millis(100);
    let config = Config { mac: bus_config().mac, devices: vec![expected], cycle: time, watchdog: time };
    let mut machine = MainDevice::new(config, Instant::ZERO).unwrap();
    machine.read_modules(SubDeviceId(0));
    let mut pair = Pair::new(machine, emulated(device, ""), pair_config());
    while pair.next_event(Instant::from_millis(3_000)).is_some() {}
    let found = pair.command_a(|machine, _| machine.take_modules(SubDeviceId(0))).unwrap();
    found.map(|modules| modules.iter().map(|it| (it.slot, it.ident)).collect())
}

#[test]
fn modules_that_nobody_named_are_those_that_the_device_detects() {
    let there = coupler("2 = \"MU-2A\"\n4 = \"0x31\"\n");
    let found = detected(there.device.clone()).unwrap();
    assert_eq!(found.iter().map(|it| it.0).collect::<Vec<_>>(), [1, 2, 4]);
    let DeviceFile::Esi(esi) = read("made-up-coupler.xml", COUPLER.into()).unwrap() else { unreachable!() };
    let choice = DeviceChoice::default();
    assert!(sub_device_head(&esi, &choice).unwrap().lists_modules);
    let (device, unknown) = choose_detected(&esi, &choice, &found).unwrap();
    assert_eq!((ChosenDevice::Esi(device), unknown), (there.device, Vec::new()));
}

#[test]
fn detected_modules_that_the_file_does_not_have_are_said_and_left_out() {
    let DeviceFile::Esi(esi) = read("made-up-coupler.xml", COUPLER.into()).unwrap() else { unreachable!() };
    let found = [(1, 0x10), (2, 0x20), (3, 0x9999), (200, 1)];
    let (device, unknown) = choose_detected(&esi, &DeviceChoice::default(), &found).unwrap();
    assert_eq!(
        device.modules.iter().map(|it| (it.slot, it.ident)).collect::<Vec<_>>(),
        [(1, 0x10), (2, 0x20)]
    );
    assert_eq!(unknown.len(), 2, "{unknown:?}");
    assert!(unknown[0].starts_with("slot 3: the device has module 0x00009999, which the file does not have"));
}

#[test]
fn a_device_without_a_list_of_modules_says_so() {
    let device = chosen("made-up-terminal.xml", crate::cell::ESI, "device_name = \"MU1002\"").device;
    let reason = detected(device).unwrap_err();
    assert!(reason.starts_with("the device"), "{reason}");
}
