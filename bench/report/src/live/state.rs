//! What the page shows. The state of a run is the sum of its parts: a page that was open all the time has added them one by
//! one, a page that opens now gets their sum as one part.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use protocol::image::SLOTS;
use serde::Serialize;

use crate::pages;

/// Frames that are kept of a repetition: its last two minutes at 30 Hz, over all arms.
const FRAMES: usize = 3_600;

/// Longest page that a page gets, in bytes.
const MOST_PAGE_BYTES: u64 = 64 << 20;

/// Lines of the log that are kept.
const LINES: usize = 200;

/// A change of the state, or the whole.
#[derive(Clone, PartialEq, Default, Serialize, Debug)]
pub(super) struct Part {
    /// Whether this is the sum of all parts so far.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(super) is_whole: bool,
    /// The repetition that begins; the frames so far are of the one before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) repetition: Option<Repetition>,
    /// Time at which the repetition's motions were done, in ms since its start edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) end_ms: Option<f64>,
    #[serde(skip_serializing_if = "VecDeque::is_empty")]
    pub(super) frames: VecDeque<Frame>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) table: Option<Table>,
    /// Figures of the nodes, by the key that the page has for each.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) nodes: BTreeMap<String, Node>,
    #[serde(skip_serializing_if = "VecDeque::is_empty")]
    pub(super) log: VecDeque<Line>,
    /// The report, drawn after the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) report: Option<ReportText>,
    /// How the run ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) ended: Option<Ended>,
}

/// A repetition.
#[derive(Clone, PartialEq, Eq, Serialize, Debug)]
pub(super) struct Repetition {
    /// Its type, in lower case.
    pub(super) key: String,
    pub(super) number: u32,
    #[serde(rename = "of")]
    pub(super) reps: u32,
}

/// The arm and the slots in one cycle of the robot.
#[derive(Clone, PartialEq, Serialize, Debug)]
pub(super) struct Frame {
    /// Index of the arm.
    #[serde(skip_serializing_if = "is_first")]
    pub(super) arm: usize,
    /// Time since the start edge, in ms.
    pub(super) at_ms: f64,
    /// In degrees; in mm for a linear axis.
    pub(super) joints: Vec<f64>,
    pub(super) speed_mm_s: f64,
    /// Motions done in this repetition.
    pub(super) done: u32,
    /// Number of the motion in each slot; 0 is an empty slot.
    pub(super) slots: [u32; SLOTS],
    /// Marks that the arm has come to in this repetition, and those that it has passed.
    #[serde(skip_serializing_if = "are_none")]
    pub(super) marks: [u32; 2],
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
const fn is_first(arm: &usize) -> bool {
    *arm == 0
}

fn are_none(marks: &[u32; 2]) -> bool {
    *marks == [0; 2]
}

/// The figures so far.
#[derive(Clone, PartialEq, Serialize, Debug)]
pub(super) struct Table {
    pub(super) rows: Vec<Row>,
    /// (SM − CM) / SM in %, as text; empty if either is missing.
    pub(super) improvement: String,
}

/// The figures of a type, as text.
#[derive(Clone, PartialEq, Eq, Serialize, Debug)]
pub(super) struct Row {
    pub(super) key: String,
    /// Cells: repetitions done, AET, half of its 95 % interval, MAD, shortest and longest, in ms.
    pub(super) cells: [String; 6],
}

/// A node's figures.
#[derive(Clone, PartialEq, Serialize, Debug)]
pub(super) struct Node {
    /// Bins of the cycles' lateness: lower bound in µs, and number of cycles.
    pub(super) lateness: Vec<(u64, u64)>,
    /// Percentiles and the largest, in µs, as a sentence.
    pub(super) summary: String,
    /// Counters: name and count.
    pub(super) counters: Vec<(&'static str, u64)>,
}

/// A line of the log.
#[derive(Clone, PartialEq, Eq, Serialize, Debug)]
pub(super) struct Line {
    /// Time since the view was opened, as text.
    pub(super) at: String,
    pub(super) is_problem: bool,
    pub(super) text: String,
}

/// How the run ended.
#[derive(Clone, PartialEq, Eq, Serialize, Debug)]
pub(super) struct Ended {
    pub(super) is_problem: bool,
    pub(super) text: String,
    /// Path of the report; none without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) report: Option<String>,
}

/// The pages of the report, for a link that needs neither a server nor the file.
#[derive(Clone, PartialEq, Eq, Serialize, Debug)]
pub(super) struct ReportText {
    pub(super) page: String,
    /// The race; none where it was left out or could not be drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) race: Option<String>,
}

impl ReportText {
    /// Reads the report in the directory of a run; none if there is none, or one that is too long for an event.
    pub(super) fn read(directory: &Path) -> Option<Self> {
        let read = |file| setup::read_plain_file(&directory.join(file), MOST_PAGE_BYTES).ok();
        let read = |file| String::from_utf8(read(file)?).ok();
        Some(Self { page: read(pages::FILE)?, race: read(pages::race::FILE) })
    }
}

impl Part {
    /// Returns whether nothing changed.
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Adds a later part.
    pub(super) fn add(&mut self, part: Self) {
        let Self { is_whole, repetition, end_ms, frames, table, nodes, log, ended, report } = part;
        if is_whole {
            *self = Self::default();
        }
        if repetition.is_some() {
            self.repetition = repetition;
            self.end_ms = None;
            self.frames.clear();
        }
        self.end_ms = end_ms.or(self.end_ms);
        extend(&mut self.frames, frames, FRAMES);
        self.table = table.or(self.table.take());
        self.nodes.extend(nodes);
        extend(&mut self.log, log, LINES);
        self.ended = ended.or(self.ended.take());
        self.report = report.or(self.report.take());
    }

    /// Returns the sum as the first part of a page that opens now.
    pub(super) fn whole(&self) -> Self {
        Self { is_whole: true, ..self.clone() }
    }
}

/// Appends to a list, of which the last `most` entries are kept.
fn extend<T>(list: &mut VecDeque<T>, more: VecDeque<T>, most: usize) {
    list.extend(more);
    list.drain(..list.len().saturating_sub(most));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(at_ms: f64) -> Part {
        let frame = Frame {
            arm: 0,
            marks: [0; 2],
            at_ms,
            joints: vec![at_ms],
            speed_mm_s: 1.0,
            done: 0,
            slots: [0; SLOTS],
        };
        Part { frames: [frame].into(), ..Part::default() }
    }

    fn begins(number: u32) -> Part {
        let repetition = Repetition { key: "cm".to_owned(), number, reps: 3 };
        Part { repetition: Some(repetition), ..Part::default() }
    }

    fn said(text: &str) -> Part {
        let line = Line { at: String::new(), is_problem: true, text: text.to_owned() };
        Part { log: [line].into(), ..Part::default() }
    }

    fn news() -> Vec<Part> {
        let end = Part { end_ms: Some(7.5), ..Part::default() };
        let table = Table { rows: Vec::new(), improvement: "12 %".to_owned() };
        let table = Part { table: Some(table), ..Part::default() };
        let ended = Part {
            ended: Some(Ended { is_problem: false, text: "all".to_owned(), report: None }),
            ..Part::default()
        };
        vec![
            begins(1),
            frame(1.0),
            frame(2.0),
            end.clone(),
            table,
            said("a fault"),
            begins(2),
            frame(3.0),
            end,
            said("another"),
            ended,
        ]
    }

    #[test]
    fn a_page_that_reloads_at_any_moment_has_the_state_of_one_that_was_open_all_the_time() {
        let mut run = Part::default();
        for opened_at in 0..news().len() {
            let (mut always, mut reloaded) = (Part::default(), Part::default());
            run = Part::default();
            for (index, part) in news().into_iter().enumerate() {
                if index == opened_at {
                    reloaded.add(run.whole());
                }
                run.add(part.clone());
                always.add(part.clone());
                if index >= opened_at {
                    reloaded.add(part);
                }
                assert!(index < opened_at || reloaded == always, "opened at {opened_at}, part {index}");
            }
        }
        assert_eq!((run.frames.len(), run.log.len(), run.end_ms), (1, 2, Some(7.5)));
    }

    #[test]
    fn a_repetition_of_hours_and_a_log_without_end_stay_bounded() {
        let mut run = Part::default();
        run.add(begins(1));
        for index in 0..10_000 {
            run.add(frame(f64::from(index)));
            run.add(said(&index.to_string()));
        }
        assert_eq!((run.frames.len(), run.log.len()), (FRAMES, LINES));
        assert_eq!(run.frames.back().map(|frame| frame.at_ms), Some(9_999.0));
    }
}
