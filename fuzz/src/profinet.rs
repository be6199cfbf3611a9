//! An IO-Controller and an IO-Device beside a stranger that sends to one of them.

use std::sync::LazyLock;

use machine::Instant;
use profinet::rt::Transport;
use virtual_time::hostile::{Choices as _, Phases, Script};

use crate::attack::{self, Attack, RunsAlone};

#[allow(dead_code, reason = "other tests use the others")]
#[path = "../../protocol/profinet/tests/profinet/samples.rs"]
mod samples;

#[path = "../../protocol/profinet/tests/strangers/pair.rs"]
mod pair;

use pair::ControllerAndDevice;
pub(crate) use pair::STATIONS;
pub(crate) use samples::DEVICE;

/// The pair alone, by transport and by whether its stations list each other.
static ALONE: LazyLock<RunsAlone<(bool, bool)>> = LazyLock::new(RunsAlone::default);

/// The search for the device takes 260 ms.
const PHASES: Phases = attack::phases(320);

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

fn attack(target: usize, data: &[u8]) {
    let mut choices = Script::new(data);
    let mut is = || choices.below(2) == 1;
    let (udp, listed, forges) = (is(), is(), is());
    let pair = || ControllerAndDevice::new(transport(udp), listed, crate::allocations);
    let alone = attack::alone(&ALONE, (udp, listed), PHASES, pair);
    // The search for the device has ended, and the device has accepted the Connect.
    let connected = Instant::from_millis(300);
    let attack =
        Attack { stations: STATIONS, phases: PHASES, target, listed, connected, forges, listen: None };
    attack.run(ControllerAndDevice::new(transport(udp), listed, crate::allocations), alone, choices);
}
