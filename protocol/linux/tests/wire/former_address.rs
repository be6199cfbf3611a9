//! The address that an interface has after a node used it.

use std::net::Ipv4Addr;

use protocol_linux::{FormerAddress, Interface};

use super::test_network::{ADDRESSES, MASK, TestNetwork};

const GIVEN: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 77);
const OF_ANOTHER_PROGRAM: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 78);

pub(crate) fn an_interface_gets_back_the_address_that_it_had() {
    let network = TestNetwork::new();
    let address = network.run(0, |interface: &Interface| {
        let former = FormerAddress::of(interface);
        interface.set_address(GIVEN, MASK).unwrap();
        drop(former);
        (interface.address(), interface.mask())
    });
    assert_eq!(address, (Some(ADDRESSES[0]), Some(MASK)));
}

pub(crate) fn an_interface_without_an_address_is_left_without_one() {
    let network = TestNetwork::new();
    let address = network.run(0, |interface: &Interface| {
        interface.set_address(Ipv4Addr::UNSPECIFIED, MASK).unwrap();
        let former = FormerAddress::of(interface);
        interface.set_address(GIVEN, MASK).unwrap();
        drop(former);
        interface.address()
    });
    assert_eq!(address, None);
}

pub(crate) fn an_address_that_another_program_set_meanwhile_stays() {
    let network = TestNetwork::new();
    let address = network.run(0, |interface: &Interface| {
        let former = FormerAddress::of(interface);
        interface.set_address(GIVEN, MASK).unwrap();
        Interface::open(interface.name()).unwrap().set_address(OF_ANOTHER_PROGRAM, MASK).unwrap();
        drop(former);
        interface.address()
    });
    assert_eq!(address, Some(OF_ANOTHER_PROGRAM));
}
