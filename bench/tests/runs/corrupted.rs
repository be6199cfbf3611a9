//! Bits that flip behind the checksums of the bus change no repetition that passes: the arm takes the same way, cycle by
//! cycle, as without them.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use planning::Found;
use plc_node::ExecutionType;
use records::faults::Fault;
use records::mode::Mode;
use records::schedule::Step;
use setup::Setup;
use stands::Stand as _;
use stands::verification::Verification;
use stands::virtual_run::{Extras, VirtualRun};

/// Joints of the arm, cycle by cycle, without the cycles in which it stands.
type JointPath = Vec<[f64; 6]>;

/// How repetitions ended.
#[derive(Default)]
struct Classes {
    /// They pass, and the arm took the same way.
    same: AtomicU64,
    /// They pass, and the arm took another way.
    altered: AtomicU64,
    /// They fail, with a reason.
    refused: AtomicU64,
    /// Bits that flipped in all of them.
    flipped: AtomicU64,
}

struct Cell {
    setup: Setup,
    found: Found,
    ways: BTreeMap<ExecutionType, JointPath>,
}

impl Cell {
    fn new(setup: &str) -> Self {
        let (setup, found) = planning::setup_with_application(setup).unwrap();
        let mut cell = Self { setup, found, ways: BTreeMap::new() };
        for execution_type in ExecutionType::ALL {
            let (way, _) = cell.run(execution_type, 1, &[]);
            cell.ways.insert(execution_type, way.unwrap());
        }
        cell
    }

    /// Runs the sequence once; returns the arm's way, and the number of bits that flipped.
    fn run(
        &self,
        execution_type: ExecutionType,
        seed: u64,
        faults: &[Fault],
    ) -> (anyhow::Result<JointPath>, u64) {
        let Self { setup, found, .. } = self;
        let extras = Extras { faults: faults.to_vec(), ..Extras::default() };
        let application = &found.application;
        let started = VirtualRun::start_with(setup, application, seed, &extras);
        let mut run = match started {
            Ok(run) => run,
            Err(error) => return (Err(error), 0),
        };
        let mut verification = Verification::new(setup, application, Mode::Virtual, faults).unwrap();
        let pause = Duration::from_micros(40_000 + seed % 4_000);
        let step = Step { execution_type, repetition: 1, pause, overrides: None };
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let measured = runtime.block_on(run.execute(step));
        let flipped = run.health().faults.map_or(0, |faults| faults.corrupted);
        let verified = measured.and_then(|measured| verification.check(&measured));
        let ticks =
            run.trace().types.get(execution_type).map_or(&[][..], |recording| recording.robot_ticks());
        let mut way: JointPath = ticks.iter().map(|tick| tick.sample.joints).collect();
        way.dedup();
        (verified.map(|()| way), flipped)
    }
}

/// Runs so many repetitions of each setup with flipped bits, on all cores.
fn classes(repetitions: u64) -> Classes {
    let cells = ["A", "B", "C"].map(Cell::new);
    let (classes, next) = (Classes::default(), AtomicU64::new(0));
    let count = |class: &AtomicU64, by: u64| class.fetch_add(by, Ordering::Relaxed);
    let work = || {
        while let Some(seed) = Some(count(&next, 1)).filter(|seed| *seed < repetitions) {
            let execution_type = ExecutionType::ALL[(seed % 3) as usize];
            let cell = &cells[(seed / 3 % 3) as usize];
            let share = ["corrupt=0.0005", "corrupt=0.002@memory", "corrupt=0.01"][(seed / 9 % 3) as usize];
            let (way, flipped) = cell.run(execution_type, seed, &[share.parse().unwrap()]);
            count(&classes.flipped, flipped);
            match way {
                Ok(way) if way == cell.ways[&execution_type] => count(&classes.same, 1),
                Ok(way) => {
                    eprintln!(
                        "{} {execution_type}, seed {seed}, {share}: {} cycles",
                        cell.setup.name,
                        way.len()
                    );
                    count(&classes.altered, 1)
                }
                Err(_) => count(&classes.refused, 1),
            };
        }
    };
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
    });
    classes
}

fn check(repetitions: u64) {
    let Classes { same, altered, refused, flipped } = classes(repetitions);
    let [same, altered, refused, flipped] = [same, altered, refused, flipped].map(AtomicU64::into_inner);
    eprintln!(
        "{repetitions} repetitions, {flipped} flipped bits: {same} the same, {altered} altered, {refused} refused"
    );
    assert_eq!(altered, 0);
    assert!(same > repetitions / 4 && flipped > repetitions, "{same} the same, {flipped} flipped bits");
}

#[test]
fn no_flipped_bit_changes_the_way_of_a_repetition_that_passes() {
    check(540);
}

#[test]
#[ignore = "takes ten minutes or more"]
fn no_flipped_bit_changes_the_way_of_a_hundred_thousand_repetitions() {
    check(100_000);
}
