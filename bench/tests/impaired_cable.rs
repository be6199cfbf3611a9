//! Frames on an impaired cable between two networks of this host.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::process::ExitCode;
use std::time::Duration;

use networked_tests::End;
use protocol_linux::Interface;
use protocol_linux::allocation;
use protocol_linux::impaired::{AtCut, ImpairedCable, Observer};
use protocol_linux::namespace::NetworkNamespace;
use records::faults;
use stands as _; // its counting allocator
use virtual_time::{ImpairmentPlan, LinkCounters};

const ADDRESSES: [Ipv4Addr; 2] = [Ipv4Addr::new(10, 0, 0, 1), Ipv4Addr::new(10, 0, 0, 2)];
const PORT: u16 = 4_000;

fn main() -> ExitCode {
    networked_tests::run(networked_tests::tests![
        a_flipped_bit_reaches_the_receiver_and_the_cable_allocates_nothing,
    ])
}

/// Returns two networks with an address each, and the near ends of their cables in a third one.
fn networks() -> ([NetworkNamespace; 2], NetworkNamespace) {
    let middle = NetworkNamespace::new().unwrap();
    let lay = |name, near_end, address| {
        let network = NetworkNamespace::new().unwrap();
        networked_tests::cable([
            End { network: &middle, name: near_end, address: None },
            End { network: &network, name, address: Some(address) },
        ]);
        network.run(|| Interface::open(name).unwrap().fill_in_checksums().unwrap()).unwrap();
        network
    };
    let ends = [lay("left0", "to-left", ADDRESSES[0]), lay("right0", "to-right", ADDRESSES[1])];
    (ends, middle)
}

fn lay(middle: &NetworkNamespace, plan: &ImpairmentPlan) -> ImpairedCable {
    let start = || {
        let [left, right] = ["to-left", "to-right"].map(|name| Interface::open(name).unwrap());
        ImpairedCable::start(
            [&left, &right],
            plan,
            AtCut::KeepsCarrier,
            [Observer::default(), Observer::default()],
        )
        .unwrap()
    };
    middle.run(start).unwrap()
}

fn socket(network: &NetworkNamespace, end: usize) -> UdpSocket {
    let bind = || UdpSocket::bind(SocketAddrV4::new(ADDRESSES[end], PORT)).unwrap();
    let socket = network.run(bind).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    socket
}

/// Every datagram has a flipped bit, and no checksum reveals it; the cable's thread allocates nothing.
fn a_flipped_bit_reaches_the_receiver_and_the_cable_allocates_nothing() {
    let (ends, middle) = networks();
    let cable = lay(&middle, &faults::impairment_plan(&["to-robot:corrupt=1".parse().unwrap()], 1));
    let [left, right] = [0, 1].map(|end| socket(&ends[end], end));
    for number in 0..500_u32 {
        let sent = number.to_be_bytes();
        left.send_to(&sent, (ADDRESSES[1], PORT)).unwrap();
        let mut received = [0; 8];
        let (len, from) = right.recv_from(&mut received).unwrap();
        let flipped: u32 =
            sent.iter().zip(&received[..len]).map(|(sent, found)| (sent ^ found).count_ones()).sum();
        assert_eq!((len, flipped), (4, 1), "{sent:?} arrives as {received:?}");
        right.send_to(&sent, from).unwrap();
        let (len, _) = left.recv_from(&mut received).unwrap();
        assert_eq!(received[..len], sent, "the way back is clean");
    }
    // The stands' counting allocator is also that of programs that link them.
    assert!(allocation::arm(), "nobody counts");
    // The cable counts a frame after it has sent it, so only the counts of a stopped one are whole.
    let stopped = cable.stop(true).unwrap();
    assert_eq!(stopped.allocations, 0);
    let [there, back] = stopped.counters;
    assert_eq!(there, LinkCounters { sent: 500, corrupted: 500, ..LinkCounters::default() });
    assert_eq!(back, LinkCounters { sent: 500, ..LinkCounters::default() });
}
