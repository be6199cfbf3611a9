//! The race of a cell: the arms of each type in one scene, where they stand in the cell.

use planning::{PlannedCell, PlannedStation};
use plc_node::ExecutionType;
use robot_node::arm::Frame;
use serde::Serialize;
use setup::{Cell, Station};

use super::chain::Placed;
use super::lane::{Lane, UNITS, Units};
use super::{LaneHead, PLAYING, Page, Scene, Summary, TEMPLATE, data, scripts, style};
use crate::figures::how;
use crate::html::chart::short;
use crate::html::document::fill;
use crate::pages::cell_run::CellFiles;
use crate::pages::end::End;
use crate::progress::label;
use minijinja::Value;

/// Content that the page moves: the arms, what stands around them, and the recordings.
#[derive(Serialize)]
struct CellRace {
    arms: Vec<PlacedScene>,
    lanes: Vec<CellLane>,
    units: Units,
    /// Shortest interpolation cycle, in ms.
    cycle_ms: f64,
}

/// An arm and what stands around it, and where it stands in the cell.
#[derive(Serialize, Debug)]
pub(crate) struct PlacedScene {
    root: Placed,
    #[serde(flatten)]
    scene: Scene,
}

impl PlacedScene {
    /// Returns the arms of a cell, in the order of the stations; the error is a sentence.
    pub(crate) fn all(cell: &Cell, planned: &PlannedCell) -> Result<Vec<Self>, String> {
        let placed = |(station, of_station): (&Station, &PlannedStation)| {
            let scene = Scene::of(&of_station.setup, &of_station.application)?;
            let root = Placed::new(&Frame::from_mm_deg(station.root_mm_deg.value));
            Ok(Self { root, scene })
        };
        cell.stations.iter().zip(&planned.stations).map(placed).collect()
    }

    /// Returns the number of the arm's joints.
    pub(crate) const fn axes(&self) -> usize {
        self.scene.axes()
    }
}

/// The recordings of a type.
#[derive(Serialize)]
struct CellLane {
    key: String,
    name: String,
    arms: Vec<ArmLane>,
}

#[derive(Serialize)]
struct ArmLane {
    station: String,
    #[serde(flatten)]
    lane: Lane,
}

impl CellRace {
    fn of(files: &CellFiles) -> Result<Self, String> {
        let Some((cell, planned)) = files.planned() else {
            return Err(
                "The setup of this run cannot be read, so there are no arms to draw: see its report."
                    .to_owned(),
            );
        };
        let arms = PlacedScene::all(cell, planned)?;
        let lane = |execution_type: ExecutionType| {
            let mut lanes = Vec::with_capacity(arms.len());
            for ((placed, name), trace) in arms.iter().zip(cell.names()).zip(&files.trace.stations) {
                let recording = trace.types.get(execution_type)?;
                let end = End::of(&files.results.of_station(0), execution_type, recording);
                let lane = Lane::of(execution_type, end, recording, placed.axes())?;
                lanes.push(ArmLane { station: name.to_owned(), lane });
            }
            let key = execution_type.to_string();
            (!lanes.is_empty()).then(|| CellLane { key, name: label(execution_type), arms: lanes })
        };
        let lanes: Vec<_> = ExecutionType::ALL.into_iter().filter_map(lane).collect();
        if lanes.is_empty() {
            return Err("Not recorded: this run has no traces. Run it again in virtual time: bench --mode virtual --setup with its \
                        setup.toml."
                .to_owned());
        }
        let cycles = cell.stations.iter().map(|station| station.robot.cycle_us.value);
        let cycle_ms = f64::from(cycles.min().unwrap_or_default()) / 1e3;
        Ok(Self { arms, lanes, units: UNITS, cycle_ms })
    }

    fn heads(&self) -> Vec<LaneHead> {
        let types = ExecutionType::ALL.into_iter();
        let head = |(execution_type, lane): (ExecutionType, &CellLane)| LaneHead {
            key: lane.key.clone(),
            name: lane.name.clone(),
            how: how(execution_type),
            arms: lane.arms.iter().map(|arm| arm.station.clone()).collect(),
        };
        let lane_of = |of: ExecutionType| self.lanes.iter().find(move |lane| lane.key == of.to_string());
        types.filter_map(|of| Some((of, lane_of(of)?))).map(head).collect()
    }

    fn summaries(&self) -> Vec<Summary> {
        let arms = self.lanes.iter().flat_map(|lane| lane.arms.iter().map(move |arm| (lane, arm)));
        arms.map(|(lane, arm)| Summary::of(&arm.lane, format!("{} {}", lane.name, arm.station))).collect()
    }
}

/// Returns the page of a cell. A run without recordings has one as well, which says why.
pub(in crate::pages) fn render(files: &CellFiles) -> anyhow::Result<String> {
    let race = CellRace::of(files);
    let absent = race.as_ref().err().cloned();
    let race = race.ok();
    let page = Page {
        name: files.name(),
        title: &files.results.title,
        about: files.about(),
        result: None,
        incomplete: files.incomplete(),
        absent,
        lanes: race.as_ref().map(CellRace::heads).unwrap_or_default(),
        curves: race.as_ref().map(CellRace::summaries).unwrap_or_default(),
        cycle_ms: race.as_ref().map(|race| short(&race.cycle_ms)),
        style: style(""),
        scripts: race.as_ref().map(|_| scripts(PLAYING)).unwrap_or_default(),
        data: match &race {
            Some(race) => data(race)?,
            None => Value::from(()),
        },
    };
    fill(TEMPLATE, &page)
}
