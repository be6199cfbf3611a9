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
    cell: Result<RunContent, String>,
}

/// Setup and application of a run.
#[derive(Debug)]
enum RunContent {
    /// One station.
    One(Box<(Setup, Found)>),
    /// Several stations: the text of the setup, and of the application if there is one for all.
    Cell { setup: String, application: Option<String> },
}

impl RunContent {
    fn read(directory: &Path) -> Result<Self, String> {
        let name = directory.join("setup.toml");
        let name = name.to_string_lossy();
        let is_cell = setup::cell(&name).is_ok_and(|(cell, _)| !cell.is_one());
        if !is_cell {
            let read = planning::setup_with_application(&name);
            return read
                .map(|(setup, found)| Self::One(Box::new((setup, found))))
                .map_err(|error| error.to_string());
        }
        let (cell, found) = planning::cell_with_applications(&name).map_err(|error| error.to_string())?;
        let setup = setup::cell_to_toml(&cell).map_err(|error| error.to_string())?;
        let application = found.stations.first().filter(|_| cell.application.is_some());
        Ok(Self::Cell { setup, application: application.map(|first| first.text.clone()) })
    }
}

/// What runs are compared in besides the nodes and the content of setup and application.
const TEXTS: [&str; 7] = ["setup", "application", "mode", "override", "faults", "PLC", "robot"];

impl Conditions {
    /// Reads the conditions of a run from its directory.
    #[must_use]
    pub fn of(directory: &Path, results: &Results) -> Self {
        let nodes = match &results.attached {
            None if results.origin.is_some() => "nodes that no bench ran",
            None => "nodes that the bench started",
            Some(attached) if attached.robot.is_some() => "nodes that ran already",
            Some(_) => "a robot that is not ours",
        };
        let overrides = results.overrides.clone().unwrap_or_else(|| "100".to_owned());
        let asked = results.faults.as_ref().map_or(&[][..], |faults| &faults.asked);
        let faults = if asked.is_empty() { "none".to_owned() } else { asked.join(", ") };
        let [setup, application, mode] =
            [&results.setup, &results.application, &results.mode].map(Clone::clone);
        let peers = results.origin.as_ref().map(|origin| [&origin.plc, &origin.robot]);
        // A robot that is not ours is the one that its bus shows.
        let foreign = results.attached.as_ref().filter(|attached| attached.robot.is_none());
        let foreign = foreign.and_then(|attached| attached.identity.clone());
        let [plc, robot] = match peers {
            Some(peers) => peers.map(ToString::to_string),
            None => ["ours".to_owned(), foreign.unwrap_or_else(|| "ours".to_owned())],
        };
        let texts = [setup, application, mode, overrides, faults, plc, robot];
        Self { nodes, texts, cell: RunContent::read(directory) }
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
            (Ok(RunContent::One(own)), Ok(RunContent::One(others))) => cell_differences(own, others, named),
            (
                Ok(RunContent::Cell { setup, application }),
                Ok(RunContent::Cell { setup: others, application: other }),
            ) => {
                let of_setup = text_differences("", setup, others, named);
                let of_application = application.as_ref().zip(other.as_ref());
                let of_application = of_application
                    .map(|(own, other)| text_differences("in the application, ", own, other, named));
                of_setup.into_iter().chain(of_application.into_iter().flatten()).collect()
            }
            (Ok(own), Ok(_)) => {
                let counts = match own {
                    RunContent::One(..) => ["one station", "several"],
                    RunContent::Cell { .. } => ["several stations", "one"],
                };
                vec![format!("{}, {named} {}", counts[0], counts[1])]
            }
            (Err(error), _) | (_, Err(error)) => vec![format!("no comparison: {error}")],
        }
    }
}

fn sentence(Difference { key, first, second }: &Difference, named: &str) -> String {
    let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "missing".to_owned());
    format!("{key} is {}, {named} {}", text(first), text(second))
}

/// Returns in what two texts in TOML differ besides names and titles.
fn text_differences(begin: &str, own: &str, other: &str, named: &str) -> Vec<String> {
    let all = setup::text_differences(own, other).into_iter().flatten();
    let is_of_content =
        |key: &str| !["name", "title"].contains(&key) && !key.ends_with(".note") && !key.ends_with(".from");
    let of_content = all.filter(|difference| is_of_content(&difference.key));
    of_content.map(|found| format!("{begin}{}", sentence(&found, named))).collect()
}

fn cell_differences(
    (setup, found): &(Setup, Found),
    (other_setup, other): &(Setup, Found),
    named: &str,
) -> Vec<String> {
    let mut differences = Vec::new();
    if setup != other_setup {
        match setup.differences(other_setup) {
            Ok(all) => {
                let of_content = |difference: &&Difference| {
                    let key = difference.key.as_str();
                    key != "name" && !key.starts_with("paper.") && !paper::is_only_a_name(key)
                };
                differences.extend(all.iter().filter(of_content).map(|found| sentence(found, named)));
            }
            Err(error) => differences.push(error.to_string()),
        }
    }
    // Another application differs in everything, and its name says so.
    let is_of_one_name = found.application.name == other.application.name;
    if is_of_one_name && found.application != other.application {
        differences.extend(text_differences("in the application, ", &found.text, &other.text, named));
    }
    differences
}
