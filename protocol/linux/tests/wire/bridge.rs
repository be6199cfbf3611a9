//! A switch between networks.

use std::net::{Ipv4Addr, UdpSocket};

use networked_tests::{End, cable};
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Interface, bridge};

use super::test_network::TIMEOUT;

const PORT: u16 = 5_000;

/// Connects networks by a switch, each with this address at its end.
fn switch(addresses: &[Ipv4Addr]) -> (NetworkNamespace, Vec<NetworkNamespace>) {
    let middle = NetworkNamespace::new().unwrap();
    middle.run(|| bridge::new("switch")).unwrap().unwrap();
    let ends = addresses.iter().enumerate().map(|(number, address)| {
        let (end, port) = (NetworkNamespace::new().unwrap(), format!("port{number}"));
        let name = |network, name, address| End { network, name, address };
        cable([name(&middle, &port, None), name(&end, "eth0", Some(*address))]);
        let open = |name: &str| Interface::open(name).unwrap();
        middle.run(|| bridge::add_port(&open("switch"), &open(&port))).unwrap().unwrap();
        end
    });
    let ends = ends.collect();
    middle.run(|| Interface::open("switch").unwrap().set_up()).unwrap().unwrap();
    (middle, ends)
}

pub(crate) fn each_end_of_a_switch_reaches_each_other_one() {
    let addresses = [1, 2, 3].map(|number| Ipv4Addr::new(10, 0, 0, number));
    let (_middle, ends) = switch(&addresses);
    let open = |(end, address): (&NetworkNamespace, &Ipv4Addr)| {
        end.run(|| UdpSocket::bind((*address, PORT))).unwrap().unwrap()
    };
    let sockets: Vec<_> = ends.iter().zip(&addresses).map(open).collect();
    for (from, sender) in sockets.iter().enumerate() {
        for (to, receiver) in sockets.iter().enumerate().filter(|(to, _)| *to != from) {
            receiver.set_read_timeout(Some(TIMEOUT)).unwrap();
            sender.send_to(&[from as u8], (addresses[to], PORT)).unwrap();
            let mut buf = [0; 1];
            let (_, source) = receiver.recv_from(&mut buf).unwrap();
            assert_eq!((usize::from(buf[0]), source.ip()), (from, addresses[from].into()));
        }
    }
}

pub(crate) fn a_bridge_is_no_port_of_itself_and_its_name_is_taken_once() {
    let network = NetworkNamespace::new().unwrap();
    let refused = network.run(|| {
        bridge::new("switch").unwrap();
        let taken = bridge::new("switch").unwrap_err().to_string();
        let itself = Interface::open("switch").unwrap();
        (taken, bridge::add_port(&itself, &itself).is_err())
    });
    let (taken, is_no_port) = refused.unwrap();
    assert!(taken.contains("making a bridge") && is_no_port, "{taken}");
}
