//! Frames on an impaired cable between two networks of this host. The tests need root or user namespaces, and fail
//! without.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::time::Duration;

use bench::records::faults;
use protocol_linux::Interface;
use protocol_linux::allocation;
use protocol_linux::impaired::{ImpairedCable, ImpairmentPlan, Witness};
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::veth;
use virtual_time::LinkCounters;

const ADDRESSES: [Ipv4Addr; 2] = [Ipv4Addr::new(10, 0, 0, 1), Ipv4Addr::new(10, 0, 0, 2)];
const PORT: u16 = 4_000;

/// Returns two networks with an address each, and the near ends of their cables in a third one.
fn networks() -> ([NetworkNamespace; 2], NetworkNamespace) {
    let middle = NetworkNamespace::new().unwrap();
    let ends = [("left0", "to-left"), ("right0", "to-right")].map(|(end, near_end)| {
        let network = NetworkNamespace::new().unwrap();
        veth::connect(&network, end, &middle, near_end).unwrap();
        middle.run(|| Interface::open(near_end).unwrap().set_up().unwrap()).unwrap();
        network
    });
    for ((network, name), address) in ends.iter().zip(["left0", "right0"]).zip(ADDRESSES) {
        let set_up = || {
            let interface = Interface::open(name).unwrap();
            interface.fill_in_checksums().unwrap();
            interface.set_address(address, Ipv4Addr::new(255, 255, 255, 0)).unwrap();
            interface.set_up().unwrap();
        };
        network.run(set_up).unwrap();
    }
    (ends, middle)
}

fn lay(middle: &NetworkNamespace, plan: &ImpairmentPlan) -> ImpairedCable {
    let start = || {
        let [left, right] = ["to-left", "to-right"].map(|name| Interface::open(name).unwrap());
        ImpairedCable::start([&left, &right], plan, [Witness::default(), Witness::default()]).unwrap()
    };
    middle.run(start).unwrap()
}

fn socket(network: &NetworkNamespace, end: usize) -> UdpSocket {
    let bind = || UdpSocket::bind(SocketAddrV4::new(ADDRESSES[end], PORT)).unwrap();
    let socket = network.run(bind).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    socket
}

/// Every datagram has a flipped bit, and no checksum reveals it; the cable's thread allocates nothing.
#[test]
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
    let [there, back] = cable.counters();
    assert_eq!(there, LinkCounters { sent: 500, corrupted: 500, ..LinkCounters::default() });
    assert_eq!(back, LinkCounters { sent: 500, ..LinkCounters::default() });
    // The bench's counting allocator is also that of programs that link it.
    assert!(allocation::arm(), "nobody counts");
    assert_eq!(cable.stop(true).unwrap().allocations, 0);
}
