//! Another device than the file's at the other end, and names and values that the device does not have.

use device_files::DeviceChoice;
use driven_device::{BusConfig, DrivenBus, OutputScript};
use machine::Instant;

use crate::cell::{
    Chosen, DrivenPair, EDS, ESI, GSDML, bus_config, chosen, devices, drive_config, drive_file, driven,
    emulated, file_device,
};

/// Drives one device by the file of another.
fn between(expected: &Chosen, there: &Chosen) -> DrivenPair {
    DrivenPair::between(driven(expected, "", &drive_config()), emulated(there.device.clone(), ""))
}

#[test]
fn a_device_of_another_identity_is_refused_in_words() {
    let modules = "[modules]\n1 = \"M_8DI\"\n2 = \"M_2AO\"\n";
    let others = [
        chosen("a.eds", &EDS.replace("ProdCode = 77", "ProdCode = 78"), ""),
        chosen("GSDML-V2.35-a.xml", &GSDML.replace("DeviceID=\"0x0077\"", "DeviceID=\"0x0078\""), modules),
        chosen(
            "a.xml",
            &ESI.replace("ProductCode=\"#x77\"", "ProductCode=\"#x79\""),
            "device_name = \"MU1002\"",
        ),
    ];
    for (expected, other) in devices().iter().zip(&others) {
        let mut cell = between(expected, other);
        cell.run_to(8_000);
        let texts = cell.texts();
        let bus = cell.pair.a().bus();
        assert!(
            !cell.pair.a().devices()[0].is_up() && cell.pair.a().devices()[0].differs(),
            "{bus}: {texts:?}"
        );
        let found = match bus {
            "EtherNet/IP" => "product code 78",
            "PROFINET" => "device",
            _ => "product 0x00000079",
        };
        assert!(texts.iter().any(|text| text.contains(found)), "{bus}: {texts:?}");
    }
}

#[test]
fn a_device_with_other_sizes_is_refused_with_both() {
    let eds = EDS
        .replace("\"Inputs\",,8,0x0000,,,64", "\"Inputs\",,9,0x0000,,,72")
        .replace("Param1,8,Assem101", "Param1,9,Assem101");
    let mut cell = between(&devices()[0], &chosen("a.eds", &eds, ""));
    cell.run_to(8_000);
    let texts = cell.texts();
    assert!(
        cell.pair.a().devices()[0].differs()
            && texts.iter().any(|text| text.contains('8') && text.contains('9')),
        "{texts:?}"
    );
    let esi = ESI.replace("<BitLen>15</BitLen>", "<BitLen>31</BitLen>");
    let mut cell = between(&devices()[2], &chosen("a.xml", &esi, "device_name = \"MU1002\""));
    cell.run_to(8_000);
    let texts = cell.texts();
    let said = "has 2 bytes of outputs and 6 of inputs; expected 2 and 4";
    assert!(texts.iter().any(|text| text.contains(said)), "{texts:?}");
}

#[test]
fn one_wrong_submodule_is_said_and_the_rest_runs() {
    let there = chosen("GSDML-V2.35-a.xml", GSDML, "[modules]\n1 = \"M_8DI\"\n2 = \"M_8DI\"\n");
    let script = "[[inputs]]\nplace = \"1.1\"\ntype = \"uint8\"\nvalue = 7\n";
    let expected = &devices()[1];
    let mut cell =
        DrivenPair::between(driven(expected, "", &drive_config()), emulated(there.device.clone(), script));
    cell.run_to(5_000);
    let texts = cell.texts();
    assert!(cell.pair.a().devices()[0].is_up() && cell.pair.a().devices()[0].differs(), "{texts:?}");
    let said =
        "difference slot 2: expected 2 analog outputs (0x00000042), found module 0x00000021; choose that one";
    assert!(texts.iter().any(|text| text == said), "{texts:?}");
    assert_eq!(cell.input("1.1/8 digital inputs").as_deref(), Some("7"));
    assert_eq!(cell.input("2.1").as_deref(), Some("0000"), "data that the device marks as bad");
}

#[test]
fn a_record_that_the_device_refuses_is_said_and_the_data_run() {
    let records = GSDML.find("<RecordDataList>").unwrap()..GSDML.find("</RecordDataList>").unwrap();
    let mut text = GSDML.to_owned();
    text.replace_range(records.start..records.end + "</RecordDataList>".len(), "");
    let there = chosen("GSDML-V2.35-a.xml", &text, "[modules]\n1 = \"M_8DI\"\n2 = \"M_2AO\"\n");
    let mut cell = between(&devices()[1], &there);
    cell.run_to(5_000);
    let texts = cell.texts();
    assert!(cell.pair.a().devices()[0].is_up(), "{texts:?}");
    let said = "alarm record 100 of subslot 2.1, 2 bytes: the device refuses it";
    assert!(texts.iter().any(|text| text.starts_with(said)), "{texts:?}");
}

#[test]
fn a_long_record_goes_in_fragments_and_one_that_fits_into_no_call_is_refused_with_its_length() {
    let of_length = |len: usize| {
        let text = GSDML.replace("Index=\"100\" Length=\"2\"", &format!("Index=\"100\" Length=\"{len}\""));
        chosen("GSDML-V2.35-a.xml", &text, "[modules]\n1 = \"M_8DI\"\n2 = \"M_2AO\"\n")
    };
    // Fifty datagrams.
    let long = of_length(65_452);
    let mut cell = between(&long, &long);
    cell.run_to(5_000);
    let texts = cell.texts();
    assert!(
        cell.pair.a().devices()[0].is_up() && !texts.iter().any(|text| text.starts_with("alarm")),
        "{texts:?}"
    );
    let Chosen { file, device } = of_length(65_453);
    let made = drive_file(file, device, OutputScript::default(), &drive_config());
    let said = made.unwrap_err().to_string();
    assert_eq!(
        said,
        "parameter record 100 of slot 2 has 65453 bytes, more than the 65,452 that fit: shorten it"
    );
}

#[test]
fn a_connection_that_the_file_allows_as_null_in_one_direction_only_is_refused() {
    for types in ["0x44140405", "0x44610405"] {
        let Chosen { file, device } = chosen("a.eds", &EDS.replace("0x44640405", types), "");
        let made = drive_file(file, device, OutputScript::default(), &drive_config());
        assert_eq!(
            made.unwrap_err().to_string(),
            "connection `Exclusive Owner`: the file allows null in one direction only, which no connection has; choose another \
             one with --connection",
            "{types}"
        );
    }
}

#[test]
fn names_and_values_that_the_device_does_not_have_are_refused_with_what_it_has() {
    for chosen in devices() {
        let mut device = driven(&chosen, "", &drive_config());
        let known = device.devices()[0].signals().1[0].name.clone();
        let said = device.set("nowhere", "1").unwrap_err().to_string();
        assert!(
            said.starts_with("output `nowhere` is not in the file; choose from ") && said.contains(&known),
            "{said}"
        );
        let said = device.set(&known, "fast").unwrap_err().to_string();
        assert!(said.starts_with(&format!("{known}: `fast`: must be ")), "{said}");
        let said = device.read_parameter("nowhere").unwrap_err().to_string();
        assert!(said.starts_with("parameter `nowhere` is not in the file; choose from "), "{said}");
        let script = |text: &str| OutputScript::from_toml(text).unwrap();
        let config = drive_config();
        let made = |script| drive_file(chosen.file.clone(), chosen.device.clone(), script, &config);
        assert!(made(script("[[outputs]]\nname = \"nowhere\"\nvalue = 1")).is_err());
        let without = BusConfig { address: None, ..bus_config() };
        let device_without = file_device(&chosen, "device", drive_config());
        let made = DrivenBus::new(vec![device_without], &without, Instant::ZERO);
        assert_eq!(made.is_ok(), device.bus() == "EtherCAT", "without an address");
    }
    let mut terminal = driven(&devices()[2], "", &drive_config());
    let said = terminal.set("Output", "32768").unwrap_err().to_string();
    assert_eq!(said, "Outputs/Output: `32768`: must be int16, -32768 to 32767");
}

#[test]
fn data_of_a_safety_protocol_are_shown_as_bytes_and_never_set() {
    let text = GSDML.replace(
        "ID=\"S_2AO\" SubmoduleIdentNumber=\"0x00000002\"",
        "ID=\"S_2AO\" SubmoduleIdentNumber=\"0x00000002\" PROFIsafeSupported=\"true\"",
    );
    let chosen = chosen("GSDML-V2.35-a.xml", &text, "[modules]\n1 = \"M_8DI\"\n2 = \"M_2AO\"\n");
    let mut device = driven(&chosen, "", &drive_config());
    let outputs: Vec<_> =
        device.devices()[0].signals().1.iter().map(|it| (it.name.clone(), it.is_safety)).collect();
    assert_eq!(outputs, [("2.1".to_owned(), true)]);
    let said = device.set("2.1", "01020304").unwrap_err().to_string();
    assert_eq!(said, "output `2.1`: data of a safety protocol are never set; use the maker's tool");
}

#[test]
fn a_file_of_one_bus_is_not_chosen_for_another() {
    let [eds, gsdml, _] = devices();
    let made = drive_file(eds.file, gsdml.device, OutputScript::default(), &drive_config());
    assert_eq!(made.unwrap_err().to_string(), "the chosen device is of another file");
    assert!(DeviceChoice::from_toml("modules = 1").is_err());
}

#[test]
fn an_init_command_that_is_too_long_to_be_written_is_refused_when_the_file_is_opened() {
    let command = "<Mailbox><CoE><InitCmd><Transition>PS</Transition><Index>#x8000</Index><SubIndex>1</SubIndex>\
                   <Data>@</Data></InitCmd></CoE></Mailbox>";
    let command = command.replace('@', &"01".repeat(65_537));
    let text = ESI.replace("<Mailbox><CoE SdoInfo=\"1\"/></Mailbox>", &command);
    let Chosen { file, device } = chosen("a.xml", &text, "device_name = \"MU1002\"");
    let made = drive_file(file, device, OutputScript::default(), &drive_config());
    assert_eq!(
        made.unwrap_err().to_string(),
        "init command 0x8000:01 has 65537 bytes: at most 65536 can be written; remove it from a copy of the file, and write the object \
         with the maker's tool"
    );
}
