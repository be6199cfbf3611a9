//! Device descriptions that a real PLC imports to connect to the robot node: an EDS file for EtherNet/IP, a GSDML file for
//! PROFINET and an ESI file for EtherCAT; and a dissector by which Wireshark names the image's fields on all three.
//!
//! They are generated from the descriptions that the adapter, the IO-Device and the SubDevice themselves use
//! ([`protocol::stations`]), so they cannot differ from them. The files are in this crate's folder, where a person looks
//! for them; a test generates them again and compares, and writes them with `INSTA_UPDATE=always`. Other tests parse the
//! files and compare them with running machines: everything that a file promises is opened, connected and read.
//!
//! This is a crate of its own because it needs strings and dates: `protocol` is `no_std` and needs neither at run
//! time. No crate depends on this one.

pub mod eds;
pub mod esi;
pub mod gsdml;
mod members;
pub mod wireshark;
mod xml;

use protocol::stations::{ETHERCAT_ROBOT, ETHERNET_IP_ROBOT, PROFINET_ROBOT};

/// Date of the last change to the files' content.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Date {
    /// Year.
    pub year: u16,
    /// Month, from 1.
    pub month: u8,
    /// Day, from 1.
    pub day: u8,
}

/// Date of the last change to the files' content. It is part of a GSDML file's name, and an engineering system takes
/// the newest file.
pub const CHANGED: Date = Date { year: 2026, month: 11, day: 27 };

/// Returns every device file: its name and its content.
#[must_use]
pub fn files() -> [(String, String); 3] {
    [
        ("skillbench-robot.eds".to_owned(), eds::write(&ETHERNET_IP_ROBOT, CHANGED)),
        (gsdml::file_name(&PROFINET_ROBOT, CHANGED), gsdml::write(&PROFINET_ROBOT)),
        ("skillbench-robot.xml".to_owned(), esi::write(&ETHERCAT_ROBOT)),
    ]
}
