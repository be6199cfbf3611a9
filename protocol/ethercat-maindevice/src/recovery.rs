//! What devices that are not in OP are asked for, and when. A device may start over at each request, so a request that
//! reached it is repeated only after a pause.

use ethercrab::SubDeviceState;
use machine::{Duration, Instant};

use crate::al::{ErrorBits, Status};

/// Time in which a device comes to SAFE-OP, and from there to OP. Devices take up to 9 s for the latter
/// (the transition timeout that Beckhoff's stack has as its default).
pub(crate) const TO_OP: Duration = Duration::from_secs(10);

/// Time after which an acknowledgement that shows no effect is repeated, and OP is requested again after a refusal.
const AGAIN: Duration = Duration::from_millis(100);

/// Time after which OP is requested again from a device that says nothing.
const PATIENCE: Duration = Duration::from_secs(1);

/// Refusals of OP in a row that end the recovery.
const MAX_REFUSALS: u32 = 10;

/// What a device needs now.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Step {
    /// Its error has to be acknowledged.
    Acknowledge,
    /// OP has to be requested.
    RequestOp,
    /// It needs time.
    Wait,
    /// It has lost its configuration.
    StartOver,
    /// It does not come to OP.
    GiveUp,
}

/// A device that is not in OP.
#[derive(Clone, Copy, Debug)]
struct Fallen {
    since: Instant,
    acknowledged: Option<Instant>,
    requested: Option<Instant>,
    refusals: u32,
}

/// All devices, while not all of them are in OP.
#[derive(Debug)]
pub(crate) struct Recovery {
    fallen: Vec<Option<Fallen>>,
    is_needed: bool,
    /// The device to begin with when the next one is looked for.
    next: usize,
}

impl Recovery {
    /// Creates the recovery of devices that all were asked for OP just now.
    pub(crate) fn of_start(devices: usize, now: Instant) -> Self {
        let asked = Fallen { since: now, acknowledged: None, requested: Some(now), refusals: 0 };
        Self { fallen: vec![Some(asked); devices], is_needed: true, next: 0 }
    }

    /// Returns whether a device is not in OP.
    pub(crate) const fn is_needed(&self) -> bool {
        self.is_needed
    }

    /// Notes that all devices are in OP.
    pub(crate) fn end(&mut self) {
        if self.is_needed {
            self.is_needed = false;
            self.fallen.fill(None);
            self.next = 0;
        }
    }

    /// Returns the device to look at in this cycle: those that are not in OP without an error get their turns one after
    /// another, so that the process data do not wait for long.
    pub(crate) fn turn(&mut self, states: &[SubDeviceState], errors: ErrorBits) -> Option<usize> {
        let is_in_op = |index: usize| states.get(index) == Some(&SubDeviceState::Op) && !errors.has(index);
        for (index, fallen) in self.fallen.iter_mut().enumerate() {
            if is_in_op(index) {
                *fallen = None;
            }
        }
        let devices = self.fallen.len();
        let turn = (self.next..devices).chain(0..self.next.min(devices)).find(|index| !is_in_op(*index))?;
        self.next = turn + 1;
        Some(turn)
    }

    /// Returns what a device with this status needs.
    pub(crate) fn step(&mut self, now: Instant, index: usize, status: Status) -> Step {
        let Some(slot) = self.fallen.get_mut(index) else { return Step::Wait };
        self.is_needed = true;
        let fallen =
            slot.get_or_insert(Fallen { since: now, acknowledged: None, requested: None, refusals: 0 });
        if now.since(fallen.since) > TO_OP {
            return Step::GiveUp;
        }
        let is_over = |at: Option<Instant>, pause| at.is_none_or(|at| now.since(at) >= pause);
        match (status.state, status.is_error) {
            (SubDeviceState::SafeOp, true) => {
                // The error is the answer to a request, and not the one that is being acknowledged.
                let refuses = fallen.requested > fallen.acknowledged;
                fallen.refusals += u32::from(refuses);
                if fallen.refusals > MAX_REFUSALS {
                    Step::GiveUp
                } else if refuses || is_over(fallen.acknowledged, AGAIN) {
                    Step::Acknowledge
                } else {
                    Step::Wait
                }
            }
            (SubDeviceState::SafeOp, false) => {
                let pause = if fallen.acknowledged > fallen.requested { AGAIN } else { PATIENCE };
                if is_over(fallen.requested, pause) { Step::RequestOp } else { Step::Wait }
            }
            // It refused a request and did not leave OP for that, as the standard would have it.
            (SubDeviceState::Op, true) if is_over(fallen.acknowledged, AGAIN) => Step::Acknowledge,
            (SubDeviceState::Op, _) => Step::Wait,
            _ => Step::StartOver,
        }
    }

    /// Notes that a step has reached the device.
    pub(crate) fn done(&mut self, now: Instant, index: usize, step: Step) {
        let Some(Some(fallen)) = self.fallen.get_mut(index) else { return };
        match step {
            Step::Acknowledge => fallen.acknowledged = Some(now),
            Step::RequestOp => fallen.requested = Some(now),
            Step::Wait | Step::StartOver | Step::GiveUp => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn safe_op(is_error: bool) -> Status {
        Status { state: SubDeviceState::SafeOp, is_error, code: 0 }
    }

    /// Returns the steps other than waiting that a device with one status gets, with their times in milliseconds.
    fn steps(recovery: &mut Recovery, status: Status, until_ms: u64) -> Vec<(u64, Step)> {
        let mut steps = Vec::new();
        for ms in 0..=until_ms {
            let now = Instant::from_millis(ms);
            let step = recovery.step(now, 0, status);
            if step != Step::Wait {
                recovery.done(now, 0, step);
                steps.push((ms, step));
            }
        }
        steps
    }

    #[test]
    fn a_request_and_an_acknowledgement_that_show_no_effect_are_repeated_after_a_pause_only() {
        let mut recovery = Recovery::of_start(1, Instant::ZERO);
        assert_eq!(
            steps(&mut recovery, safe_op(false), 2_500),
            [(1_000, Step::RequestOp), (2_000, Step::RequestOp)]
        );
        let mut recovery = Recovery::of_start(1, Instant::ZERO);
        recovery.end();
        assert_eq!(
            steps(&mut recovery, safe_op(true), 250),
            [(0, Step::Acknowledge), (100, Step::Acknowledge), (200, Step::Acknowledge)]
        );
    }

    #[test]
    fn a_device_that_does_not_come_to_op_in_10_s_is_given_up() {
        let mut recovery = Recovery::of_start(1, Instant::ZERO);
        let steps = steps(&mut recovery, safe_op(false), 10_001);
        assert_eq!(steps.last(), Some(&(10_001, Step::GiveUp)));
        assert!(steps.iter().all(|(ms, step)| (*step == Step::GiveUp) == (*ms > 10_000)), "{steps:?}");
    }

    #[test]
    fn a_device_that_refuses_op_is_asked_again_after_100_ms_each_and_given_up_after_ten_refusals() {
        let mut recovery = Recovery::of_start(1, Instant::ZERO);
        let (mut is_error, mut requests) = (true, Vec::new());
        for ms in 1..5_000 {
            let now = Instant::from_millis(ms);
            let step = recovery.step(now, 0, safe_op(is_error));
            recovery.done(now, 0, step);
            match step {
                Step::Acknowledge => is_error = false,
                Step::RequestOp => {
                    requests.push(ms);
                    is_error = true;
                }
                Step::Wait => {}
                Step::StartOver => panic!("it is in SAFE-OP"),
                Step::GiveUp => {
                    assert_eq!(requests, (1..=10).map(|n| n * 100).collect::<Vec<_>>());
                    return;
                }
            }
        }
        panic!("it goes on for ever");
    }

    #[test]
    fn devices_that_are_not_in_op_get_their_turns_one_after_another() {
        use SubDeviceState::{None, Op, SafeOp};
        let mut recovery = Recovery::of_start(4, Instant::ZERO);
        let mut turns =
            |states: &[SubDeviceState]| [(); 4].map(|()| recovery.turn(states, ErrorBits::none()));
        assert_eq!(turns(&[SafeOp, Op, SafeOp, None]), [Some(0), Some(2), Some(3), Some(0)]);
        assert_eq!(turns(&[Op, Op, SafeOp]), [Some(2), Some(3), Some(2), Some(3)], "one does not report");
        assert_eq!(turns(&[Op; 4]), [Option::None; 4]);
    }

    #[test]
    fn an_error_that_a_device_indicates_in_op_is_acknowledged_and_given_up_after_10_s() {
        let mut recovery = Recovery::of_start(1, Instant::ZERO);
        recovery.end();
        let in_op = Status { state: SubDeviceState::Op, is_error: true, code: 0x0011 };
        let steps = steps(&mut recovery, in_op, 10_001);
        assert_eq!(steps[..2], [(0, Step::Acknowledge), (100, Step::Acknowledge)]);
        assert_eq!(steps.last(), Some(&(10_001, Step::GiveUp)));
    }
}
