//! `race.html`: the first repetitions of RC, SM and CM side by side on one clock, three arms in 3D, with their speed and
//! their slots.
//!
//! ```text
//! chain    the arm as it is drawn
//! scene    the arm, and the cell that it stands in
//! of_cell  the same for several arms in one scene
//! lane     what is shown of a recording; numbering counts its motions
//! still    the picture in the report that opens the page
//! *.js     the page's own scripts: recording, scene (three.js), curves (uPlot), panel, race
//! ```
//!
//! The live view uses the same arm, scripts and style for a run in progress.
//!
//! The page is one file: it includes its data, its scripts and two libraries, which `scripts/vendor.sh` makes.

mod cell;
mod chain;
mod lane;
pub(crate) mod numbering;
pub(crate) mod of_cell;
mod scene;
pub(super) mod still;

use minijinja::Value;
use plc_node::ExecutionType;
use serde::Serialize;

use super::end::End;
use super::run::Run;
use crate::html::chart::short;
use crate::html::document::fill;
use lane::{Lane, UNITS, Units};
pub(crate) use scene::Scene;

/// The page, in the run directory.
pub(crate) const FILE: &str = "race.html";

const TEMPLATE: &str = include_str!("race.html");
const STYLE: &str = include_str!("race.css");
/// The scripts that draw arms, curves and slots, each after those that it uses.
const DRAWING: [&str; 6] = [
    include_str!("../../../../vendor/three.min.js"),
    include_str!("../../../../vendor/uplot.min.js"),
    include_str!("recording.js"),
    include_str!("scene.js"),
    include_str!("curves.js"),
    include_str!("panel.js"),
];
/// The script of this page.
const PLAYING: &str = include_str!("race.js");
const LIBRARY_STYLE: &str = include_str!("../../../../vendor/uplot.min.css");

/// What the page moves: the arm, what stands around it, and the recordings.
#[derive(Serialize)]
pub(super) struct Race {
    #[serde(flatten)]
    scene: Scene,
    lanes: Vec<Lane>,
    units: Units,
    /// Interpolation cycle of the robot, in ms.
    cycle_ms: f64,
    #[serde(skip)]
    joints: Vec<Vec<(f64, [f64; 6])>>,
}

/// The head of a type's lane.
#[derive(Serialize)]
struct LaneHead {
    key: String,
    name: String,
    how: &'static str,
    /// The names of the stations; the only one of other setups has none.
    arms: Vec<String>,
}

#[derive(Serialize)]
struct Page<'a> {
    name: String,
    title: &'a str,
    about: String,
    result: Option<String>,
    incomplete: Option<String>,
    absent: Option<String>,
    lanes: Vec<LaneHead>,
    curves: Vec<Summary>,
    cycle_ms: Option<String>,
    style: Value,
    scripts: Vec<Value>,
    data: Value,
}

/// A type's row of the table, and its texts.
#[derive(Serialize)]
struct Summary {
    key: String,
    name: String,
    /// In s.
    end: String,
    /// The same as a predicate.
    said: String,
    still: usize,
    /// In s.
    still_s: String,
    fastest: String,
    motions: u32,
}

impl Race {
    /// Reads a run's recordings for the page; the error says why there are none and how to record them.
    pub(super) fn of(run: &Run) -> Result<Self, String> {
        let Some(trace) = &run.trace else { return Err(run.no_trace()) };
        let (Some(setup), Some(application)) = (&run.setup, &run.application) else {
            return Err("The setup of this run cannot be read, so there is no arm to draw: see Missing in its report.".to_owned());
        };
        let scene = Scene::of(setup, application)?;
        let axes = scene.axes();
        let of_type =
            |execution_type: ExecutionType| Some((execution_type, trace.types.get(execution_type)?));
        let recordings: Vec<_> = ExecutionType::ALL.into_iter().filter_map(of_type).collect();
        let lanes: Vec<_> = recordings
            .iter()
            .filter_map(|(execution_type, recording)| {
                let end = End::of(&run.results, *execution_type, recording);
                Lane::of(*execution_type, end, recording, axes)
            })
            .collect();
        if lanes.is_empty() {
            return Err(run.no_trace());
        }
        let joints = recordings.iter().map(|(_, recording)| {
            let ticks = recording.robot_ticks().iter().filter(|tick| tick.at_ms >= 0.0);
            ticks.map(|tick| (tick.at_ms, tick.sample.joints)).collect::<Vec<_>>()
        });
        Ok(Self {
            scene,
            joints: joints.filter(|joints| !joints.is_empty()).collect(),
            lanes,
            units: UNITS,
            cycle_ms: f64::from(setup.robot.cycle_us.value) / 1e3,
        })
    }

    /// Returns how the race ends, as recorded.
    pub(super) fn result(&self) -> String {
        let ends =
            self.lanes.iter().map(|lane| format!("{} {}", lane.name, lane.end.predicate(lane.end_s())));
        let still = self.lanes.iter().map(|lane| match (lane.still_ms.len(), lane.total_still_ms() / 1e3) {
            (0, _) => format!("{} never", lane.name),
            (1, for_s) => format!("{} once for {for_s:.2}\u{a0}s", lane.name),
            (times, for_s) => format!("{} {times}\u{a0}times for {for_s:.2}\u{a0}s together", lane.name),
        });
        let (ends, still) = (ends.collect::<Vec<_>>().join(", "), still.collect::<Vec<_>>().join(", "));
        format!("The first repetitions: {ends}. Standing still between two motions: {still}.")
    }

    fn heads(&self) -> Vec<LaneHead> {
        let head = |lane: &Lane| LaneHead {
            key: lane.key.clone(),
            name: lane.name.clone(),
            how: lane.how,
            arms: vec![String::new()],
        };
        self.lanes.iter().map(head).collect()
    }

    fn summaries(&self) -> Vec<Summary> {
        self.lanes.iter().map(|lane| Summary::of(lane, lane.name.clone())).collect()
    }
}

impl Summary {
    fn of(lane: &Lane, name: String) -> Self {
        Self {
            key: lane.key.clone(),
            name,
            end: lane.end.cell(lane.end_s()),
            said: lane.end.predicate(lane.end_s()),
            still: lane.still_ms.len(),
            still_s: format!("{:.2}", lane.total_still_ms() / 1e3),
            fastest: format!("{:.0}", lane.fastest_mm_s),
            motions: lane.done.last().map_or(0, |(_, done)| *done),
        }
    }
}

/// Returns the page. A run without recordings has one as well, which says what would record it.
pub(super) fn render(run: &Run) -> anyhow::Result<String> {
    let race = Race::of(run);
    let absent = race.as_ref().err().cloned();
    let race = race.ok();
    let page = Page {
        name: run.name(),
        title: &run.results.title,
        about: run.about(),
        result: race.as_ref().map(Race::result),
        incomplete: race.as_ref().and_then(|_| run.incomplete()),
        absent,
        lanes: race.as_ref().map(Race::heads).unwrap_or_default(),
        curves: race.as_ref().map(Race::summaries).unwrap_or_default(),
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

/// Returns the scripts of a page that draws arms, its own one last.
pub(crate) fn scripts(own: &str) -> Vec<Value> {
    DRAWING.into_iter().chain([own]).map(|script| Value::from_safe_string(script.to_owned())).collect()
}

/// Returns the style of a page that draws arms, with what it has of its own.
pub(crate) fn style(own: &str) -> Value {
    Value::from_safe_string(format!("{LIBRARY_STYLE}\n{STYLE}\n{own}"))
}

/// Returns data as JSON within a script element.
pub(crate) fn data(data: &impl Serialize) -> anyhow::Result<Value> {
    // Only `<` could end the element.
    Ok(Value::from_safe_string(serde_json::to_string(data)?.replace('<', "\\u003c")))
}
