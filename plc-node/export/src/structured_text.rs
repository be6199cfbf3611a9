//! The code with an application's numbers, in the dialect `st`: one neutral file.

use std::fmt::Write as _;

use crate::words::{WORDS, words};
use crate::{ExportedApplication, Refused, StopData};

/// Name of the file.
pub const FILE: &str = "skillbench.st";

/// The code in the order in which it is declared.
const TEMPLATES: [&str; 11] = [
    include_str!("../templates/1-types.st"),
    include_str!("../templates/2-functions.st"),
    include_str!("../templates/3-image.st"),
    include_str!("../templates/3-life.st"),
    include_str!("../templates/4-self-test.st"),
    include_str!("../templates/4-adapter-test.st"),
    include_str!("../templates/5-group.st"),
    include_str!("../templates/6-skill.st"),
    include_str!("../templates/7-blocks.st"),
    include_str!("../templates/8-program.st"),
    include_str!("../templates/9-core.st"),
];

/// Words of a stop.
const STOP_WORDS: usize = 4;

/// Values in a line.
const PER_LINE: usize = WORDS;

/// Returns the file's text. The same application gives the same text.
///
/// # Errors
/// What does not fit.
pub fn structured_text(application: &ExportedApplication) -> Result<String, Refused> {
    application.check()?;
    let mut text = TEMPLATES.join("\n");
    for (place, value) in places(application) {
        text = text.replace(place, &value);
    }
    Ok(text)
}

fn places(application: &ExportedApplication) -> Vec<(&'static str, String)> {
    let mut motions: Vec<u32> = application.all_motions().flat_map(words).collect();
    let mut stops: Vec<u32> = application.stops.iter().flat_map(stop_words).collect();
    // An array has at least one element.
    if motions.is_empty() {
        motions.resize(WORDS, 0);
    }
    if stops.is_empty() {
        stops.resize(STOP_WORDS, 0);
    }
    let total = application.motions.len();
    let anywhere = usize::from(application.from_anywhere.is_some());
    let check = if application.with_check { "TRUE" } else { "FALSE" };
    vec![
        ("@LAST_WORD@", (motions.len() - 1).to_string()),
        ("@LAST_STOP@", (stops.len() - 1).to_string()),
        ("@WITH_CHECK@", check.into()),
        ("@ANSWER_SCANS@", application.answer_scans.to_string()),
        ("@SILENT_SCANS@", application.silent_scans.to_string()),
        ("@PROGRESS_SCANS@", application.progress_scans.to_string()),
        ("@SCAN_US@", application.scan_us.to_string()),
        ("@ROBOT_CYCLE_US@", application.robot_cycle_us.to_string()),
        ("@QUEUE_DEPTH@", application.queue_depth.to_string()),
        ("@PROGRAM@", application.program.to_string()),
        ("@TOTAL@", total.to_string()),
        ("@FIRST_FROM_ANYWHERE@", total.to_string()),
        ("@COUNT_FROM_ANYWHERE@", anywhere.to_string()),
        ("@FIRST_FROM_END@", (total + anywhere).to_string()),
        ("@COUNT_FROM_END@", application.from_end.len().to_string()),
        ("@STOP_COUNT@", application.stops.len().to_string()),
        ("@STOPS@", list(&stops)),
        ("@START_JOINTS@", start_joints(application)),
        ("@KNOWS_START@", if known_start(application).is_some() { "TRUE" } else { "FALSE" }.into()),
        // The longest one comes last, so that no other place is looked for in it.
        ("@MOTIONS@", list(&motions)),
    ]
}

/// Returns the joints of the start, where the application names the start by these.
fn known_start(application: &ExportedApplication) -> Option<[f32; 6]> {
    let motion = application.from_anywhere.as_ref()?;
    (motion.kind == protocol::image::MotionKind::PtpJoint).then_some(motion.target)
}

fn start_joints(application: &ExportedApplication) -> String {
    list(&known_start(application).unwrap_or_default().map(f32::to_bits))
}

fn stop_words(stop: &StopData) -> [u32; STOP_WORDS] {
    match stop.switch {
        None => [stop.after, 0, 1, 0],
        Some((output, set, wait_us)) => [stop.after, 1 + u32::from(set), 1 << output.min(15), wait_us],
    }
}

/// Returns the elements of an array of UDINT. Each has its type: some compilers give a number from 2³¹ on another type than those
/// beside it.
fn list(values: &[u32]) -> String {
    let mut text = String::with_capacity(values.len() * 19);
    for (index, value) in values.iter().enumerate() {
        let before = match index {
            0 => "",
            index if index.is_multiple_of(PER_LINE) => ",\n        ",
            _ => ", ",
        };
        let _ = write!(text, "{before}UDINT#{value}");
    }
    text
}
