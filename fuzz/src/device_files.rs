//! Device descriptions of any maker: they are read, or refused in words.

use ::device_files::{DeviceFile, read};

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
