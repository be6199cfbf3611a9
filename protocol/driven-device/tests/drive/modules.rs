//! Modules of an ESI in their slots: chosen, emulated, written to the device, and compared with those that it reports.

use crate::cell::{Chosen, DrivenPair, chosen, drive_config, driven, emulated};

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
