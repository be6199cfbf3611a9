//! Devices of our own files in virtual time: what a script says is what the stack sends.

#![expect(clippy::unwrap_used, reason = "a test")]

use std::net::Ipv4Addr;

use device_files::{ChosenDevice, DeviceChoice, choose, read};
use emulated_device::{DeviceScript, EmulatedDevice, EmulationConfig, EmulationError};
use machine::ethernet::Mac;
use machine::{Duration, Instant, Machine as _};

fn config() -> EmulationConfig {
    EmulationConfig {
        mac: Mac([2, 0, 0, 0, 0, 2]),
        address: Some(Ipv4Addr::new(192, 168, 64, 2)),
        mask: Ipv4Addr::new(255, 255, 255, 0),
        gateway: Ipv4Addr::UNSPECIFIED,
        station_name: None,
        permanent: None,
        serial_number: 7,
        first_id: 1,
    }
}

fn ours() -> impl Iterator<Item = ChosenDevice> {
    devices::files()
        .into_iter()
        .map(|(name, text)| choose(&read(&name, text.into()).unwrap(), &DeviceChoice::default()).unwrap())
}

fn emulate(chosen: ChosenDevice, script: &str) -> Result<EmulatedDevice, EmulationError> {
    EmulatedDevice::new(chosen, DeviceScript::from_toml(script).unwrap(), config(), Instant::ZERO)
}

fn at(device: &mut EmulatedDevice, millis: u64) {
    device.handle_timeout(Instant::ZERO + Duration::from_millis(millis));
}

/// Returns the place of all inputs of a device, and its first outputs.
fn places(device: &EmulatedDevice) -> (String, String) {
    let (inputs, outputs) = device.places();
    (inputs[0].place.clone(), outputs[0].place.clone())
}

#[test]
fn each_of_our_files_is_a_device_with_256_bytes_each_way() {
    for chosen in ours() {
        let device = emulate(chosen, "").unwrap();
        let (inputs, outputs) = device.places();
        assert_eq!((inputs[0].bits, outputs[0].bits), (2048, 2048), "{}", device.bus());
    }
}

#[test]
fn inputs_follow_the_script_in_the_byte_order_of_each_bus() {
    for chosen in ours() {
        let (place, _) = places(&emulate(chosen.clone(), "").unwrap());
        let script = format!(
            "[[inputs]]\nplace = \"{place}\"\ntype = \"uint16\"\nvalue = 258\n\
             [[inputs]]\nplace = \"{place}\"\nbyte = 2\ntype = \"uint8\"\ncounter = {{ step = 3, seconds = 0.01 }}\n\
             [[inputs]]\nplace = \"{place}\"\nbyte = 3\ntype = \"int8\"\nramp = {{ from = -10, to = 10, seconds = 0.2 }}\n\
             [[inputs]]\nplace = \"{place}\"\nbyte = 4\nbit = 7\ntype = \"bool\"\ntable = [[0, 0], [0.05, 1]]\n"
        );
        let mut device = emulate(chosen, &script).unwrap();
        let ordered = if device.bus() == "PROFINET" { [1, 2] } else { [2, 1] };
        let mut first = |millis| {
            at(&mut device, millis);
            device.input(&place).unwrap()[..5].to_vec()
        };
        assert_eq!(first(0), [ordered[0], ordered[1], 0, 0xF6, 0]);
        assert_eq!(first(100), [ordered[0], ordered[1], 30, 0, 0x80]);
    }
}

#[test]
fn stuck_inputs_keep_their_value_until_the_fault_ends() {
    for chosen in ours() {
        let (place, _) = places(&emulate(chosen.clone(), "").unwrap());
        let script = format!(
            "[[inputs]]\nplace = \"{place}\"\ntype = \"uint8\"\ncounter = {{ seconds = 0.001 }}\n\
             [[faults]]\nat = 0.01\nseconds = 0.02\nkind = \"stuck_inputs\"\n"
        );
        let mut device = emulate(chosen, &script).unwrap();
        let values: Vec<u8> = (0..40)
            .map(|millis| {
                at(&mut device, millis);
                device.input(&place).unwrap()[0]
            })
            .collect();
        assert_eq!((values[9], values[10], values[29], values[31]), (9, 9, 9, 31));
    }
}

#[test]
fn a_script_that_names_what_the_device_does_not_have_is_refused_with_what_it_has() {
    for chosen in ours() {
        let (place, _) = places(&emulate(chosen.clone(), "").unwrap());
        let input =
            |place: &str, rest: &str| format!("[[inputs]]\nplace = \"{place}\"\ntype = \"uint16\"\n{rest}");
        let other = input("nowhere", "value = 1");
        let error = emulate(chosen.clone(), &other).unwrap_err().to_string();
        assert!(
            error.contains("`nowhere` is not in the device; choose from") && error.contains(&place),
            "{error}"
        );
        for wrong in [input(&place, "byte = 255\nvalue = 1"), input(&place, "byte = 4294967295\nvalue = 1")] {
            assert!(emulate(chosen.clone(), &wrong).unwrap_err().to_string().contains("correct the byte"));
        }
        let echo = input(&place, "echo = { place = \"nowhere\" }");
        assert!(emulate(chosen.clone(), &echo).is_err());
    }
}

#[test]
fn a_fault_of_another_bus_is_refused() {
    for chosen in ours() {
        let is_profinet = matches!(chosen, ChosenDevice::Gsdml(_));
        let is_ethercat = matches!(chosen, ChosenDevice::Esi(_));
        let accepts = |kind: &str| {
            emulate(chosen.clone(), &format!("[[faults]]\nat = 1\nkind = \"{kind}\"\nslot = 1\n")).is_ok()
        };
        for kind in ["silent", "slow", "refuse", "wrong_identity", "wrong_size", "stuck_inputs"] {
            assert!(accepts(kind), "{kind}");
        }
        for kind in ["alarm", "module_gone"] {
            assert_eq!(accepts(kind), is_profinet, "{kind}");
        }
        for kind in ["emergency", "out_of_op", "working_counter"] {
            assert_eq!(accepts(kind), is_ethercat, "{kind}");
        }
    }
}
