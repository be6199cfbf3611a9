//! Ports and the real-time driver: what runs a [`machine::Machine`] on Linux.
//!
//! From the bottom up: an [`Interface`] is a network interface by name; an [`OpenPort`] is a socket on it that a machine
//! knows as a [`machine::Port`]; a [`Driver`] is the loop that gives one machine, on one interface or several, time and
//! frames; a [`CyclicThread`] runs that loop on a thread of its own, with real-time scheduling where the host allows it, and talks to other threads over
//! wait-free rings. [`namespace`], [`veth`] and [`bridge`] make cables and switches between processes of one host, also for an ordinary user;
//! [`macvlan`] gives an interface further MAC addresses, for several stations of one process;
//! [`impaired`] makes a cable that loses, delays, duplicates or corrupts frames. [`Recorder`] writes the frames that pass
//! an interface into a capture.
//!
//! This is the only crate of the workspace with `unsafe` code.

#![expect(
    unsafe_code,
    reason = "system calls that neither rustix nor socket2 wraps; each use says why it is sound"
)]
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod allocation;
mod arrivals;
pub mod bridge;
pub mod capabilities;
pub mod clock;
mod cyclic_thread;
mod driver;
mod dscp;
mod ethernet;
mod former_address;
pub mod handover;
pub mod impaired;
mod interface;
mod interfaces;
mod link_changes;
pub mod macvlan;
pub mod namespace;
mod neighbours;
mod notifier;
mod open_port;
mod owner;
mod pace;
mod packet_ring;
mod packet_socket;
mod parts;
mod plain;
mod port_holders;
mod received_message;
mod recorder;
mod rtnetlink;
pub mod scheduling;
mod signals;
mod socket_option;
mod stream;
mod udp;
pub mod veth;
mod wait;
pub mod wakeups;

pub use arrivals::{Arrival, ArrivalLog};
pub use cyclic_thread::{CyclicThread, Finished, RingFull, StartError, Task};
pub use driver::{Driver, DriverError};
pub use former_address::FormerAddress;
pub use handover::NoticeSender;
pub use interface::{Interface, InterfaceError};
pub use link_changes::LinkChanges;
pub use notifier::Notifier;
pub use open_port::{OpenPort, PortError, Received};
pub use owner::{Owner, Statistics};
pub use port_holders::Transport;
pub use recorder::{Recorder, RecorderError};
pub use signals::{StopSignal, StopSignals, exit_on_stop, handle_stop, ignores_hang_up};
pub use stream::StreamStatistics;
