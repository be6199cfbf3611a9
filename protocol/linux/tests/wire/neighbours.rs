//! The host's table of neighbours, as a driver reads and corrects it.

use machine::ethernet::Mac;
use protocol_linux::Interface;

use super::test_network::{ADDRESSES, TestNetwork};

pub(crate) fn a_wrong_neighbour_is_seen_and_corrected() {
    let network = TestNetwork::new();
    let right = network.run(1, Interface::mac);
    let wrong = Mac([2, 0, 0, 0, 0, 0x77]);
    let seen = network.run(0, |interface: &Interface| {
        let read = || interface.neighbour(ADDRESSES[1]).unwrap();
        let resolved = read();
        let corrected = [wrong, right].map(|mac| {
            interface.set_neighbour(ADDRESSES[1], mac).unwrap();
            read()
        });
        (resolved, corrected, interface.neighbour([10, 0, 0, 99].into()).unwrap())
    });
    assert_eq!(seen, (Some(right), [Some(wrong), Some(right)], None));
}
