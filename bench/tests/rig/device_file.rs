//! Runs on a real network with the robot's device from a file.

#[path = "../runs/foreign_devices.rs"]
mod foreign_devices;

pub(crate) use foreign_devices::with_lines;

use crate::process::Bench;

pub(crate) fn a_foreign_device_of_a_file_carries_the_image_in_a_real_run_on_every_bus() {
    for (setup, choice) in foreign_devices::CHOICES {
        let ended = Bench::start_with_device(setup, &foreign_devices::file(setup), choice).wait();
        assert!(ended.status.success(), "{setup}: {}: {}", ended.status, ended.stderr);
        assert_eq!(ended.samples.lines().count(), 2);
    }
}
