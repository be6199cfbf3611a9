//! Emulates and drives each device that files offer, at both ends of one cable in virtual time, and compares all data both ways.
//!
//! ```sh
//! cargo run -p driven-device --example file_pairs -- FILE …
//! ```
//!
//! Prints a line for each device: data were exchanged at the shortest interval of the file, or why not. The first device of a file is
//! tried for 30 s, each other one for 2 s. A device with free slots gets as many of its modules as fit.

#![expect(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "the example reads files and measures"
)]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::process::ExitCode;

use device_files::{ChosenDevice, DeviceChoice, DeviceFile, Gsdml, ModulePlace, choose, read};
use driven_device::{DriveConfig, SignalType};
use emulated_device::{DeviceScript, EmulatedDevice};
use machine::{Duration, Instant};

#[expect(dead_code, reason = "the tests use the others")]
#[path = "../tests/drive/cell.rs"]
mod cell;

use cell::{DrivenPair, drive_config, drive_file, emulation_config};

/// Seconds of the exchange with the first device of a file, and with each other one.
const SECONDS: u64 = 30;
const SECONDS_OF_OTHERS: u64 = 2;

/// Devices of one file that are tried.
const MOST_DEVICES: usize = 400;

fn main() -> ExitCode {
    let mut is_whole = true;
    for path in std::env::args().skip(1) {
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) => {
                eprintln!("{path}: {error}");
                return ExitCode::FAILURE;
            }
        };
        let file = match read(&path, bytes) {
            Ok(file) => file,
            Err(error) => {
                println!("{path}\t-\tnot read: {}", error.finding);
                continue;
            }
        };
        for (number, (name, choice)) in offered(&file).into_iter().enumerate() {
            let start = std::time::Instant::now();
            let seconds = if number == 0 { SECONDS } else { SECONDS_OF_OTHERS };
            let outcome = exchange(&file, &choice, seconds).unwrap_or_else(|fault| {
                is_whole = false;
                fault
            });
            println!("{path}\t{name}\t{}\t{} ms", outcome.replace('\n', "; "), start.elapsed().as_millis());
        }
    }
    if is_whole { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Returns the devices that a file offers, by name.
fn offered(file: &DeviceFile) -> Vec<(String, DeviceChoice)> {
    let of = |name: &String, choice: DeviceChoice| (name.replace(char::is_control, " "), choice);
    let offered: Vec<_> = match file {
        DeviceFile::Gsdml(gsdml) => {
            let ids = gsdml.access_points.iter().map(|it| &it.module.id);
            ids.map(|id| of(id, with_modules(file, gsdml, id))).collect()
        }
        DeviceFile::Eds(eds) => {
            // One that only listens needs another one beside it.
            let listens = |it: &&device_files::EdsConnection| {
                !it.uses.contains(&device_files::ConnectionUse::ListenOnly)
            };
            let connections = eds.connections.iter().filter(listens).map(|it| it.number.to_string());
            let choice = |number: &String| DeviceChoice { connection: Some(number.clone()), ..empty() };
            connections.map(|number| of(&number, choice(&number))).collect()
        }
        DeviceFile::Esi(esi) => {
            let devices = esi.devices.iter().map(|device| {
                let is_twin =
                    |it: &&device_files::EsiDevice| it.kind == device.kind && it.revision == device.revision;
                let is_alone = esi.devices.iter().filter(is_twin).count() == 1;
                let code = format!("0x{:08X}", device.product_code);
                let choice = DeviceChoice {
                    device_name: Some(if is_alone { device.kind.clone() } else { code }),
                    revision: Some(device.revision),
                    ..empty()
                };
                of(&device.kind, choice)
            });
            devices.collect()
        }
    };
    offered.into_iter().take(MOST_DEVICES).collect()
}

fn empty() -> DeviceChoice {
    DeviceChoice::default()
}

/// Plugs modules into free slots, one of each kind, as long as the device takes them.
fn with_modules(file: &DeviceFile, gsdml: &Gsdml, access_point: &str) -> DeviceChoice {
    let mut choice = DeviceChoice { access_point: Some(access_point.to_owned()), ..empty() };
    let Some(access_point) = gsdml.access_point(access_point) else { return choice };
    let mut plugged = BTreeSet::new();
    for slot in access_point.physical_slots.iter().take(64) {
        let place = ModulePlace { slot, subslot: None };
        let fitting = access_point.modules.iter().filter(|it| it.allowed.contains(slot));
        for placement in fitting {
            let is_fixed = access_point.modules.iter().any(|it| it.fixed.contains(slot));
            if is_fixed || plugged.contains(&placement.id) {
                continue;
            }
            choice.modules.insert(place, placement.id.clone());
            let device = choose(file, &choice);
            let is_taken = device.is_ok_and(|device| {
                EmulatedDevice::new(device, DeviceScript::default(), emulation_config(), Instant::ZERO)
                    .is_ok()
            });
            if is_taken {
                plugged.insert(placement.id.clone());
                break;
            }
            choice.modules.remove(&place);
        }
    }
    choice
}

/// Returns the shortest interval that the file allows.
fn shortest(chosen: &ChosenDevice) -> Option<Duration> {
    match chosen {
        ChosenDevice::Gsdml(device) => {
            Some(Duration::from_nanos(31_250 * u64::from(device.min_device_interval)))
        }
        ChosenDevice::Eds(adapter) => {
            adapter.min_rpi_us.map(|micros| Duration::from_micros(u64::from(micros).max(1000)))
        }
        ChosenDevice::Esi(_) => Some(Duration::from_millis(1)),
    }
}

/// Writes a script by which each byte of the inputs changes each second.
fn input_script(device: &EmulatedDevice) -> String {
    let mut script = String::new();
    for place in whole_places(device) {
        let bits = device.places().0.iter().find(|it| it.place == place).map_or(0, |it| it.bits);
        for byte in 0..bits / 8 {
            let step = 1 + byte * 37 % 251;
            writeln!(
                script,
                "[[inputs]]\nplace = \"{place}\"\nbyte = {byte}\ntype = \"uint8\"\ncounter = {{ step = {step}, seconds = 1 }}"
            )
            .unwrap();
        }
    }
    script
}

/// Returns the places of the inputs that do not overlap.
fn whole_places(device: &EmulatedDevice) -> Vec<String> {
    let is_whole =
        |place: &&emulated_device::DataPlace| device.bus() != "EtherCAT" || place.place == "inputs";
    device.places().0.iter().filter(is_whole).map(|place| place.place.clone()).collect()
}

/// Exchanges data of a device, and compares them each second.
fn exchange(file: &DeviceFile, choice: &DeviceChoice, seconds: u64) -> Result<String, String> {
    let device = choose(file, choice).map_err(|error| {
        let text = error.to_string();
        format!("not chosen: {}", text.lines().next().unwrap_or_default())
    })?;
    let config = DriveConfig { interval: shortest(&device), ..drive_config() };
    let emulate = |script: &str| {
        let script = DeviceScript::from_toml(script).map_err(|error| format!("script: {error}"))?;
        EmulatedDevice::new(device.clone(), script, emulation_config(), Instant::ZERO)
            .map_err(|error| format!("not emulated: {error}"))
    };
    let emulated = emulate(&input_script(&emulate("")?))?;
    let driven = drive_file(file.clone(), device.clone(), driven_device::OutputScript::default(), &config)
        .map_err(|error| format!("not driven: {error}"))?;
    let mut pair = DrivenPair::between(driven, emulated);
    pair.run_to(3_000);
    if !pair.device().is_up() {
        let said = pair.texts();
        let said: BTreeSet<_> = said.iter().filter(|it| !it.starts_with("answer")).collect();
        return Err(format!("no connection: {said:?}"));
    }
    let before = pair.device().counters();
    let mut has_inputs = false;
    let mut has_outputs = false;
    for second in 0..seconds {
        set_outputs(&mut pair, second);
        pair.run_to(3_900 + 1_000 * second);
        let places = whole_places(pair.pair.b());
        let given: Vec<u8> =
            places.iter().flat_map(|place| pair.pair.b().input(place).unwrap_or_default().to_vec()).collect();
        let inputs = pair.device().inputs().map(|it| it.bytes().to_vec()).unwrap_or_default();
        if given != inputs {
            return Err(format!("after {second} s the device gave {given:02x?}, and {inputs:02x?} came"));
        }
        let sent = pair.device().outputs().bytes().to_vec();
        // Data of PROFIsafe alone never count.
        let has_plain = pair.device().signals().1.iter().any(|signal| !signal.is_safety);
        let (received, counts) = pair.pair.b().outputs();
        if !sent.is_empty() && (received != sent || has_plain && !counts) {
            return Err(format!(
                "after {second} s {sent:02x?} were sent, and the device has {received:02x?}"
            ));
        }
        has_inputs |= inputs.iter().any(|byte| *byte != 0);
        has_outputs |= sent.iter().any(|byte| *byte != 0);
    }
    let counters = pair.device().counters().since(&before);
    let said: Vec<_> =
        pair.texts().into_iter().filter(|it| !it.starts_with("answer") && it != "up").collect();
    if !said.is_empty() || counters.lost + counters.late + counters.malformed > 0 {
        return Err(format!("{counters:?}; {said:?}"));
    }
    let len = (pair.device().outputs().bytes().len(), pair.device().signals().0.len());
    Ok(format!(
        "exchanged: {} frames, {} output bytes{}, {} input signals{}",
        counters.received,
        len.0,
        if has_outputs || len.0 == 0 { "" } else { " that stay 0" },
        len.1,
        if has_inputs { "" } else { " that stay 0" }
    ))
}

/// Gives each output another value.
fn set_outputs(pair: &mut DrivenPair, second: u64) {
    let signals: BTreeMap<_, _> = pair.device().signals().1.iter().map(|it| (it.bit, it.clone())).collect();
    for (number, signal) in signals.into_values().enumerate() {
        let seed = (second + 1) * 37 + number as u64;
        let text = match signal.kind {
            _ if signal.is_safety => continue,
            SignalType::Bool => (seed % 2).to_string(),
            SignalType::Real => format!("{}.5", seed % 100),
            SignalType::Bytes => "5a".repeat(signal.bits.div_ceil(8)),
            SignalType::Unsigned | SignalType::Signed => {
                let most = signal.bits.min(7).saturating_sub(1) as u32;
                format!("0x{:x}", seed % (1 << most))
            }
        };
        // A name may be that of several signals, and a value may have a text of the file.
        let _ = pair.pair.command_a(|bus, _| bus.set(&signal.name, &text));
    }
}

#[test]
fn each_device_of_the_made_up_files_is_exchanged() {
    for (name, text) in [("a.eds", cell::EDS), ("a.xml", cell::GSDML), ("b.xml", cell::ESI)] {
        let file = read(name, text.into()).unwrap();
        for (device, choice) in offered(&file) {
            let outcome = exchange(&file, &choice, SECONDS);
            assert!(outcome.is_ok(), "{name} {device}: {outcome:?}");
        }
    }
}
