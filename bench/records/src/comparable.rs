//! What a run measured and how: runs under the same conditions can be compared.

use std::path::Path;

use planning::Found;
use setup::{Difference, Setup};

use crate::paper;
use crate::results::Results;

/// What a run measured and how.
#[derive(Debug)]
pub struct Conditions {
    /// What the run was measured on.
    nodes: &'static str,
    /// What the run has of each of [`TEXTS`].
    texts: [String; TEXTS.len()],
    /// Setup and application, or why they cannot be read.
    cell: Result<(Setup, Found), String>,
}

/// What runs are compared in besides the nodes and the content of setup and application.
const TEXTS: [&str; 5] = ["setup", "application", "mode", "override", "faults"];

impl Conditions {
    /// Reads the conditions of a run from its directory.
    #[must_use]
    pub fn of(directory: &Path, results: &Results) -> Self {
        let cell = planning::setup_with_application(&directory.join("setup.toml").to_string_lossy());
        let nodes = match &results.attached {
            None => "nodes that the bench started",
            Some(attached) if attached.robot.is_some() => "nodes that ran already",
            Some(_) => "a robot that is not ours",
        };
        let overrides = results.overrides.clone().unwrap_or_else(|| "100".to_owned());
        let asked = results.faults.as_ref().map_or(&[][..], |faults| &faults.asked);
        let faults = if asked.is_empty() { "none".to_owned() } else { asked.join(", ") };
        let [setup, application, mode] =
            [&results.setup, &results.application, &results.mode].map(Clone::clone);
        let texts = [setup, application, mode, overrides, faults];
        Self { nodes, texts, cell: cell.map_err(|error| error.to_string()) }
    }

    /// Returns why a run cannot be compared with one under other conditions; `None` if it can be. `other` names that run in
    /// a sentence, such as `before`.
    #[must_use]
    pub fn difference(&self, other: (&Self, &str)) -> Option<String> {
        let besides = self.besides_the_cell(other).next();
        besides.or_else(|| self.of_the_cell(other).into_iter().next())
    }

    /// Returns everything in which the conditions of two runs differ, as parts of a sentence.
    #[must_use]
    pub fn differences(&self, other: (&Self, &str)) -> Vec<String> {
        self.besides_the_cell(other).chain(self.of_the_cell(other)).collect()
    }

    /// Returns the differences that are not in the content of setup and application.
    fn besides_the_cell(&self, (other, named): (&Self, &str)) -> impl Iterator<Item = String> {
        let nodes = (self.nodes != other.nodes)
            .then(|| format!("measured on {}, {named} on {}", self.nodes, other.nodes));
        let pairs = TEXTS.iter().zip(self.texts.iter().zip(&other.texts));
        let differing = pairs.filter(|(_, (own, others))| own != others);
        let texts = differing.map(move |(what, (own, others))| format!("{what} {own}, {named} {others}"));
        nodes.into_iter().chain(texts)
    }

    /// Returns the differences in the content of setup and application. To find them takes time.
    fn of_the_cell(&self, (other, named): (&Self, &str)) -> Vec<String> {
        match (&self.cell, &other.cell) {
            (Ok(own), Ok(others)) => cell_differences(own, others, named),
            (Err(error), _) | (_, Err(error)) => vec![format!("no comparison: {error}")],
        }
    }
}

fn cell_differences(
    (setup, found): &(Setup, Found),
    (other_setup, other): &(Setup, Found),
    named: &str,
) -> Vec<String> {
    let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "missing".to_owned());
    let sentence = |Difference { key, first, second }: &Difference| {
        format!("{key} is {}, {named} {}", text(first), text(second))
    };
    let mut differences = Vec::new();
    if setup != other_setup {
        match setup.differences(other_setup) {
            Ok(all) => {
                let of_content = |difference: &&Difference| {
                    let key = difference.key.as_str();
                    key != "name" && !key.starts_with("paper.") && !paper::is_only_a_name(key)
                };
                differences.extend(all.iter().filter(of_content).map(sentence));
            }
            Err(error) => differences.push(error.to_string()),
        }
    }
    // Another application differs in everything, and its name says so.
    let is_of_one_name = found.application.name == other.application.name;
    if is_of_one_name && found.application != other.application {
        let all = setup::text_differences(&found.text, &other.text).into_iter().flatten();
        let of_content = all.filter(|difference| difference.key != "title");
        differences.extend(of_content.map(|found| format!("in the application, {}", sentence(&found))));
    }
    differences
}
