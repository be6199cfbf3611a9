//! Why a robot on EtherNet/IP is not asked outside of a connection.

use setup::EthernetIp;

use crate::verbs::doctor::finding::{Finding, Verdict};

/// Why a device is not asked.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Unreachable {
    /// Nothing has its address.
    NoDevice,
    /// It sits beyond a bridge.
    BeyondBridge,
}

impl Unreachable {
    /// Returns the finding of a step that asks the device.
    pub(super) fn finding(self, what: &'static str) -> Finding {
        match self {
            Self::NoDevice => Finding::not_seen(what, "no such device", "see the step `address`"),
            Self::BeyondBridge => {
                let found = "the robot sits beyond a bridge (bus.ethernet_ip.adapter.route), where this look does not read";
                Finding::limited(what, found, "the step `connection` decides")
            }
        }
    }
}

/// Returns why the robot is not asked, after what was seen of it.
pub(super) fn unreachable(ethernet_ip: &EthernetIp, seen: &[Finding]) -> Option<Unreachable> {
    if !seen.iter().any(|it| it.what == "address" && it.verdict == Verdict::Good) {
        return Some(Unreachable::NoDevice);
    }
    let is_beyond = ethernet_ip.adapter.as_ref().is_some_and(|adapter| !adapter.route.is_empty());
    is_beyond.then_some(Unreachable::BeyondBridge)
}
