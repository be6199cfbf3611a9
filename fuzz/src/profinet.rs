//! An IO-Controller and an IO-Device beside a stranger that sends to one of them.

use std::collections::HashMap;
use std::sync::{LazyLock, Mutex};

use machine::Instant;
use profinet::rt::Transport;
use virtual_time::hostile::{Choices as _, Phases, Random, Record, Script, Stranger};

#[allow(dead_code, reason = "other tests use the others")]
#[path = "../../protocol/profinet/tests/profinet/samples.rs"]
mod samples;

#[path = "../../protocol/profinet/tests/strangers/pair.rs"]
mod pair;

use pair::ControllerAndDevice;
pub(crate) use pair::STATIONS;
pub(crate) use samples::DEVICE;

/// Long enough for a connection, some frames of the watchdogs, and parting.
const PHASES: Phases =
    Phases { up: Instant::from_millis(12), parting: Instant::from_millis(40), end: Instant::from_millis(50) };

/// The pair alone, by transport and whether it knows its partners.
static ALONE: LazyLock<Mutex<HashMap<(bool, bool), &'static Record>>> = LazyLock::new(Mutex::default);

fn alone(udp: bool, listed: bool) -> &'static Record {
    let mut known = ALONE.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    known.entry((udp, listed)).or_insert_with(|| {
        let life = ControllerAndDevice::life::<Random>(transport(udp), listed, crate::allocations);
        Box::leak(Box::new(life.whole(None, PHASES).0))
    })
}

const fn transport(udp: bool) -> Transport {
    if udp { Transport::Udp } else { Transport::Rt1 }
}

/// Attacks the device.
pub(crate) fn device(data: &[u8]) {
    attack(1, data);
}

/// Attacks the controller.
pub(crate) fn controller(data: &[u8]) {
    attack(0, data);
}

fn attack(side: usize, data: &[u8]) {
    let mut choices = Script::new(data);
    let mut is = || choices.below(2) == 1;
    let (udp, listed, forges) = (is(), is(), is());
    let alone = alone(udp, listed);
    let heard = alone.sent.concat();
    let life = ControllerAndDevice::life(transport(udp), listed, crate::allocations);
    // Without lists, whoever comes first is the owner: the stranger begins when the device has accepted the Connect.
    let (start, end) = match (forges, listed) {
        (true, _) | (false, true) => (Instant::ZERO, PHASES.end),
        (false, false) => (Instant::from_micros(160), PHASES.parting),
    };
    let stranger = Stranger::choosing(choices, &heard, [STATIONS[side]; 2], None, (start, end));
    if forges {
        life.forged(stranger, STATIONS[1 - side], PHASES.end);
        return;
    }
    let (disturbed, _) = life.whole(Some(stranger), PHASES);
    assert!(
        *alone == disturbed,
        "a stranger changed something: {}",
        alone.difference::<ControllerAndDevice>(&disturbed)
    );
}
