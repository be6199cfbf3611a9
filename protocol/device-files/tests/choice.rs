//! Choices from our own files and from made-up ones: a device is made, written and made again to the same.

#![expect(clippy::unwrap_used, reason = "a test")]

use device_files::{ChosenDevice, DeviceChoice, DeviceFile, choose, read};

fn ours() -> Vec<DeviceFile> {
    devices::files().into_iter().map(|(name, text)| read(&name, text.into()).unwrap()).collect()
}

#[test]
fn the_choice_of_each_of_our_files_is_written_and_makes_the_same_device_again() {
    for file in ours() {
        let chosen = choose(&file, &DeviceChoice::default()).unwrap();
        let written = chosen.choice().to_toml();
        let again = choose(&file, &DeviceChoice::from_toml(&written).unwrap()).unwrap();
        assert_eq!(again, chosen, "{written}");
    }
}

#[test]
fn each_of_our_files_makes_a_device_with_256_bytes_each_way() {
    for file in ours() {
        let lengths = match choose(&file, &DeviceChoice::default()).unwrap() {
            ChosenDevice::Gsdml(device) => {
                let submodules = device.modules.iter().flat_map(|module| &module.submodules);
                submodules.fold((0, 0), |(outputs, inputs), it| {
                    (outputs + u32::from(it.output_length), inputs + u32::from(it.input_length))
                })
            }
            ChosenDevice::Eds(adapter) => {
                (u32::from(adapter.consumed.unwrap().size), u32::from(adapter.produced.size))
            }
            ChosenDevice::Esi(device) => device.lengths(),
        };
        assert_eq!(lengths, (256, 256));
    }
}

#[test]
fn an_option_of_another_format_is_refused() {
    let access_point = DeviceChoice { access_point: Some("X".to_owned()), ..DeviceChoice::default() };
    let errors: Vec<_> = ours()
        .iter()
        .map(|file| {
            choose(file, &access_point)
                .map(|_| ())
                .unwrap_err()
                .to_string()
                .lines()
                .next()
                .unwrap()
                .to_owned()
        })
        .collect();
    assert_eq!(
        errors,
        [
            "--access-point: not an option of an EDS; leave it out",
            "--access-point: `X` is not in the file; choose one",
            "--access-point: not an option of an ESI; leave it out",
        ]
    );
}

/// The made-up coupler: one power module, and three slots for others.
fn coupler() -> DeviceFile {
    let text = include_str!("../../../scripts/interop/files/made-up-coupler.xml");
    read("made-up-coupler.xml", text.to_owned().into()).unwrap()
}

fn with_modules(modules: &str) -> Result<ChosenDevice, String> {
    let choice = DeviceChoice::from_toml(&format!("[modules]\n{modules}")).unwrap();
    choose(&coupler(), &choice).map_err(|error| error.to_string())
}

#[test]
fn modules_of_an_esi_move_to_their_slots_and_make_the_same_device_again() {
    let ChosenDevice::Esi(device) = with_modules("2 = \"MU-8DI\"\n4 = \"MU-2A\"\n").unwrap() else {
        panic!("an ESI");
    };
    let modules: Vec<_> = device.modules.iter().map(|it| (it.slot, it.ident, it.kind.as_str())).collect();
    assert_eq!(modules, [(1, 0x11, "MU-P1"), (2, 0x20, "MU-8DI"), (4, 0x31, "MU-2A")]);
    let places = |pdos: &[device_files::ChosenPdo]| {
        pdos.iter().map(|it| (it.pdo.index, it.pdo.entries[0].index)).collect::<Vec<_>>()
    };
    assert_eq!(places(&device.inputs), [(0x1A00, 0x6000), (0x1A01, 0x6010), (0x1A03, 0x6030)]);
    assert_eq!(places(&device.outputs), [(0x1603, 0x7030)]);
    assert_eq!(device.lengths(), (2, 4));
    assert_eq!(device.dictionary.as_ref().unwrap().objects[0].index, 0x8030);
    let commands = &device.mailbox.as_ref().unwrap().coe.as_ref().unwrap().init_commands;
    assert_eq!((commands.len(), commands[0].index), (1, 0x8030));
    let chosen = ChosenDevice::Esi(device);
    let written = chosen.choice().to_toml();
    let again = choose(&coupler(), &DeviceChoice::from_toml(&written).unwrap()).unwrap();
    assert_eq!(again, chosen, "{written}");
}

#[test]
fn modules_that_do_not_fit_an_esi_are_refused_with_those_that_do() {
    let said = |modules: &str| with_modules(modules).map(drop).unwrap_err();
    assert_eq!(
        said("2 = \"MU-P1\""),
        "--module: slot 2: `MU-P1` does not fit into it; choose one\n  2=0x00000020  MU-8DI\n  2=0x00000031  MU-2A"
    );
    assert!(said("2 = \"MU-9\"").starts_with("--module: slot 2: `MU-9` is not in the file; choose one"));
    assert!(said("1 = \"none\"").starts_with("--module: slot 1 needs a module; choose one\n  1=0x00000010"));
    assert_eq!(said("5 = \"MU-8DI\""), "--module: slot 5: the device has slots 1 to 4");
    assert_eq!(said("0 = \"MU-8DI\""), "--module: slot 0: the device has slots 1 to 4");
    assert!(said("\"2.1\" = \"MU-8DI\"").contains("an ESI has no subslots; give SLOT=ID"));
    assert!(with_modules("1 = \"0x10\"\n2 = \"none\"\n").is_ok());
    // A slot without a default and with two modules that fit.
    let text =
        include_str!("../../../scripts/interop/files/made-up-coupler.xml").replace(" Default=\"1\"", "");
    let file = read("a.xml", text.into()).unwrap();
    let error = choose(&file, &DeviceChoice::default()).unwrap_err().to_string();
    assert!(error.starts_with("--module: slot 1 needs a module; choose one"), "{error}");
    // Indices that a slot moves too far.
    let text = include_str!("../../../scripts/interop/files/made-up-coupler.xml")
        .replace("SlotIndexIncrement=\"16\"", "SlotIndexIncrement=\"#xFFFF\"");
    let file = read("a.xml", text.into()).unwrap();
    let choice = DeviceChoice::from_toml("[modules]\n2 = \"MU-8DI\"").unwrap();
    let error = choose(&file, &choice).unwrap_err().to_string();
    assert_eq!(error, "--module: slot 2 moves index 0x6000 beyond 0xFFFF; leave it empty");
}
