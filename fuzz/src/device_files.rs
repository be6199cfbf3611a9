//! Device descriptions of any maker: they are read, or refused in words.

use ::device_files::{DeviceChoice, DeviceFile, choose, read};

/// Reads a GSDML file.
pub(crate) fn gsdml(data: &[u8]) {
    attack("GSDML-V2.35-fuzz.xml", data, |file| matches!(file, DeviceFile::Gsdml(_)));
}

/// Reads an EDS.
pub(crate) fn eds(data: &[u8]) {
    attack("fuzz.eds", data, |file| matches!(file, DeviceFile::Eds(_)));
}

/// Reads an ESI file.
pub(crate) fn esi(data: &[u8]) {
    attack("fuzz.xml", data, |file| matches!(file, DeviceFile::Esi(_)));
}

/// Chooses a device: a choice as TOML, a zero, and a file. The choice of a device makes the same device again.
pub(crate) fn choice(data: &[u8]) {
    let end = data.iter().position(|byte| *byte == 0).unwrap_or(0);
    let (choice, file) = data.split_at(end);
    let choice = std::str::from_utf8(choice).ok().and_then(|text| DeviceChoice::from_toml(text).ok());
    let Ok(file) = read("GSDML-V2.35-fuzz.xml", file.get(1..).unwrap_or_default().to_vec()) else { return };
    match choose(&file, &choice.unwrap_or_default()) {
        Ok(chosen) => {
            let written = chosen.choice().to_toml();
            let again =
                DeviceChoice::from_toml(&written).unwrap_or_else(|error| panic!("{written}: {error}"));
            assert!(choose(&file, &again).is_ok_and(|again| again == chosen), "{written}");
        }
        Err(error) => assert!(error.to_string().starts_with("--"), "{error}"),
    }
}

/// Reads bytes as a file. Only what is of the target's format is worth its JSON; the others have a target of their own.
fn attack(name: &str, data: &[u8], is_own: fn(&DeviceFile) -> bool) {
    match read(name, data.to_vec()) {
        Ok(file) if is_own(&file) => {
            let written = serde_json::to_string(&file).unwrap_or_else(|error| panic!("written: {error}"));
            let format = serde_json::from_str::<serde_json::Value>(&written);
            assert!(format.is_ok_and(|value| value.get("format").is_some()), "{written}");
        }
        Ok(_) => {}
        Err(error) => assert!(error.to_string().starts_with(name), "{error}"),
    }
}
