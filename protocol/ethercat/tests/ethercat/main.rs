//! SubDevices under a MainDevice that others wrote, and under one by main_device, in virtual time.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by a panic")]
#![expect(unreachable_pub, reason = "a test program has no users")]

mod cables;
mod captured;
mod clocks;
mod devices;
mod eeprom;
mod faults;
mod faulty;
mod foe;
mod fuzz;
mod limits;
mod main_device;
mod operation;
mod pdo_configuration;
mod raw_main_device;
mod sdo;
mod states;
mod working_counters;
