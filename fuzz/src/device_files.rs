//! Device descriptions of any maker: they are read, or refused in words.

use std::net::Ipv4Addr;

use ::device_files::{
    ChosenDevice, DeviceChoice, DeviceFile, FoundModule, choose, choose_found, choose_head, read,
};
use driven_device::{BusConfig, DriveConfig, DrivenBus, FileDevice, OutputScript, found_modules};
use ethercat_subdevice::sii_checksum;
use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, Machine as _};

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

/// Reads the dump of an EEPROM whose checksum is put right, and chooses its device.
pub(crate) fn eeprom(data: &[u8]) {
    let mut dump = data.to_vec();
    let Some([head @ .., sum, zero]) = dump.first_chunk_mut::<16>() else { return };
    (*sum, *zero) = (sii_checksum(head), 0);
    attack("fuzz.bin", &dump, |file| matches!(file, DeviceFile::Esi(_)));
    if let Ok(file) = read("fuzz.bin", dump)
        && let Err(error) = choose(&file, &DeviceChoice::default())
    {
        assert!(!error.to_string().is_empty());
    }
}

/// Returns the text before the first zero, and the file after it if it is one.
fn text_and_file(data: &[u8]) -> Option<(&[u8], DeviceFile)> {
    let end = data.iter().position(|byte| *byte == 0).unwrap_or(0);
    let (text, file) = data.split_at(end);
    let file = read("GSDML-V2.35-fuzz.xml", file.get(1..).unwrap_or_default().to_vec()).ok()?;
    Some((text, file))
}

fn choice_of(text: &[u8]) -> DeviceChoice {
    let choice = std::str::from_utf8(text).ok().and_then(|text| DeviceChoice::from_toml(text).ok());
    choice.unwrap_or_default()
}

/// Chooses a device: a choice as TOML, a zero, and a file. The choice of a device makes the same device again.
pub(crate) fn choice(data: &[u8]) {
    let Some((choice, file)) = text_and_file(data) else { return };
    match choose(&file, &choice_of(choice)) {
        Ok(chosen) => {
            let written = chosen.choice().to_toml();
            let again =
                DeviceChoice::from_toml(&written).unwrap_or_else(|error| panic!("{written}: {error}"));
            assert!(choose(&file, &again).is_ok_and(|again| again == chosen), "{written}");
        }
        Err(error) => assert!(error.to_string().starts_with("--"), "{error}"),
    }
}

/// Chooses an IO-Device by the modules that it reports: the record that lists them, in hexadecimal digits, a zero, and a GSDML.
/// What is not left out is what was reported.
pub(crate) fn found(data: &[u8]) {
    let Some((digits, DeviceFile::Gsdml(gsdml))) = text_and_file(data) else { return };
    let digit = |byte: &u8| char::from(*byte).to_digit(16).unwrap_or(0) as u8;
    let record: Vec<u8> =
        digits.chunks(2).map(|pair| pair.iter().fold(0, |byte, it| byte << 4 | digit(it))).collect();
    let Some(found) = found_modules(&record) else { return };
    let choice = DeviceChoice::default();
    let Ok(head) = choose_head(&gsdml, &choice) else { return };
    let Ok((device, unknown)) = choose_found(&gsdml, &choice, &found) else { return };
    let is_reported = |slot, ident| found.iter().any(|it: &FoundModule| (it.slot, it.ident) == (slot, ident));
    for module in &device.modules {
        let is_preset = head.modules.iter().any(|it| it.slot == module.slot);
        assert!(is_preset || is_reported(module.slot, module.ident), "slot {} is not reported", module.slot);
    }
    let left_out = found.iter().filter(|it| device.modules.iter().all(|module| module.slot != it.slot));
    assert!(left_out.count() <= unknown.len(), "a module is left out without a word");
}

/// Drives a device: a choice as TOML, a zero, and a file. It is refused in words, or sends until nobody answers, and each of its
/// names is found.
pub(crate) fn driven(data: &[u8]) {
    let Some((choice, file)) = text_and_file(data) else { return };
    let Ok(chosen) = choose(&file, &choice_of(choice)) else { return };
    if let ChosenDevice::Gsdml(device) = &chosen
        && device.modules.len() > MOST_DRIVEN
    {
        return;
    }
    let bus = BusConfig {
        mac: Mac([2, 0, 0, 0, 0, 1]),
        address: Some(Ipv4Addr::new(192, 168, 64, 1)),
        mask: Ipv4Addr::new(255, 255, 255, 0),
        seed: 1,
    };
    let config = DriveConfig {
        device_address: Some(Ipv4Addr::new(192, 168, 64, 2)),
        station_name: Some("device".to_owned()),
        position: None,
        interval: None,
        output_interval: None,
        input_interval: None,
        is_running: true,
        report_every: Duration::from_millis(100),
    };
    let device =
        FileDevice { name: "device".to_owned(), file, chosen, script: OutputScript::default(), config };
    let mut bus = match DrivenBus::new(vec![device], &bus, Instant::ZERO) {
        Ok(bus) => bus,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    let Some(device) = bus.devices().first() else { return };
    let (inputs, outputs) = device.signals();
    let names: Vec<_> = outputs.iter().map(|signal| signal.name.clone()).collect();
    assert!(inputs.iter().chain(outputs).all(|signal| signal.bits > 0), "a signal without bits");
    let parameters: Vec<_> = device.parameters().iter().map(|it| it.signal.name.clone()).collect();
    for name in &names {
        let _ = bus.set(name, "1");
    }
    for name in parameters.iter().take(16) {
        assert!(bus.read_parameter(name).is_ok(), "{name}");
    }
    let mut buf = vec![0; FRAME_CAPACITY];
    let mut now = Instant::ZERO;
    while let Some(due) = bus.poll_timeout().filter(|due| *due <= Instant::from_millis(20)) {
        now = now.max(due);
        bus.handle_timeout(now);
        while bus.poll_transmit(now, &mut buf).is_some() {}
        while bus.poll_stream().is_some() {}
        while bus.poll_event().is_some() {}
    }
}

/// Largest number of modules of a device that is driven here: its description stays in memory.
const MOST_DRIVEN: usize = 64;

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
