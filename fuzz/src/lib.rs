//! What a fuzzer does with the bytes that it makes: one function for each thing that takes bytes from outside.
//!
//! The stations of the buses are attacked in pairs, in virtual time. The bytes are the choices of a stranger on the same switch
//! (`virtual_time::hostile`), and the pair must behave byte for byte and instant for instant as without it. A stranger
//! that forges its partner's address may end a connection; then only a panic is a failure.
//!
//! `scripts/dev.sh fuzz` runs all of them; each file of `fuzz/corpus` is also a test of the workspace.

mod attack;
mod capture;
mod device_files;
mod ethercat;
mod ethernet_ip;
mod files;
mod lone;
mod mailbox;
mod profinet;
mod robot;

use protocol_linux::allocation::{self, AllocationCounter};

/// Counts what a target allocates.
#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

/// What is done with the bytes.
pub type Target = fn(&[u8]);

/// All targets by name.
pub const TARGETS: [(&str, Target); 27] = [
    ("device", profinet::device),
    ("controller", profinet::controller),
    ("adapter", ethernet_ip::adapter),
    ("scanner", ethernet_ip::scanner),
    ("blocks", profinet::blocks),
    ("subdevice", ethercat::subdevice),
    ("mailbox", mailbox::mailbox),
    ("dcp", lone::dcp),
    ("discovery", lone::discovery),
    ("reader", lone::reader),
    ("setter", lone::setter),
    ("robot", robot::robot),
    ("trajectory", robot::trajectory),
    ("setup", files::setup),
    ("application", files::application),
    ("control", files::control),
    ("motions", files::motions),
    ("records", files::records),
    ("gsdml", device_files::gsdml),
    ("eds", device_files::eds),
    ("esi", device_files::esi),
    ("eeprom", device_files::eeprom),
    ("choice", device_files::choice),
    ("found", device_files::found),
    ("driven", device_files::driven),
    ("capture", capture::capture),
    ("samples", files::samples),
];

/// Returns this thread's heap allocations so far.
fn allocations() -> u64 {
    assert!(allocation::is_armed() || allocation::arm(), "allocations are not counted");
    allocation::count()
}
