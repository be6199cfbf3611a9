//! Long runs: constant memory, and every lost, duplicated or reordered motion is noticed.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use std::fs;
use std::time::Duration;

use assert_cmd::Command;
use plc_node::MotionSource;
use protocol::image::Motion;
use protocol_linux::allocation;
use setup::Setup;
use studies::long::{Finished, LongRun, Mismatch, Origin, SuppliedMotions, SupplyThread};

const SLICE: Duration = Duration::from_secs(1);

fn setup_a() -> Setup {
    setup::setup("A").unwrap()
}

fn engraving(setup: &Setup) -> Origin {
    let application = planning::application("engraving", None).unwrap().application;
    Origin::Application(Box::new((application, setup.clone())))
}

fn to_the_end(mut run: LongRun) -> anyhow::Result<Finished> {
    loop {
        match run.advance(SLICE) {
            Ok(None) => {}
            Ok(Some(execution)) => return run.finish(Ok(execution)),
            Err(error) => return run.finish(Err(error)),
        }
    }
}

#[test]
fn two_hundred_thousand_motions_arrive_in_order_in_constant_memory() {
    const MOTIONS: u32 = 200_000;
    let setup = setup_a();
    let mut run = LongRun::start(&setup, engraving(&setup), MOTIONS, 1).unwrap();
    let accepted = |run: &LongRun| run.digests()[1].sum().motions;
    while accepted(&run) < u64::from(MOTIONS) / 10 {
        assert!(run.advance(SLICE).unwrap().is_none());
    }
    assert!(allocation::arm(), "the counter is installed");
    let execution = loop {
        if let Some(execution) = run.advance(SLICE).unwrap() {
            break execution;
        }
    };
    let allocations = allocation::count();
    allocation::disarm();
    let finished = run.finish(Ok(execution)).unwrap();
    assert_eq!(allocations, 0, "between 10 % and the end");
    assert_eq!(execution.motions, MOTIONS);
    assert_eq!(finished.accepted.motions, u64::from(MOTIONS));
    finished.check().unwrap();
}

#[test]
fn two_runs_of_one_seed_are_equal_to_the_nanosecond_however_late_the_list_arrives() {
    let setup = setup_a();
    let run = || to_the_end(LongRun::start(&setup, engraving(&setup), 6_000, 3).unwrap()).unwrap();
    assert_eq!(run(), run());
}

/// A source with one fault between the list and the PLC. The number of motions stays the same: an additional one
/// drops the last one, and for a lost one the first one follows at the end.
#[derive(Debug)]
struct Faulty {
    list: SuppliedMotions,
    fault: Fault,
    taken: u32,
    first: Option<Motion>,
    held: Option<Motion>,
}

#[derive(Clone, Copy, Debug)]
enum Fault {
    None,
    Lost,
    Duplicated,
    Reordered,
}

/// Index of the faulty motion.
const AT: u32 = 1_500;

impl Faulty {
    fn next(&mut self) -> Option<Motion> {
        let motion = self.list.get(self.taken).or(self.first);
        self.taken += 1;
        self.first = self.first.or(motion);
        motion
    }
}

impl MotionSource for Faulty {
    fn total(&self) -> u32 {
        self.list.total()
    }

    fn get(&mut self, index: u32) -> Option<Motion> {
        match self.fault {
            Fault::Lost if index == AT => {
                self.next()?;
                self.next()
            }
            // Not immediately after it: a motion to the current position would be refused.
            Fault::Duplicated if index == AT => {
                self.held = self.next();
                self.held
            }
            Fault::Duplicated if index == AT + 2 => self.held,
            Fault::Reordered if index == AT => {
                self.held = self.next();
                self.next()
            }
            Fault::Reordered if index == AT + 1 => self.held,
            _ => self.next(),
        }
    }
}

fn with_fault(fault: Fault) -> Finished {
    let setup = setup_a();
    let (supply, list) = SupplyThread::start(engraving(&setup), 3_000);
    let source = Faulty { list, fault, taken: 0, first: None, held: None };
    to_the_end(LongRun::with_source(&setup, supply, Box::new(source), 1).unwrap()).unwrap()
}

#[test]
fn a_lost_duplicated_or_misplaced_motion_between_list_and_robot_is_noticed() {
    let good = with_fault(Fault::None);
    good.check().unwrap();
    for fault in [Fault::Lost, Fault::Duplicated, Fault::Reordered] {
        let bad = with_fault(fault);
        assert_eq!(bad.sent, bad.accepted, "the fault is before the PLC");
        assert_eq!(bad.sent.motions, good.sent.motions, "the number does not show it");
        assert_ne!(bad.sent.value, good.sent.value, "{fault:?}");
        let Mismatch { first, second, .. } = bad.check().unwrap_err();
        assert_eq!((first, second), ("the list", "the PLC"));
    }
}

#[test]
fn a_motion_that_the_robot_refuses_is_named_by_its_line_in_the_list() {
    let directory = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let mut bench = Command::cargo_bin("bench").unwrap();
        bench.current_dir(directory.path()).args(["long", "--quiet"]).args(arguments).output().unwrap()
    };
    assert!(run(&["--motions", "2", "--write", "dots.csv"]).status.success());
    let text = fs::read_to_string(directory.path().join("dots.csv")).unwrap();
    let (first, last) = text.trim_end().rsplit_once('\n').unwrap();
    // The last motion again: it ends where it starts.
    fs::write(directory.path().join("dots.csv"), format!("{first}\n\n# twice\n{last}\n{last}\n")).unwrap();
    let refused = run(&["--from", "dots.csv"]);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(4), "{said}");
    let line = text.lines().count() + 3;
    assert!(said.contains(&format!("motions on the robot's path, at dots.csv:{line}: cm failed")), "{said}");
}

#[test]
fn a_written_list_gives_the_same_digest_and_a_broken_one_is_refused_before_anything_moves() {
    let directory = tempfile::tempdir().unwrap();
    let bench = |arguments: &[&str]| {
        let output = Command::cargo_bin("bench")
            .unwrap()
            .current_dir(directory.path())
            .arg("long")
            .args(arguments)
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    let (code, written, said) = bench(&["--motions", "300", "--write", "dots.csv"]);
    assert_eq!((code, said.as_str()), (Some(0), ""));
    let digest = written.trim().strip_prefix("dots.csv: ").unwrap();

    let (code, stdout, said) = bench(&["--from", "dots.csv", "--quiet"]);
    assert_eq!((code, said.as_str()), (Some(0), ""), "{stdout}");
    assert_eq!(stdout.matches(digest).count(), 3, "list, PLC and robot: {stdout}");
    assert!(stdout.contains("executed 300 motions"), "{stdout}");

    let text = fs::read_to_string(directory.path().join("dots.csv")).unwrap();
    fs::write(directory.path().join("dots.csv"), text + "lin,1,2\n").unwrap();
    let (code, stdout, said) = bench(&["--from", "dots.csv"]);
    assert_eq!((code, stdout.as_str()), (Some(2), ""));
    assert!(said.starts_with("error: dots.csv:302: found 3 columns; a motion has 19: kind,x,"), "{said}");
}
