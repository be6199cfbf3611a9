//! SubDevices in virtual time, under the MainDevice of ethercrab and under a simple one that sends single datagrams.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by a panic")]
#![expect(unreachable_pub, reason = "a test program has no users")]

mod cables;
mod captured;
mod clocks;
mod coe;
mod devices;
mod eeprom;
mod faults;
mod faulty;
mod foe;
mod fuzz;
mod limits;
mod mailbox;
mod main_device;
mod operation;
mod pdo_configuration;
mod raw_main_device;
mod registers;
mod sdo;
mod segment;
mod states;
mod synchronisation;
mod without_outputs;
mod working_counters;
