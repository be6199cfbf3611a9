//! Data both ways, by name.

use crate::cell::{DrivenPair, devices, drive_config};
use driven_device::{DriveConfig, DriveEvent};
use machine::Duration;

/// Returns for each bus: the script of the device, that of the outputs, and the names of an input and of an echoed output.
fn scripts() -> [(&'static str, &'static str, &'static str); 3] {
    [
        (
            "[[inputs]]\nplace = \"101\"\nbyte = 4\necho = { place = \"102\" }\n\
             [[inputs]]\nplace = \"101\"\ntype = \"uint32\"\ncounter = { seconds = 0.001 }\n",
            "Outputs",
            "102",
        ),
        (
            "[[inputs]]\nplace = \"2.1\"\necho = { place = \"2.1\" }\n\
             [[inputs]]\nplace = \"1.1\"\ntype = \"uint8\"\ncounter = { seconds = 0.001 }\n",
            "2.1/2 analog outputs",
            "2.1",
        ),
        (
            "[[inputs]]\nplace = \"0x6000:11\"\necho = { place = \"0x7000:01\" }\n",
            "Outputs/Output",
            "0x7000:01",
        ),
    ]
}

#[test]
fn for_30_seconds_each_device_shows_what_its_controller_sets_without_a_gap() {
    for (chosen, (device_script, output, place)) in devices().iter().zip(scripts()) {
        let mut cell = DrivenPair::of(chosen, device_script, "", &drive_config());
        cell.run_to(3_000);
        assert!(cell.pair.a().devices()[0].is_up(), "{}: {:?}", cell.pair.a().bus(), cell.events);
        let before = cell.pair.a().devices()[0].counters();
        let mut compared = 0;
        for step in 0..300_u64 {
            let digits = format!("{:04x}", step * 37 % 65_536);
            let is_bytes = cell.pair.a().devices()[0].outputs().find(output).unwrap().bits == 32;
            let value =
                if is_bytes { format!("{digits}{digits}") } else { format!("{}", step * 37 % 32_768) };
            cell.pair.command_a(|device, _| device.set(output, &value)).unwrap();
            // Longer than the interval of each bus, both ways and the device's tick.
            cell.run_to(3_000 + 100 * (step + 1));
            let at_device = cell.output(place).unwrap();
            let bytes = cell.pair.a().devices()[0].outputs().bytes().to_vec();
            assert_eq!(at_device, bytes, "{} at step {step}", cell.pair.a().bus());
            let inputs = cell.pair.a().devices()[0].inputs().unwrap().bytes().to_vec();
            let echoed = inputs.windows(2).any(|pair| pair == &at_device[..2]);
            assert!(echoed, "{}: {at_device:02x?} is not in {inputs:02x?}", cell.pair.a().bus());
            compared += 1;
        }
        let counters = cell.pair.a().devices()[0].counters().since(&before);
        assert_eq!((compared, counters.lost, counters.late, counters.malformed), (300, 0, 0, 0));
        let arrivals = *cell.pair.a().devices()[0].arrivals();
        assert!(counters.received > 2_900 && arrivals.longest < 2 * arrivals.mean(), "{arrivals:?}");
    }
}

#[test]
fn outputs_count_only_once_they_run() {
    for (chosen, (device_script, output, place)) in devices().iter().zip(scripts()) {
        let config = DriveConfig { is_running: false, ..drive_config() };
        let mut cell = DrivenPair::of(chosen, device_script, "", &config);
        let is_bytes = cell.pair.a().devices()[0].outputs().find(output).unwrap().bits == 32;
        let value = if is_bytes { "01020304" } else { "258" };
        cell.pair.command_a(|device, _| device.set(output, value)).unwrap();
        cell.run_to(3_000);
        let bus = cell.pair.a().bus();
        assert!(
            cell.pair.a().devices()[0].is_up() && cell.pair.a().devices()[0].inputs().is_some(),
            "{bus}: {:?}",
            cell.events
        );
        let ignored = cell.output(place).is_none_or(|bytes| bytes.iter().all(|byte| *byte == 0));
        assert!(ignored, "{bus}: {:?}", cell.output(place));
        cell.pair.command_a(|device, _| device.run(None, true)).unwrap();
        cell.run_to(4_000);
        assert_eq!(
            cell.output(place).as_deref(),
            Some(cell.pair.a().devices()[0].outputs().bytes()),
            "{bus}"
        );
        assert!(cell.events.contains(&DriveEvent::Running(true)) && cell.pair.a().devices()[0].is_up());
        let downs = cell.events.iter().filter(|event| matches!(event, DriveEvent::Down(..))).count();
        assert_eq!(downs, 0, "{bus}: {:?}", cell.events);
        cell.pair.command_a(|device, _| device.run(None, false)).unwrap();
        cell.run_to(5_000);
        let ignored = cell.output(place).is_none_or(|bytes| bytes.iter().all(|byte| *byte == 0));
        assert!(
            ignored && cell.pair.a().devices()[0].is_up(),
            "{bus} after the stop: {:?}",
            cell.output(place)
        );
    }
}

#[test]
fn a_script_drives_outputs_over_time_and_starts_them() {
    for (chosen, (device_script, output, place)) in devices().iter().zip(scripts()).skip(1) {
        let script = format!("run = 2.0\n[[outputs]]\nname = \"{output}\"\ntable = [[0, 1], [2.5, 770]]\n");
        let config = DriveConfig { is_running: false, ..drive_config() };
        let mut cell = DrivenPair::of(chosen, device_script, &script, &config);
        cell.run_to(1_900);
        assert!(cell.output(place).is_none_or(|bytes| bytes.iter().all(|byte| *byte == 0)));
        cell.run_to(3_500);
        assert_eq!(cell.output(place).as_deref(), Some(cell.pair.a().devices()[0].outputs().bytes()));
        let set = cell.pair.a().devices()[0].outputs();
        assert_eq!(set.value(set.find(output).unwrap()).to_string(), "770", "{}", cell.pair.a().bus());
    }
}

#[test]
fn a_device_that_goes_away_is_reported_and_connected_again_when_it_returns() {
    for (chosen, (device_script, ..)) in devices().iter().zip(scripts()) {
        let mut cell = DrivenPair::of(chosen, device_script, "", &drive_config());
        cell.run_to(3_000);
        cell.pair.set_cut(true);
        cell.run_to(5_000);
        let bus = cell.pair.a().bus();
        assert!(
            !cell.pair.a().devices()[0].is_up() && cell.pair.a().devices()[0].inputs().is_none(),
            "{bus}"
        );
        assert!(cell.events.iter().any(|event| matches!(event, DriveEvent::Down(..))), "{bus}");
        cell.pair.set_cut(false);
        cell.run_to(20_000);
        assert!(
            cell.pair.a().devices()[0].is_up() && cell.pair.a().devices()[0].inputs().is_some(),
            "{bus}: {:?}",
            cell.texts()
        );
    }
}

#[test]
fn inputs_are_reported_when_they_change_and_not_more_often_than_wanted() {
    let chosen = &devices()[0];
    let config = DriveConfig { report_every: Duration::from_millis(250), ..drive_config() };
    let mut cell = DrivenPair::of(chosen, scripts()[0].0, "", &config);
    cell.run_to(10_000);
    let reports = cell.events.iter().filter(|event| matches!(event, DriveEvent::Inputs)).count();
    assert!((30..=40).contains(&reports), "{reports} in ten seconds");
    assert!(cell.input("Inputs").is_some() && cell.device().input("nothing").is_none());
}
