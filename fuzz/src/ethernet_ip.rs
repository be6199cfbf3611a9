//! A scanner and an adapter beside a stranger that sends to one of them, over UDP and TCP.

use std::collections::HashMap;
use std::net::SocketAddrV4;
use std::sync::{LazyLock, Mutex};

use ethernet_ip::ENCAPSULATION_PORT;
use machine::Instant;
use virtual_time::hostile::{Choices as _, Phases, Random, Record, Script, Stranger};

#[path = "../../protocol/ethernet-ip/tests/ethernet_ip/samples.rs"]
mod samples;

#[path = "../../protocol/ethernet-ip/tests/strangers/pair.rs"]
mod pair;

use pair::{STATIONS, ScannerAndAdapter};

/// Long enough for a connection, some frames of the watchdogs, and parting.
const PHASES: Phases =
    Phases { up: Instant::from_millis(12), parting: Instant::from_millis(40), end: Instant::from_millis(50) };

/// The pair alone, by whether the adapter lists its scanner.
static ALONE: LazyLock<Mutex<HashMap<bool, &'static Record>>> = LazyLock::new(Mutex::default);

fn alone(listed: bool) -> &'static Record {
    let mut known = ALONE.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    known.entry(listed).or_insert_with(|| {
        let life = ScannerAndAdapter::life::<Random>(listed, crate::allocations);
        Box::leak(Box::new(life.whole(None, PHASES).0))
    })
}

/// Attacks the adapter.
pub(crate) fn adapter(data: &[u8]) {
    attack(1, data);
}

/// Attacks the scanner.
pub(crate) fn scanner(data: &[u8]) {
    attack(0, data);
}

fn attack(side: usize, data: &[u8]) {
    let mut choices = Script::new(data);
    let mut is = || choices.below(2) == 1;
    let (listed, forges) = (is(), is());
    let alone = alone(listed);
    let heard = alone.sent.concat();
    let life = ScannerAndAdapter::life(listed, crate::allocations);
    // Without a list, whoever comes first owns the outputs: the stranger begins when the Forward_Open is answered.
    let (start, end) = match (forges, listed) {
        (true, _) | (false, true) => (Instant::ZERO, PHASES.end),
        (false, false) => (Instant::from_micros(400), PHASES.parting),
    };
    let listen = SocketAddrV4::new(STATIONS[1].1, ENCAPSULATION_PORT);
    let stranger = Stranger::choosing(choices, &heard, [STATIONS[side]; 2], Some(listen), (start, end));
    if forges {
        life.forged(stranger, STATIONS[1 - side], PHASES.end);
        return;
    }
    let (disturbed, _) = life.whole(Some(stranger), PHASES);
    assert!(
        *alone == disturbed,
        "a stranger changed something: {}",
        alone.difference::<ScannerAndAdapter>(&disturbed)
    );
}
