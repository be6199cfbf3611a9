//! Attributes, records and objects by name; alarms and emergencies in words; what is written at the start.

use device_files::{DeviceChoice, DeviceFile, choose_found, choose_head};
use driven_device::{DriveEvent, MODULES_RECORD, ParameterValue, SignalValue, found_modules};

use crate::cell::{Chosen, DrivenPair, EDS, ESI, GSDML, chosen, devices, drive_config, driven, emulated};

/// Returns the answers so far, as text.
fn answers(cell: &DrivenPair) -> Vec<String> {
    cell.texts().into_iter().filter(|text| text.starts_with("answer ")).collect()
}

#[test]
fn attributes_are_read_and_written_by_the_names_of_the_eds() {
    let parameters = "[Params]\n Param2 = 0,,\"20 01 24 01 30 01\",0x0010,0xC7,2,\"Vendor\",\"\",\"\",0,65535,0,,,,,,,,,;\n\
         Param3 = 0,,\"20 F5 24 01 30 03\",0x0000,0xC8,4,\"Configuration\",\"\",\"\",0,5,0,,,,,,,,,;\n";
    let chosen = chosen("a.eds", &EDS.replace("[Params]", parameters), "");
    let mut cell = DrivenPair::of(&chosen, "", "", &drive_config());
    cell.pair.command_a(|device, _| {
        device.read_parameter("Vendor").unwrap();
        device.read_parameter("1/1/2").unwrap();
        device.read_parameter("1/1/99").unwrap();
        device.write_parameter("Configuration", "4").unwrap();
        let said = device.write_parameter("Vendor", "1").unwrap_err().to_string();
        assert_eq!(said, "parameter `Vendor`: the file says that it is read-only; read it");
    });
    cell.run_to(3_000);
    let answers = answers(&cell);
    assert_eq!(answers[..2], ["answer Vendor = 65534", "answer 1/1/2 = 0c00"], "{answers:?}");
    assert!(answers[2].contains("(status 0x14)") && answers.len() == 4, "{answers:?}");
    assert!(cell.pair.a().devices()[0].is_up());
}

#[test]
fn configuration_data_of_the_edss_defaults_reach_the_adapter() {
    let text = EDS
        .replace(
            "[Params]",
            "[Params]\n Param2 = 0,,,0x0000,0xC7,2,\"Filter\",\"ms\",\"\",0,65535,770,,,,,,,,,;\n",
        )
        .replace(
            "[Assembly]",
            "[Assembly]\n Assem103 = \"Configuration\",,6,0x0000,,,16,Param2,16,,16,Param2;\n",
        )
        .replace("6,,\n", "6,Assem103,\n");
    let chosen = chosen("a.eds", &text, "");
    let mut cell = DrivenPair::of(&chosen, "", "", &drive_config());
    cell.pair.command_a(|device, _| device.read_parameter("4/103/3")).unwrap();
    cell.run_to(3_000);
    assert_eq!(answers(&cell), ["answer 4/103/3 = 020300000203"]);
}

#[test]
fn alarms_come_in_the_words_of_the_gsdml_with_their_end() {
    let text = GSDML.replace(
        "<ExternalTextList><PrimaryLanguage>",
        "<ChannelDiagList><ChannelDiagItem ErrorType='256'><Name TextId='T_E'/><Help TextId='T_H'/></ChannelDiagItem></ChannelDiagList>\
         <ExternalTextList><PrimaryLanguage><Text TextId='T_E' Value='encoder dirty'/><Text TextId='T_H' Value='clean it'/>",
    );
    let chosen = chosen("GSDML-V2.35-a.xml", &text, "[modules]\n1 = \"M_8DI\"\n2 = \"M_2AO\"\n");
    let script = "[[faults]]\nat = 3\nseconds = 1\nkind = \"alarm\"\nslot = 2\nchannel = 5\ncode = 256\n\
                  [[faults]]\nat = 5\nkind = \"alarm\"\nslot = 1\ncode = 6\n";
    let mut cell = DrivenPair::of(&chosen, script, "", &drive_config());
    cell.run_to(6_000);
    let alarms: Vec<_> = cell.texts().into_iter().filter(|text| text.starts_with("alarm ")).collect();
    assert_eq!(
        alarms,
        [
            "alarm diagnosis alarm of subslot 2.1; channel 5: encoder dirty (0x0100; clean it) appears",
            "alarm end of diagnosis alarm of subslot 2.1; channel 5: encoder dirty (0x0100; clean it) disappears",
            "alarm diagnosis alarm of subslot 1.1; submodule: line break (0x0006) appears",
        ]
    );
}

#[test]
fn without_a_choice_the_modules_are_those_that_the_device_reports() {
    let there = devices()[1].clone();
    let DeviceFile::Gsdml(gsdml) = &there.file else { panic!("a GSDML") };
    let head = choose_head(gsdml, &DeviceChoice::default()).unwrap();
    let head = Chosen { file: there.file.clone(), device: device_files::ChosenDevice::Gsdml(head) };
    let mut cell =
        DrivenPair::between(driven(&head, "", &drive_config()), emulated(there.device.clone(), ""));
    cell.pair.command_a(|device, _| device.read_parameter(MODULES_RECORD)).unwrap();
    cell.run_to(4_000);
    let record = cell.events.iter().find_map(|event| match event {
        DriveEvent::Answer(answer) => match &answer.result {
            Ok(ParameterValue { raw: SignalValue::Bytes(record), .. }) => Some(record.clone()),
            _ => None,
        },
        _ => None,
    });
    let found = found_modules(&record.unwrap()).unwrap();
    let (device, unknown) = choose_found(gsdml, &DeviceChoice::default(), &found).unwrap();
    assert_eq!((device_files::ChosenDevice::Gsdml(device), unknown), (there.device, Vec::new()));
    assert!(!cell.pair.a().devices()[0].differs());
}

#[test]
fn records_are_read_by_index_and_refusals_are_said() {
    let mut cell = DrivenPair::of(&devices()[1], "", "", &drive_config());
    cell.pair.command_a(|device, _| {
        device.read_parameter("0.1:0xAFF0").unwrap();
        device.write_parameter("2.1:100", "0304").unwrap();
        device.read_parameter("2.1:7").unwrap();
        let said = device.write_parameter("2.1:100", "03").unwrap_err().to_string();
        assert!(said.ends_with("must be 2 bytes in hexadecimal digits"), "{said}");
    });
    cell.run_to(4_000);
    let answers = answers(&cell);
    assert!(answers[0].starts_with("answer 0.1:0xAFF0 = 00200038"), "{answers:?}");
    assert_eq!(answers[1], "answer 2.1/2 analog outputs = 0304");
    assert!(answers[2].contains("the device refuses it (status 0x"), "{answers:?}");
}

#[test]
fn objects_are_read_and_written_by_the_names_of_the_esi_and_emergencies_are_said() {
    let script = "[[faults]]\nat = 3\nkind = \"emergency\"\ncode = 16912\n";
    let mut cell = DrivenPair::of(&devices()[2], script, "", &drive_config());
    cell.pair.command_a(|device, _| {
        device.read_parameter("Filter").unwrap();
        device.write_parameter("Filter", "0x0102").unwrap();
        device.read_parameter("0x8000:00:2").unwrap();
        device.read_parameter("0x9999:01").unwrap();
    });
    cell.run_to(5_000);
    let texts = cell.texts();
    let answers = answers(&cell);
    assert_eq!(
        answers[..3],
        ["answer Filter = 4660", "answer Filter = 258", "answer 0x8000:00:2 = 258"],
        "{texts:?}"
    );
    assert!(answers[3].starts_with("answer 0x9999:01: the device refuses it"), "{answers:?}");
    let said = "alarm emergency 0x4210: temperature; error register 0x01, data 0000000000";
    assert!(texts.iter().any(|text| text == said), "{texts:?}");
    assert!(cell.pair.a().devices()[0].is_up());
}

#[test]
fn assigned_pdos_and_init_commands_are_written_before_the_data_run() {
    let coe = "<Mailbox><CoE SdoInfo=\"1\" PdoAssign=\"1\"><InitCmd><Transition>PS</Transition><Index>#x8000</Index>\
               <SubIndex>0</SubIndex><Data>2A00</Data></InitCmd></CoE></Mailbox>";
    let text = ESI.replace("<Mailbox><CoE SdoInfo=\"1\"/></Mailbox>", coe);
    let whole = chosen("a.xml", &text, "device_name = \"MU1002\"");
    let compact = chosen("a.xml", &text, "device_name = \"MU1002\"\npdos = [\"0x1600\", \"0x1A01\"]");
    for chosen in [&whole, &compact] {
        let mut cell = DrivenPair::of(chosen, "", "", &drive_config());
        cell.pair.command_a(|device, _| device.read_parameter("Filter")).unwrap();
        cell.run_to(4_000);
        assert!(cell.pair.a().devices()[0].is_up(), "{:?}", cell.texts());
        assert_eq!(answers(&cell), ["answer Filter = 42"]);
    }
    let start = driven(&compact, "", &drive_config());
    assert_eq!(start.devices()[0].signals().0.len(), 1);
}

#[test]
fn after_a_connection_that_was_lost_during_an_access_parameters_are_read_again() {
    for (chosen, name) in devices().iter().zip(["1/1/1", "0.1:0xAFF0", "Filter"]) {
        let mut cell = DrivenPair::of(chosen, "", "", &drive_config());
        cell.run_to(3_000);
        assert!(cell.pair.a().devices()[0].is_up());
        cell.pair.set_cut(true);
        cell.pair.command_a(|device, _| device.read_parameter(name)).unwrap();
        cell.run_to(8_000);
        let bus = cell.pair.a().bus();
        let lost = answers(&cell);
        assert!(lost.len() == 1 && lost[0].contains("again"), "{bus}: {lost:?}");
        cell.pair.set_cut(false);
        cell.run_to(25_000);
        assert!(cell.pair.a().devices()[0].is_up(), "{bus}: {:?}", cell.texts());
        cell.pair.command_a(|device, _| device.read_parameter(name)).unwrap();
        cell.run_to(27_000);
        let after = answers(&cell);
        assert!(after.len() == 2 && after[1].starts_with(&format!("answer {name} = ")), "{bus}: {after:?}");
    }
}

#[test]
fn an_object_of_a_terminal_without_a_mailbox_is_refused_at_once() {
    let without = chosen("a.xml", ESI, "device_name = \"MU2004\"");
    let mut cell = DrivenPair::of(&without, "", "", &drive_config());
    cell.pair.command_a(|device, _| device.read_parameter("0x1018:01")).unwrap();
    cell.run_to(4_000);
    assert!(cell.pair.a().devices()[0].is_up(), "{:?}", cell.texts());
    let said = "answer 0x1018:01: the device has no mailbox, so it has no objects; use its process data";
    assert_eq!(answers(&cell), [said]);
}

#[test]
fn a_member_of_the_configuration_without_a_default_keeps_its_place_as_zeros() {
    let parameters = "[Params]\n Param2 = 0,,,0x0000,0xC7,2,\"Filter\",\"\",\"\",0,65535,,,,,,,,,,;\n\
         Param3 = 0,,,0x0000,0xC6,1,\"Filter\",\"\",\"\",0,255,7,,,,,,,,,;\n\
         Param4 = 0,,,0x0000,0xC7,2,\"Limit\",\"\",\"\",0,65535,770,,,,,,,,,;\n";
    let assembly = "[Assembly]\n Assem103 = \"Configuration\",,6,0x0000,,,0,Param2,16,Param2,8,Param3,,param4,64,Param4;\n";
    let text =
        EDS.replace("[Params]", parameters).replace("[Assembly]", assembly).replace("6,,\n", "6,Assem103,\n");
    let mut cell = DrivenPair::of(&chosen("a.eds", &text, ""), "", "", &drive_config());
    cell.pair.command_a(|device, _| device.read_parameter("4/103/3")).unwrap();
    cell.run_to(3_000);
    assert_eq!(answers(&cell), ["answer 4/103/3 = 000007020300"]);
}

#[test]
fn parameters_of_one_name_are_read_by_the_name_with_a_number() {
    let parameters = "[Params]\n Param2 = 0,,\"20 01 24 01 30 01\",0x0010,0xC7,2,\"ID\",\"\",\"\",0,65535,0,,,,,,,,,;\n\
         Param3 = 0,,\"20 01 24 01 30 03\",0x0010,0xC7,2,\"ID\",\"\",\"\",0,65535,0,,,,,,,,,;\n\
         Param4 = 0,,\"20 01 24 01 30 02\",0x0010,0xC7,2,\"id\",\"\",\"\",0,65535,0,,,,,,,,,;\n";
    let chosen = chosen("a.eds", &EDS.replace("[Params]", parameters), "");
    let mut cell = DrivenPair::of(&chosen, "", "", &drive_config());
    cell.pair.command_a(|device, _| {
        for name in ["ID", "ID#2", "id", "Param3"] {
            device.read_parameter(name).unwrap();
        }
        let said = device.read_parameter("Id").unwrap_err().to_string();
        assert_eq!(said, "parameter `Id` is not in the file; choose from ID, ID#2, id");
    });
    cell.run_to(3_000);
    let expected = ["ID = 65534", "ID#2 = 77", "id = 12", "ID#2 = 77"].map(|it| format!("answer {it}"));
    assert_eq!(answers(&cell), expected);
}

#[test]
fn scaled_members_and_parameters_are_shown_and_set_in_engineering_units() {
    // Descriptor bit 2; then multiplier, divisor, base, offset, their links, and decimal places.
    let parameters = "[Params]\n Param2 = 0,,\"20 01 24 01 30 01\",0x0004,0xC7,2,\"Control\",\"rpm\",\"\",0,65535,7,1,1,1,0,,,,,1;\n\
         Param3 = 0,,,0x0004,0xC7,2,\"Linked\",\"\",\"\",0,65535,0,1,10,1,0,Param2,,,,0;\n\
         Param4 = 0,,,0x0000,0xC7,2,\"Plain\",\"\",\"\",0,65535,0,1,10,1,0,,,,,0;\n\
         Param5 = 0,,,0x0004,0xC3,2,\"Speed\",\"rpm\",\"\",0,65535,0,1,4,1,-8,,,,,0;\n";
    let text = EDS
        .replace("[Params]", parameters)
        .replace("\"Outputs\",,4,0x0000,,,32,", "\"Outputs\",,4,0x0000,,,16,Param5,16,Param3");
    assert_ne!(text, EDS.replace("[Params]", parameters), "the outputs have members");
    let mut cell = DrivenPair::of(&chosen("a.eds", &text, ""), "", "", &drive_config());
    cell.pair.command_a(|device, _| {
        device.set("Speed", "2.5").unwrap();
        device.set("Linked", "3").unwrap();
        device.read_parameter("Control").unwrap();
        let said = device.write_parameter("Control", "6553.6").unwrap_err().to_string();
        assert_eq!(said, "Control: `6553.6`: must be 0.0 to 6553.5 (raw uint16, 0 to 65535)");
    });
    assert_eq!(cell.pair.a().devices()[0].outputs().bytes(), [18, 0, 3, 0]);
    cell.run_to(3_000);
    assert_eq!(answers(&cell), ["answer Control = 6553.4 rpm (raw 65534)"]);
}

#[test]
fn a_null_connection_gives_the_device_its_configuration_and_exchanges_no_data() {
    let parameters = "[Params]\n Param2 = 0,,,0x0000,0xC7,2,\"Limit\",\"\",\"\",0,65535,770,,,,,,,,,;\n";
    let assembly = "[Assembly]\n Assem103 = \"Configuration\",,6,0x0000,,,16,Param2,32,;\n";
    let text =
        EDS.replace("[Params]", parameters).replace("[Assembly]", assembly).replace("6,,\n", "6,Assem103,\n");
    let there = chosen("a.eds", &text, "");
    let null = chosen("a.eds", &text.replace("0x44640405", "0x44110405"), "");
    let emulated = emulated(there.device, "");
    let mut cell = DrivenPair::between(driven(&null, "", &drive_config()), emulated);
    cell.pair.command_a(|device, _| device.read_parameter("4/103/3")).unwrap();
    cell.run_to(40_000);
    let texts = cell.texts();
    assert!(
        texts.iter().any(|text| text == "configured") && !texts.iter().any(|text| text == "up"),
        "{texts:?}"
    );
    assert_eq!(answers(&cell), ["answer 4/103/3 = 020300000000"], "{texts:?}");
    let device = &cell.pair.a().devices()[0];
    assert!(device.is_up() && device.inputs().is_none() && device.signals().1.is_empty());
    assert_eq!(device.counters().sent, 0, "no cyclic frame");
    assert_eq!(cell.output("102"), None, "no owner");
    // It ends without a Forward_Close, and starts over when the adapter ends the session.
    cell.pair.set_cut(true);
    cell.run_to(45_000);
    cell.pair.set_cut(false);
    cell.pair.command_a(|bus, now| bus.disconnect(now));
    cell.run_to(50_000);
    assert!(cell.texts().last().is_some_and(|text| text.starts_with("down")), "{:?}", cell.texts());
    assert!(!cell.pair.a().devices()[0].is_up() && !cell.pair.a().devices()[0].was_lost());
}
