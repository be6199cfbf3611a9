//! Which stations on a cable have the IP addresses of a setup.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use node::address_check::find_holders;
use protocol_linux::Interface;
use setup::{BusKind, Setup};

use super::finding::Finding;

/// Asks on an interface who has the addresses of the setup; a setup for EtherCAT has none.
pub(super) fn check(interface: &str, setup: &Setup) -> Vec<Finding> {
    const INTERFACE: &str = "interface of the cable";
    let addresses = match &setup.bus.kind {
        BusKind::Profinet(addresses, _) | BusKind::EthernetIp(addresses, _) => *addresses,
        BusKind::Ethercat(_) => return vec![Finding::good(INTERFACE, "EtherCAT needs no IP address")],
    };
    let interface = match Interface::find(interface) {
        Ok(interface) => interface,
        Err(error) => {
            return vec![Finding::missing(INTERFACE, error.to_string(), "name one that `ip link` shows")];
        }
    };
    [("address of the PLC", addresses.plc), ("address of the robot", addresses.robot)]
        .map(|(what, address)| match find_holders(&interface, address) {
            Ok(holders) => verdict(what, address, interface.address() == Some(address), &holders),
            Err(error) => Finding::limited(
                what,
                format!("{address}: unknown, {error}"),
                "run it as root, or with the capability CAP_NET_RAW",
            ),
        })
        .into()
}

/// Judges who has an address besides this interface, which `is_ours` if it has the address.
fn verdict(what: &'static str, address: Ipv4Addr, is_ours: bool, holders: &[Mac]) -> Finding {
    let names = holders.iter().map(ToString::to_string).collect::<Vec<_>>().join(" and ");
    match (is_ours, holders) {
        (true, []) => Finding::good(what, format!("{address}: this interface has it, and no other station")),
        (false, []) => Finding::good(what, format!("{address}: free")),
        (false, [_]) => Finding::good(what, format!("{address}: {names} has it, and no other station")),
        (is_ours, _) => {
            let also = if is_ours { "this interface and " } else { "" };
            let fix = "switch all but one of them off, or give them other addresses";
            Finding::missing(what, format!("{address}: {also}{names} have it"), fix)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::doctor::finding::Verdict;

    #[test]
    fn an_address_that_two_stations_have_is_refused_with_both() {
        let address = Ipv4Addr::new(10, 0, 0, 2);
        let [one, other] = [1, 2].map(|last| Mac([2, 0, 0, 0, 0, last]));
        let found = |is_ours, holders: &[Mac]| verdict("address of the robot", address, is_ours, holders);
        for (is_ours, holders) in [(false, &[][..]), (false, &[one]), (true, &[])] {
            assert_eq!(found(is_ours, holders).verdict, Verdict::Good);
        }
        for (is_ours, holders) in [(false, &[one, other][..]), (true, &[one])] {
            let Finding { verdict, found, fix, .. } = found(is_ours, holders);
            assert_eq!(verdict, Verdict::Missing);
            assert!(holders.iter().all(|mac| found.contains(&mac.to_string())), "{found}");
            assert!(fix.is_some());
        }
    }
}
