//! The default route that an interface gets with a gateway.

use std::net::Ipv4Addr;
use std::process::Command;

use protocol_linux::Interface;

use super::test_network::{ADDRESSES, MASK, TestNetwork};

const FIRST: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 8);
const SECOND: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 9);

/// Returns the gateways of the default routes of this thread's network, with their metrics.
fn default_routes() -> Vec<(Ipv4Addr, u32)> {
    let table = std::fs::read_to_string("/proc/thread-self/net/route").unwrap();
    let fields = table.lines().skip(1).map(|line| line.split_ascii_whitespace().collect::<Vec<_>>());
    let mut routes: Vec<_> = fields
        .filter(|fields| fields[1] == "00000000")
        .map(|fields| {
            let gateway = u32::from_str_radix(fields[2], 16).unwrap();
            (Ipv4Addr::from(gateway.to_ne_bytes()), fields[6].parse().unwrap())
        })
        .collect();
    routes.sort_unstable_by_key(|(_, metric)| *metric);
    routes
}

pub(crate) fn a_gateway_replaces_the_one_that_was_set_before_and_no_route_of_others() {
    let network = TestNetwork::new();
    let others = (Ipv4Addr::new(10, 0, 0, 7), 100);
    let routes = network.run(0, |interface: &Interface| {
        let arguments = ["route", "add", "default", "via", "10.0.0.7", "metric", "100"];
        assert!(Command::new("ip").args(arguments).status().unwrap().success());
        [FIRST, SECOND, Ipv4Addr::UNSPECIFIED, Ipv4Addr::UNSPECIFIED].map(|gateway| {
            interface.set_gateway(gateway).unwrap();
            default_routes()
        })
    });
    assert_eq!(
        routes,
        [vec![others, (FIRST, 30_000)], vec![others, (SECOND, 30_000)], vec![others], vec![others]]
    );
}

pub(crate) fn the_interfaces_own_address_and_the_unspecified_one_are_no_gateway() {
    let network = TestNetwork::new();
    let routes = network.run(0, |interface: &Interface| {
        interface.set_gateway(FIRST).unwrap();
        interface.set_gateway(ADDRESSES[0]).unwrap();
        let own = default_routes();
        interface.set_gateway(FIRST).unwrap();
        interface.set_address(Ipv4Addr::UNSPECIFIED, MASK).unwrap();
        interface.set_gateway(Ipv4Addr::UNSPECIFIED).unwrap();
        [own, default_routes()]
    });
    assert_eq!(routes, [vec![], vec![]]);
}

pub(crate) fn a_gateway_that_no_network_of_the_interface_has_is_refused() {
    let network = TestNetwork::new();
    let refusal = network.run(0, |interface: &Interface| {
        interface.set_gateway(Ipv4Addr::new(10, 9, 9, 9)).unwrap_err().to_string()
    });
    assert!(refusal.starts_with("setting the gateway of network interface `left0`: "), "{refusal}");
}
