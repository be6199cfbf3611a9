//! What a real PLC imports to talk to the robot node: an EDS file for EtherNet/IP, a GSDML file for PROFINET.
//!
//! Both are made from the descriptions that the adapter and the IO-Device themselves run by
//! ([`protocol::stations`]), so that they cannot say anything else.
//! The files stand beside this crate, where a person looks for them; a test makes them anew and compares, and writes
//! them where `INSTA_UPDATE=always` asks for it. Other tests read the files back and hold them against running
//! machines: what a file promises is opened, connected and read.
//!
//! This is a crate of its own because it makes strings and dates: `protocol` is `no_std` and has no use for either at
//! run time. Nothing depends on this crate.

pub mod eds;
pub mod gsdml;

use protocol::stations::{ETHERNET_IP_ROBOT, PROFINET_ROBOT};

/// Year, month and day of the last change to what the files say.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Date {
    /// Year.
    pub year: u16,
    /// Month, from 1.
    pub month: u8,
    /// Day, from 1.
    pub day: u8,
}

/// The last change to what the files say. A GSDML file's name has it, and an engineering system takes the newest.
pub const CHANGED: Date = Date { year: 2026, month: 11, day: 21 };

/// Every file: its name, and what is in it.
#[must_use]
pub fn files() -> [(String, String); 2] {
    [
        ("skillbench-robot.eds".to_owned(), eds::write(&ETHERNET_IP_ROBOT, CHANGED)),
        (gsdml::file_name(&PROFINET_ROBOT, CHANGED), gsdml::write(&PROFINET_ROBOT)),
    ]
}
