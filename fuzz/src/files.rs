//! Files and lines that are read: they are accepted or refused in words.

use std::io::BufReader;
use std::sync::LazyLock;

use node::message::Instruction;
use planning::{Application, ArmsApplication, Found, FoundCell, MotionLines};
use plc_node::process::PlcInstruction;
use records::cell_results::CellResults;
use records::imported_samples;
use records::results::Results;
use records::trace::Trace;
use setup::{Cell, Setup};

/// Cells of a grid that are planned; more of them only take longer.
const MOST_CELLS: usize = 64;

/// A cell of two arms with a shared zone.
static CELL: LazyLock<Option<Cell>> = LazyLock::new(|| setup::cell("G").ok().map(|(cell, _)| cell));

static SETUP: LazyLock<Option<Setup>> = LazyLock::new(|| setup::setup("A").ok());

/// Reads a setup of one robot or of several; one that is accepted is written and read back as it was, and each station of it
/// is a setup.
pub(crate) fn setup(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match setup::cell_from_text("fuzz.toml", text) {
        Ok(read) => {
            let written = setup::cell_to_toml(&read).unwrap_or_else(|error| panic!("written: {error}"));
            let again = setup::cell_from_text("again.toml", &written);
            let again = again.unwrap_or_else(|error| panic!("it writes what it refuses: {error}"));
            assert!(again == read, "what was written is another setup");
            assert_eq!(setup::setup_from_text("fuzz.toml", text).is_ok(), read.is_one());
            for station in read.setups() {
                setup::check(&station).unwrap_or_else(|error| panic!("a station of it is refused: {error}"));
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// Reads an application for one arm or for several and plans it for Setup A.
pub(crate) fn application(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(arms) = ArmsApplication::parse("fuzz.toml", text) {
        assert!(Application::parse("fuzz.toml", text).is_err(), "several arms are read as one");
        arms.arms.iter().for_each(|arm| plan(&arm.application));
        return plan_together(arms);
    }
    match Application::parse("fuzz.toml", text) {
        Ok(application) => plan(&application),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn plan(application: &Application) {
    let Some(setup) = SETUP.as_ref().filter(|_| application.cells() <= MOST_CELLS) else { return };
    if let Ok(plan) = planning::plan(application, setup) {
        let motions = plan.wire_motions(setup);
        assert_eq!(motions.len(), plan.motions.len());
        let numbers = motions.iter().flat_map(|motion| motion.target);
        assert!(numbers.into_iter().all(f32::is_finite), "a target that is no number");
        for wait in &plan.waits {
            let last = wait.after.checked_sub(1).and_then(|last| motions.get(last));
            assert!(last.is_none_or(|last| last.approximation == 0), "a mark without a stop");
        }
    }
}

/// Plans an application for two arms in a cell with a shared zone: whoever visits it stands outside before and after.
fn plan_together(arms: ArmsApplication) {
    let Some(cell) = CELL.as_ref().filter(|cell| cell.stations.len() == arms.arms.len()) else { return };
    if arms.arms.iter().any(|arm| arm.application.cells() > MOST_CELLS) {
        return;
    }
    let (origin, text) = ("fuzz.toml".to_owned(), String::new());
    let found = |application: &Application| Found {
        origin: origin.clone(),
        path: None,
        text: text.clone(),
        application: application.clone(),
    };
    let stations = arms.arms.iter().map(|arm| found(&arm.application)).collect();
    let found = FoundCell { origin: origin.clone(), marks: arms.marks, stations };
    match found.plan(cell) {
        Ok(planned) => {
            assert!(!planned.to_string().is_empty());
            for station in &planned.stations {
                let Some(zones) = &station.zones else { panic!("a cell with zones") };
                let (reached, plan) = (&station.reached, &station.plan);
                let at = |executed: usize| match executed.checked_sub(1) {
                    None => Some(&reached.start),
                    Some(last) => reached.targets.get(last),
                };
                for visit in &plan.visits {
                    assert!(visit.after < visit.until && visit.until <= plan.motions.len(), "{visit:?}");
                    for executed in [visit.after, visit.until] {
                        let is_outside =
                            at(executed).is_some_and(|joints| !zones.volume.at(joints).contains(visit.zone));
                        assert!(is_outside, "{visit:?} begins or ends inside");
                    }
                }
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// Reads lines of the control port.
pub(crate) fn control(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    for line in text.lines() {
        let Ok(read) = serde_json::from_str::<Instruction<PlcInstruction>>(line) else { continue };
        let written = serde_json::to_string(&read).unwrap_or_else(|error| panic!("written: {error}"));
        let again = serde_json::from_str::<Instruction<PlcInstruction>>(&written);
        assert_eq!(again.ok(), Some(read), "{written}");
    }
}

/// Reads a list of motions.
pub(crate) fn motions(data: &[u8]) {
    for motion in MotionLines::new(BufReader::new(data), "fuzz.csv") {
        match motion {
            Ok(motion) => {
                assert!(motion.target.into_iter().all(f32::is_finite), "a target that is no number")
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
}

/// Reads what a run left: its results, or the tables of its traces, which are cut at the first NUL.
pub(crate) fn records(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = serde_json::from_str::<Results>(text);
    if let Ok(cell) = serde_json::from_str::<CellResults>(text) {
        let _ = (cell.of_station(usize::MAX), cell.remaining_gain(), cell.to_json());
    }
    let (robot, plc) = text.split_once('\0').unwrap_or((text, ""));
    if let Ok(trace) = Trace::from_csv(robot, plc) {
        let _ = trace.incomplete();
    }
}

/// Reads a table of execution times: what is accepted has none missing and each above 0.
pub(crate) fn samples(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match imported_samples::parse(text) {
        Ok(samples) => {
            let types = samples.types;
            let all = [types.rc, types.sm, types.cm].into_iter().flatten();
            for repetition in all.flat_map(|measured| measured.repetitions) {
                assert!(
                    repetition.is_ok_and(|time| time.execution_ms.is_finite() && time.execution_ms >= 0.0)
                );
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}
