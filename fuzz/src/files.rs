//! Files and lines that are read: they are accepted or refused in words.

use std::io::BufReader;
use std::sync::LazyLock;

use node::message::Instruction;
use planning::{Application, MotionLines};
use plc_node::process::PlcInstruction;
use records::results::Results;
use records::trace::Trace;
use setup::Setup;

/// Cells of a grid that are planned; more of them only take longer.
const MOST_CELLS: usize = 64;

static SETUP: LazyLock<Option<Setup>> = LazyLock::new(|| setup::setup("A").ok());

/// Reads a setup; one that is accepted is written and read back as it was.
pub(crate) fn setup(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match setup::setup_from_text("fuzz.toml", text) {
        Ok(read) => {
            let written = setup::setup_to_toml(&read).unwrap_or_else(|error| panic!("written: {error}"));
            let again = setup::setup_from_text("again.toml", &written);
            let again = again.unwrap_or_else(|error| panic!("it writes what it refuses: {error}"));
            assert!(again == read, "what was written is another setup");
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// Reads an application and plans it for Setup A.
pub(crate) fn application(data: &[u8]) {
    let (Ok(text), Some(setup)) = (std::str::from_utf8(data), SETUP.as_ref()) else { return };
    match Application::parse("fuzz.toml", text) {
        Ok(application) if application.cells() <= MOST_CELLS => {
            if let Ok(plan) = planning::plan(&application, setup) {
                let motions = plan.wire_motions(setup);
                assert_eq!(motions.len(), plan.motions.len());
                let numbers = motions.iter().flat_map(|motion| motion.target);
                assert!(numbers.into_iter().all(f32::is_finite), "a target that is no number");
            }
        }
        Ok(_) => {}
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
    let (robot, plc) = text.split_once('\0').unwrap_or((text, ""));
    if let Ok(trace) = Trace::from_csv(robot, plc) {
        let _ = trace.incomplete();
    }
}
