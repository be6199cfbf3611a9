//! The page: the race's arm, slots and curve for the present repetition, and tables, figures and messages of the run.

use minijinja::Value;
use planning::{Application, PlannedCell};
use plc_node::ExecutionType;
use serde::Serialize;
use setup::{Cell, Setup};

use crate::figures::how;
use crate::html::document::fill;
use crate::pages::race::of_cell::PlacedScene;
use crate::pages::race::{self, Scene};
use crate::progress::label;

const TEMPLATE: &str = include_str!("live.html");
const STYLE: &str = include_str!("live.css");
const SCRIPT: &str = include_str!("live.js");

/// What the page says of the run from its beginning.
#[derive(Clone, Copy, Debug)]
pub struct About<'a> {
    /// Its setup and application.
    pub arms: AboutArms<'a>,
    /// Its execution types.
    pub types: &'a [ExecutionType],
    /// Repetitions of each.
    pub reps: u32,
    /// Why no arm is drawn; `None` if the nodes write what they do.
    pub no_rows: Option<&'a str>,
}

/// The arms of a run.
#[derive(Clone, Copy, Debug)]
pub enum AboutArms<'a> {
    /// One arm, and its task.
    One(&'a Setup, &'a Application),
    /// The arms of a cell with several stations, planned, and the name of their application.
    Several(&'a Cell, &'a PlannedCell, &'a str),
}

impl AboutArms<'_> {
    /// Returns the names of the stations; the only one of other setups has none.
    pub(super) fn stations(&self) -> Vec<String> {
        match self {
            Self::One(..) => vec![String::new()],
            Self::Several(cell, ..) => cell.names().map(str::to_owned).collect(),
        }
    }

    /// Returns what a page draws; the error is a sentence.
    fn scene(&self) -> Result<LiveScene, String> {
        let (cell, planned) = match self {
            Self::One(setup, application) => {
                return Scene::of(setup, application).map(|scene| LiveScene::One(Box::new(scene)));
            }
            Self::Several(cell, planned, _) => (cell, planned),
        };
        let arms = PlacedScene::all(cell, planned)?.into_iter().zip(&planned.stations);
        let arms = arms.map(|(scene, station)| LiveArm {
            station: station.name.clone(),
            marks: station.plan.waits.iter().map(|wait| wait.mark).collect(),
            axes: scene.axes(),
            scene,
        });
        Ok(LiveScene::Several { arms: arms.collect() })
    }
}

/// Scene that the page draws besides the frames.
#[derive(Serialize, Debug)]
#[serde(untagged)]
enum LiveScene {
    One(Box<Scene>),
    Several { arms: Vec<LiveArm> },
}

/// An arm of a cell.
#[derive(Serialize, Debug)]
struct LiveArm {
    station: String,
    /// Numbers of the marks at which it waits for others, in order.
    marks: Vec<u32>,
    axes: usize,
    #[serde(flatten)]
    scene: PlacedScene,
}

impl LiveScene {
    fn axes(&self) -> Vec<usize> {
        match self {
            Self::One(scene) => vec![scene.axes()],
            Self::Several { arms } => arms.iter().map(|arm| arm.axes).collect(),
        }
    }
}

/// Key of the PLC's figures on the page.
pub(super) const PLC: &str = "plc";

/// Returns the key of a robot's figures on the page.
pub(super) fn robot_key(station: usize) -> String {
    format!("robot-{station}")
}

/// A node whose figures the page shows.
#[derive(Serialize)]
struct ShownNode {
    key: String,
    name: String,
}

/// Returns the nodes of these stations.
fn nodes(stations: &[String]) -> Vec<ShownNode> {
    let robot = |(index, station): (usize, &String)| ShownNode {
        key: robot_key(index),
        name: if station.is_empty() { "Robot".to_owned() } else { format!("Robot {station}") },
    };
    let plc = ShownNode { key: PLC.to_owned(), name: "PLC".to_owned() };
    std::iter::once(plc).chain(stations.iter().enumerate().map(robot)).collect()
}

#[derive(Serialize)]
struct Page<'a> {
    name: &'a str,
    title: &'a str,
    application: &'a str,
    reps: u32,
    types: Vec<Type>,
    /// The names of the stations; the only one of other setups has none.
    stations: &'a [String],
    nodes: &'a [ShownNode],
    absent: Option<String>,
    style: Value,
    scripts: Vec<Value>,
    data: Value,
}

#[derive(Serialize)]
struct Type {
    key: String,
    name: String,
    how: &'static str,
    is_program: bool,
}

/// What the scripts get: the race's data without recordings.
#[derive(Serialize)]
struct Data<'a> {
    #[serde(flatten)]
    scene: Option<&'a LiveScene>,
    axes: usize,
    types: &'a [Type],
    nodes: &'a [ShownNode],
    lanes: [(); 0],
}

/// Returns the page and the number of each arm's joints.
pub(super) fn render(about: &About<'_>) -> anyhow::Result<(String, Vec<usize>)> {
    let About { arms, reps, no_rows, .. } = *about;
    let scene = match no_rows {
        Some(reason) => Err(reason.to_owned()),
        None => arms.scene(),
    };
    let (name, title, application) = match arms {
        AboutArms::One(setup, application) => (&setup.name, &setup.title, application.name.as_str()),
        AboutArms::Several(cell, _, application) => (&cell.name, &cell.title, application),
    };
    let stations = arms.stations();
    let nodes = nodes(&stations);
    let axes = scene.as_ref().map_or_else(|_| vec![0; stations.len()], LiveScene::axes);
    let type_of = |execution_type: &ExecutionType| Type {
        key: execution_type.to_string(),
        name: label(*execution_type),
        how: how(*execution_type),
        is_program: *execution_type == ExecutionType::Rc,
    };
    let types: Vec<_> = about.types.iter().map(type_of).collect();
    let data = race::data(&Data {
        scene: scene.as_ref().ok(),
        axes: axes.first().copied().unwrap_or_default(),
        types: &types,
        nodes: &nodes,
        lanes: [],
    })?;
    let page = Page {
        name,
        title,
        application,
        reps,
        types,
        stations: &stations,
        nodes: &nodes,
        absent: scene.err(),
        style: race::style(STYLE),
        scripts: race::scripts(SCRIPT),
        data,
    };
    Ok((fill(TEMPLATE, &page)?, axes))
}
