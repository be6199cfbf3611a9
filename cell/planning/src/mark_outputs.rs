//! Digital outputs by which arms meet at marks in RC: each robot's stored program switches one of its own and waits for those of the
//! others, which the PLC passes on.
//!
//! Arms that have the same marks are a group. Each arm of a group has two outputs, used in turn: at the first mark it sets the first one, at
//! the second mark the second one, at the third it clears the first one, and so on. It goes on once the others' outputs of that mark are
//! as its own. So an output changes again only after all have passed the mark, and no arm takes an old state for a new one.

use crate::mark_signal::{MarkSignal, OUTPUTS, output_bit};
use crate::plan::{Plan, WaitAt};

/// Outputs of an arm in a group: each mark uses the one that the mark before did not use.
const IN_TURN: usize = 2;

/// Gives each wait of the arms of a cell its signal, by outputs that are not in `taken`, the highest first. Where there are too few of
/// them no wait gets one; returns whether all have one.
pub fn assign_mark_signals(arms: &mut [&mut [WaitAt]], taken: u16) -> bool {
    let groups = groups(arms);
    let mut free = (0..OUTPUTS).rev().filter(|output| taken & output_bit(*output) == 0);
    let mut outputs: Vec<Vec<[u8; IN_TURN]>> = Vec::with_capacity(groups.len());
    for group in &groups {
        let mut of_group = Vec::with_capacity(group.len());
        for _ in group {
            let (Some(second), Some(first)) = (free.next(), free.next()) else { return false };
            of_group.push([first, second]);
        }
        outputs.push(of_group);
    }
    let members: Vec<Vec<Vec<usize>>> =
        arms.iter().map(|waits| waits.iter().map(|wait| members(arms, wait.mark)).collect()).collect();
    for (arm, (waits, members)) in arms.iter_mut().zip(members).enumerate() {
        let mut passed = vec![0_usize; groups.len()];
        for (wait, members) in waits.iter_mut().zip(members) {
            let Some(group) = groups.iter().position(|group| *group == members) else { continue };
            let (Some(nth), Some(of_group)) = (passed.get_mut(group), outputs.get(group)) else { continue };
            let (turn, set) = (*nth % IN_TURN, (*nth / IN_TURN).is_multiple_of(2));
            *nth += 1;
            let mut signal = MarkSignal { output: 0, set, inputs: 0 };
            for (member, outputs) in members.iter().zip(of_group) {
                let Some(output) = outputs.get(turn) else { continue };
                if *member == arm {
                    signal.output = *output;
                } else {
                    signal.inputs |= output_bit(*output);
                }
            }
            wait.signal = Some(signal);
        }
    }
    true
}

/// Gives the waits of all plans of a cell their signals. None gets one where an arm waits at its start and then before a shared zone:
/// its program begins only once the zone is granted.
pub(crate) fn assign(plans: &mut [&mut Plan]) {
    let is_late = |plan: &&mut Plan| {
        plan.waits.iter().any(|wait| wait.after == 0) && plan.visits.iter().any(|visit| visit.after == 0)
    };
    if plans.iter().any(is_late) {
        return;
    }
    let actions = plans.iter().flat_map(|plan| &plan.continuous).filter_map(|it| it.then.as_ref());
    let taken = actions.fold(0, |taken, action| taken | output_bit(action.output));
    let mut waits: Vec<&mut [WaitAt]> = plans.iter_mut().map(|plan| plan.waits.as_mut_slice()).collect();
    assign_mark_signals(&mut waits, taken);
}

/// Returns the outputs by which an arm with these waits meets others, as bits.
#[must_use]
pub fn outputs_of_waits(waits: &[WaitAt]) -> u16 {
    waits.iter().filter_map(|wait| wait.signal).fold(0, |outputs, signal| outputs | signal.mask())
}

/// Returns the arms that have a mark.
fn members(arms: &[&mut [WaitAt]], mark: u32) -> Vec<usize> {
    let has = |waits: &[WaitAt]| waits.iter().any(|wait| wait.mark == mark);
    arms.iter().enumerate().filter(|(_, waits)| has(waits)).map(|(arm, _)| arm).collect()
}

/// Returns the groups of arms that have a mark together, each once.
fn groups(arms: &[&mut [WaitAt]]) -> Vec<Vec<usize>> {
    let mut groups = Vec::new();
    for wait in arms.iter().flat_map(|waits| waits.iter()) {
        let members = members(arms, wait.mark);
        if !groups.contains(&members) {
            groups.push(members);
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waits(marks: &[u32]) -> Vec<WaitAt> {
        let wait =
            |(mark, after): (&u32, usize)| WaitAt { mark: *mark, after, after_action: false, signal: None };
        marks.iter().zip(1..).map(wait).collect()
    }

    /// Returns how many marks each arm has passed when no arm can go on any more. In each step one arm that is drawn comes to its next mark
    /// or sees the outputs that the others have at that instant.
    fn passed(arms: &[Vec<WaitAt>], mut seed: u64) -> Vec<usize> {
        let (mut passed, mut stands, mut outputs) =
            (vec![0; arms.len()], vec![false; arms.len()], vec![0_u16; arms.len()]);
        for _ in 0..4_000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let arm = (seed >> 33) as usize % arms.len();
            let Some(wait) = arms[arm].get(passed[arm]) else { continue };
            let signal = wait.signal.unwrap();
            if !stands[arm] {
                outputs[arm] = signal.applied_to(outputs[arm]);
                stands[arm] = true;
                continue;
            }
            let inputs = outputs.iter().enumerate().filter(|(other, _)| *other != arm);
            if signal.is_met_by(inputs.fold(0, |all, (_, outputs)| all | outputs)) {
                let come = |other: usize| passed[other] + usize::from(stands[other]);
                for (other, waits) in arms.iter().enumerate() {
                    let has = waits.iter().position(|its| its.mark == wait.mark);
                    assert!(
                        has.is_none_or(|at| come(other) > at),
                        "arm {arm} passes mark {} early",
                        wait.mark
                    );
                }
                (stands[arm], passed[arm]) = (false, passed[arm] + 1);
            }
        }
        passed
    }

    #[test]
    fn no_order_lets_an_arm_pass_a_mark_before_all_others_of_the_mark_have_come() {
        let cells: [&[&[u32]]; 4] = [
            &[&[1, 2, 3, 4, 5, 6, 7], &[1, 2, 3, 4, 5, 6, 7]],
            &[&[4, 9, 6], &[4, 7, 9, 8, 6], &[7, 8]],
            &[&[1, 2, 3, 4, 5], &[1, 2, 3, 4, 5], &[1, 2, 3, 4, 5]],
            &[&[1, 3], &[1, 2, 3], &[2, 3]],
        ];
        for marks in cells {
            let mut arms: Vec<Vec<WaitAt>> = marks.iter().map(|marks| waits(marks)).collect();
            let mut all: Vec<&mut [WaitAt]> = arms.iter_mut().map(Vec::as_mut_slice).collect();
            assert!(assign_mark_signals(&mut all, 0b101), "{marks:?}");
            let shown = arms.iter().flatten().fold(0, |all, wait| all | wait.signal.unwrap().mask());
            assert_eq!(shown & 0b101, 0, "outputs of actions are left out");
            for seed in 0..200 {
                let lengths: Vec<_> = marks.iter().map(|marks| marks.len()).collect();
                assert_eq!(passed(&arms, seed), lengths, "{marks:?}, seed {seed}");
            }
        }
    }

    #[test]
    fn where_outputs_are_too_few_no_wait_has_a_signal() {
        let mut arms = vec![waits(&[1]); 8];
        let mut all: Vec<&mut [WaitAt]> = arms.iter_mut().map(Vec::as_mut_slice).collect();
        assert!(!assign_mark_signals(&mut all, 1));
        assert!(all.iter().flat_map(|waits| waits.iter()).all(|wait| wait.signal.is_none()));
        assert!(assign_mark_signals(&mut all, 0), "eight arms have two of sixteen outputs each");
    }
}
