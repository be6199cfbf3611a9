//! What a run measured and how: runs under the same conditions can be compared.

use std::path::Path;

use planning::Found;
use setup::{Difference, Setup};

use crate::records::paper;
use crate::records::results::Results;

/// What a run measured and how.
pub(super) struct Conditions {
    /// Names of setup and application, and the mode.
    names: [String; 3],
    nodes: Nodes,
    overrides: Option<String>,
    faults: Vec<String>,
    /// Setup and application, or why they cannot be read.
    cell: Result<(Setup, Found), String>,
}

/// What the run was measured on.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Nodes {
    Own,
    RanAlready,
    RobotIsNotOurs,
}

impl Nodes {
    const fn text(self) -> &'static str {
        match self {
            Self::Own => "nodes that the bench started",
            Self::RanAlready => "nodes that ran already",
            Self::RobotIsNotOurs => "a robot that is not ours",
        }
    }
}

impl Conditions {
    /// Reads the conditions of a run from its directory.
    pub(super) fn of(directory: &Path, results: &Results) -> Self {
        let cell = planning::setup_with_application(&directory.join("setup.toml").to_string_lossy());
        Self {
            names: [&results.setup, &results.application, &results.mode].map(Clone::clone),
            nodes: match &results.attached {
                None => Nodes::Own,
                Some(attached) if attached.robot.is_some() => Nodes::RanAlready,
                Some(_) => Nodes::RobotIsNotOurs,
            },
            overrides: results.overrides.clone(),
            faults: results.faults.as_ref().map_or_else(Vec::new, |faults| faults.asked.clone()),
            cell: cell.map_err(|error| error.to_string()),
        }
    }

    /// Returns why a run cannot be compared with one under other conditions; `None` if it can be.
    pub(super) fn difference(&self, before: &Self) -> Option<String> {
        if self.names != before.names {
            return Some("another setup, application or mode".to_owned());
        }
        if self.nodes != before.nodes {
            return Some(format!("measured on {}, before on {}", self.nodes.text(), before.nodes.text()));
        }
        if self.overrides != before.overrides {
            let text = |conditions: &Self| conditions.overrides.clone().unwrap_or_else(|| "100".to_owned());
            return Some(format!("override {}, before {}", text(self), text(before)));
        }
        if self.faults != before.faults {
            let text = |conditions: &Self| match &conditions.faults[..] {
                [] => "none".to_owned(),
                faults => faults.join(", "),
            };
            return Some(format!("faults {}, before {}", text(self), text(before)));
        }
        match (&self.cell, &before.cell) {
            (Ok(now), Ok(before)) => cell_difference(now, before),
            (Err(error), _) | (_, Err(error)) => Some(format!("no comparison: {error}")),
        }
    }
}

fn cell_difference(
    (setup, found): &(Setup, Found),
    (setup_before, before): &(Setup, Found),
) -> Option<String> {
    let text = |value: Option<String>| value.unwrap_or_else(|| "missing".to_owned());
    let sentence =
        |Difference { key, first, second }| format!("{key} is {}, before {}", text(first), text(second));
    if setup != setup_before {
        match setup.differences(setup_before) {
            Ok(all) => {
                let mut all = all.into_iter();
                if let Some(found) = all.find(|difference| !paper::is_only_a_name(&difference.key)) {
                    return Some(sentence(found));
                }
            }
            Err(error) => return Some(error.to_string()),
        }
    }
    if found.application == before.application {
        return None;
    }
    let all = setup::text_differences(&found.text, &before.text).into_iter().flatten();
    let found = all.into_iter().find(|difference| difference.key != "title");
    found.map(|difference| format!("in the application, {}", sentence(difference)))
}
