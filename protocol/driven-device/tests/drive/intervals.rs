//! Packet intervals of EtherNet/IP, for each direction.

use driven_device::{DriveConfig, DriveError, OutputScript};
use machine::Duration;

use crate::cell::{Chosen, DrivenPair, EDS, chosen, devices, drive_config, drive_file};

const fn millis(millis: u64) -> Option<Duration> {
    Some(Duration::from_millis(millis))
}

/// Returns the frames that the scanner sent and received in ten seconds of an exchange.
fn frames_in_ten_seconds(config: &DriveConfig) -> (u64, u64) {
    let mut cell = DrivenPair::of(&devices()[0], "", "", config);
    cell.run_to(3_000);
    assert!(cell.pair.a().devices()[0].is_up(), "{:?}", cell.texts());
    let before = cell.pair.a().devices()[0].counters();
    cell.run_to(13_000);
    let counters = cell.pair.a().devices()[0].counters().since(&before);
    assert_eq!((counters.lost, counters.late), (0, 0));
    (counters.sent, counters.received)
}

/// Returns why these settings are refused.
fn refusal(device: Chosen, config: &DriveConfig) -> DriveError {
    drive_file(device.file, device.device, OutputScript::default(), config).unwrap_err()
}

#[test]
fn each_direction_has_its_own_packet_interval() {
    let interval = millis(10);
    for (output_interval, input_interval, expected) in [
        (None, None, (1_000, 1_000)),
        (millis(4), millis(20), (2_500, 500)),
        (millis(50), millis(2), (200, 5_000)),
        (millis(4), None, (2_500, 1_000)),
        (None, millis(4), (1_000, 2_500)),
    ] {
        let config = DriveConfig { interval, output_interval, input_interval, ..drive_config() };
        let (sent, received) = frames_in_ten_seconds(&config);
        let is_near = |found: u64, expected: u64| found.abs_diff(expected) <= 1;
        assert!(
            is_near(sent, expected.0) && is_near(received, expected.1),
            "{sent} and {received}; expected {expected:?}"
        );
    }
}

#[test]
fn an_interval_outside_of_the_range_of_its_direction_is_refused_with_the_range() {
    // The outputs get a range of their own: 5 to 50 ms.
    let text = EDS
        .replace(
            "[Assembly]",
            "        Param2 = 0,,,0x0000,0xC8,4,\"RPI\",\"us\",\"\",5000,50000,10000,,,,,,,,,;\n[Assembly]",
        )
        .replacen("Param1,4,Assem102", "Param2,4,Assem102", 1);
    let device = chosen("a.eds", &text, "");
    let said = |output_interval, input_interval| {
        let config = DriveConfig { output_interval, input_interval, ..drive_config() };
        refusal(device.clone(), &config).to_string()
    };
    let of_outputs = "interval 2000 us of the outputs: the file allows 5000 to 50000 us; give one of these";
    assert_eq!(said(millis(2), millis(2)), of_outputs);
    let of_inputs = "interval 600000 us of the inputs: the file allows 2000 to 500000 us; give one of these";
    assert_eq!(said(millis(50), millis(600)), of_inputs);
    let both = DriveConfig { interval: millis(2), ..drive_config() };
    let of_both = "interval 2000 us of both directions: the file allows 5000 to 50000 us; give one of these";
    assert_eq!(refusal(device.clone(), &both).to_string(), of_both);
    // What only the inputs may have, they get.
    let config = DriveConfig { output_interval: millis(5), input_interval: millis(500), ..drive_config() };
    let made = drive_file(device.file, device.device, OutputScript::default(), &config);
    assert!(made.is_ok(), "{made:?}");
}

#[test]
fn an_interval_for_each_direction_is_refused_on_the_other_buses() {
    let config = DriveConfig { input_interval: millis(10), ..drive_config() };
    for device in devices().into_iter().skip(1) {
        let said = refusal(device, &config).to_string();
        assert_eq!(
            said,
            "an interval for each direction: only EtherNet/IP has it; give one interval for both"
        );
    }
}
