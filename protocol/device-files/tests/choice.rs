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
