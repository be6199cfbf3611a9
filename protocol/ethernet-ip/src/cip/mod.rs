//! CIP explicit messages: paths, requests, replies and their statuses (volume 1).

mod intervals;
mod key;
mod message;
mod path;
mod status;
mod violation;

pub use intervals::{AcceptableIntervals, IntervalLimit};
pub use key::{ElectronicKey, KeyMismatch, Revision};
pub use message::{Reply, Request, emit_refusal, emit_reply, service};
pub use path::{Application, Logical, Path, PathError, Segment, Target, write_logical};
pub use status::{Extended, General};
pub use violation::{Extra, Status, Violation};

/// Class codes of the objects that the stack supports (volume 1, table 5-1.1; volume 2, chapter 5).
pub mod class {
    /// Identity.
    pub const IDENTITY: u32 = 0x01;
    /// Message Router.
    pub const MESSAGE_ROUTER: u32 = 0x02;
    /// Assembly.
    pub const ASSEMBLY: u32 = 0x04;
    /// Connection Manager.
    pub const CONNECTION_MANAGER: u32 = 0x06;
    /// QoS.
    pub const QOS: u32 = 0x48;
    /// Port.
    pub const PORT: u32 = 0xF4;
    /// TCP/IP Interface.
    pub const TCP_IP_INTERFACE: u32 = 0xF5;
    /// Ethernet Link.
    pub const ETHERNET_LINK: u32 = 0xF6;
}
