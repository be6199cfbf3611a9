//! The PLC's blocks and the robot's controller in random orders of commands and faults, against the rules that
//! `docs/plcopen.md` and `docs/process-image.md` give, written without the code of either.
//!
//! The exploration beside the controller tries every order of a few skills that take no time. Here the skills take the time that
//! Setup A gives them, images are late, stale and lost, programs run, waits are longer than the life counter's range, and
//! either side restarts. Fixed seeds; `SKILLBENCH_ORDERS=20000` tries as many orders.

mod cell;
mod rules;

use cell::{BLOCKS, Cell, ENABLE, HALT, MODES, RESET, SKILLS, STOP, WAY};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

/// What the PLC program or the world does next.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// Sets or clears `Execute` of a block.
    Execute(usize, bool),
    /// Chooses the buffer mode of the blocks that start from now on, by its place in [`MODES`].
    Mode(usize),
    /// Sets the override in percent.
    Override(u8),
    /// Lets scans pass.
    Scans(u32),
    /// Takes the connection away for some scans.
    Lost(u32),
    /// Lets no new command reach the robot for some scans.
    StaleCommand(u32),
    /// Lets no new feedback reach the PLC for some scans.
    StaleFeedback(u32),
    /// The robot restarts where its arm stands.
    RestartRobot,
    /// The PLC restarts.
    RestartPlc,
}

fn step() -> impl Strategy<Value = Step> {
    // Longer than half the range of the life counter, and than the whole.
    let long = prop_oneof![33_000..40_000_u32, 66_000..70_000_u32];
    prop_oneof![
        14 => (0..BLOCKS, any::<bool>()).prop_map(|(block, on)| Step::Execute(block, on)),
        10 => (0..SKILLS).prop_map(|block| Step::Execute(block, true)),
        4 => Just(Step::Execute(ENABLE, true)),
        4 => Just(Step::Execute(RESET, true)),
        4 => Just(Step::Execute(HALT, true)),
        3 => (0..MODES.len()).prop_map(Step::Mode),
        3 => prop_oneof![Just(0), Just(100), 1..100_u8].prop_map(Step::Override),
        30 => prop_oneof![2 => 0..10_u32, 1 => 0..40_u32, 1 => 0..1_000_u32].prop_map(Step::Scans),
        2 => (1..80_u32).prop_map(Step::Lost),
        3 => (1..30_u32).prop_map(Step::StaleCommand),
        3 => (1..30_u32).prop_map(Step::StaleFeedback),
        1 => Just(Step::RestartRobot),
        1 => Just(Step::RestartPlc),
        1 => long.clone().prop_map(Step::Lost),
        1 => long.prop_map(Step::Scans),
    ]
}

/// Delays of the images in scans, whether the robot's calls take Setup A's time, and whether the skills' blocks are called last.
fn cell() -> impl Strategy<Value = ([u8; 2], bool, bool)> {
    ([0..4_u8, 0..4_u8], any::<bool>(), any::<bool>())
}

/// Runs the steps, each checked in each scan, and then leads the cell back to a whole run.
fn run(steps: &[Step], (delays, takes_time, skills_last): ([u8; 2], bool, bool)) {
    let mut cell = Cell::new(delays, takes_time, skills_last);
    cell.set(ENABLE, true);
    cell.scans(60);
    cell.set(ENABLE, false);
    for step in steps {
        match *step {
            Step::Execute(block, on) => cell.set(block, on),
            Step::Mode(mode) => cell.mode = MODES[mode],
            Step::Override(percent) => cell.override_percent = percent,
            Step::Scans(count) => cell.scans(count),
            Step::Lost(count) => cell.lose(count),
            Step::StaleCommand(count) => cell.stale[0] = count,
            Step::StaleFeedback(count) => cell.stale[1] = count,
            Step::RestartRobot => cell.restart_robot(),
            Step::RestartPlc => cell.restart_plc(),
        }
    }
    leads_back(&mut cell);
}

/// Withdraws what was asked for; then stop, enable and reset lead to a run of the whole way.
fn leads_back(cell: &mut Cell) {
    (0..BLOCKS).for_each(|block| cell.set(block, false));
    (cell.override_percent, cell.mode) = (100, MODES[0]);
    cell.scans(400);
    cell.ends(STOP);
    cell.ends(ENABLE);
    cell.ends(RESET);
    let outputs = cell.ends(WAY);
    assert!(outputs.done, "{outputs:?}, {}", cell.told());
}

#[test]
fn every_rule_holds_in_random_orders_of_commands_and_faults() {
    let cases = std::env::var("SKILLBENCH_ORDERS").map_or(150, |cases| cases.parse().unwrap());
    let config = ProptestConfig {
        cases,
        failure_persistence: None,
        max_shrink_iters: 3_000,
        ..ProptestConfig::default()
    };
    let random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let orders = (proptest::collection::vec(step(), 1..60), cell());
    TestRunner::new_with_rng(config, random)
        .run(&orders, |(steps, cell)| {
            run(&steps, cell);
            Ok(())
        })
        .unwrap();
}
