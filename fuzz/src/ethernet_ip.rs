//! A scanner and an adapter beside a stranger that sends to one of them, over UDP and TCP.

use std::net::SocketAddrV4;
use std::sync::LazyLock;

use ethernet_ip::ENCAPSULATION_PORT;
use machine::Instant;
use virtual_time::hostile::{Choices as _, Phases, Script};

use crate::attack::{self, Attack, RunsAlone};

#[path = "../../protocol/ethernet-ip/tests/ethernet_ip/samples.rs"]
mod samples;

#[path = "../../protocol/ethernet-ip/tests/strangers/pair.rs"]
mod pair;

use pair::{STATIONS, ScannerAndAdapter};

/// The pair alone, by whether the adapter lists its scanner.
static ALONE: LazyLock<RunsAlone<bool>> = LazyLock::new(RunsAlone::default);

const PHASES: Phases = attack::phases(12);

/// Attacks the adapter.
pub(crate) fn adapter(data: &[u8]) {
    attack(1, data);
}

/// Attacks the scanner.
pub(crate) fn scanner(data: &[u8]) {
    attack(0, data);
}

fn attack(target: usize, data: &[u8]) {
    let mut choices = Script::new(data);
    let mut is = || choices.below(2) == 1;
    let (listed, forges) = (is(), is());
    let alone = attack::alone(&ALONE, listed, PHASES, || ScannerAndAdapter::new(listed, crate::allocations));
    // The Forward_Open is answered.
    let connected = Instant::from_micros(400);
    let listen = Some(SocketAddrV4::new(STATIONS[1].1, ENCAPSULATION_PORT));
    let attack = Attack { stations: STATIONS, phases: PHASES, target, listed, connected, forges, listen };
    attack.run(ScannerAndAdapter::new(listed, crate::allocations), alone, choices);
}
