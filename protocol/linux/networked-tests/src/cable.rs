//! A cable between two networks that carries frames from the first one on.

use std::net::Ipv4Addr;

use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Interface, veth};

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// One end of a cable.
#[derive(Clone, Copy, Debug)]
pub struct End<'a> {
    /// The network that it leads into.
    pub network: &'a NetworkNamespace,
    /// The name of its interface there.
    pub name: &'a str,
    /// The address of the interface, in a network of 256 addresses; `None` for an interface without one.
    pub address: Option<Ipv4Addr>,
}

/// Creates a cable, both ends of which carry frames from the first one on.
///
/// # Panics
///
/// The kernel refuses a cable, or its ends do not come up.
#[expect(clippy::expect_used, reason = "a test without its cable fails")]
pub fn cable(ends: [End<'_>; 2]) {
    let [a, b] = ends;
    veth::connect(a.network, a.name, b.network, b.name).expect("a veth pair");
    for end in ends {
        at(end, |interface| {
            if let Some(address) = end.address {
                interface.set_address(address, MASK).expect("an address");
            }
            interface.set_up().expect("an interface that can be switched on");
        });
    }
    for end in ends {
        at(end, |interface| assert!(interface.has_carrier().expect("its state"), "{} is not up", end.name));
    }
}

#[expect(clippy::expect_used, reason = "a test without its cable fails")]
fn at(end: End<'_>, job: impl FnOnce(&Interface) + Send) {
    let job = || job(&Interface::open(end.name).expect("an end of the new cable"));
    end.network.run(job).expect("entering a network");
}
