//! The page: the race's arm, slots and curve for the present repetition, and tables, figures and messages of the run.

use minijinja::Value;
use planning::Application;
use plc_node::ExecutionType;
use serde::Serialize;
use setup::Setup;

use crate::figures::how;
use crate::html::document::fill;
use crate::pages::race::{self, Scene};
use crate::progress::label;

const TEMPLATE: &str = include_str!("live.html");
const STYLE: &str = include_str!("live.css");
const SCRIPT: &str = include_str!("live.js");

/// What the page says of the run from its beginning.
#[derive(Clone, Copy, Debug)]
pub struct About<'a> {
    /// The cell.
    pub setup: &'a Setup,
    /// The robot's task.
    pub application: &'a Application,
    /// Its execution types.
    pub types: &'a [ExecutionType],
    /// Repetitions of each.
    pub reps: u32,
    /// Why no arm is drawn; `None` if the nodes write what they do.
    pub no_rows: Option<&'a str>,
}

#[derive(Serialize)]
struct Page<'a> {
    name: &'a str,
    title: &'a str,
    application: &'a str,
    reps: u32,
    types: Vec<Type>,
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
    scene: Option<&'a Scene>,
    axes: usize,
    types: &'a [Type],
    lanes: [(); 0],
}

/// Returns the page and the number of the arm's joints.
pub(super) fn render(about: &About<'_>) -> anyhow::Result<(String, usize)> {
    let About { setup, application, reps, no_rows, .. } = *about;
    let scene = match no_rows {
        Some(reason) => Err(reason.to_owned()),
        None => Scene::of(setup, application),
    };
    let axes = scene.as_ref().map_or(0, Scene::axes);
    let type_of = |execution_type: &ExecutionType| Type {
        key: execution_type.to_string(),
        name: label(*execution_type),
        how: how(*execution_type),
        is_program: *execution_type == ExecutionType::Rc,
    };
    let types: Vec<_> = about.types.iter().map(type_of).collect();
    let data = race::data(&Data { scene: scene.as_ref().ok(), axes, types: &types, lanes: [] })?;
    let page = Page {
        name: &setup.name,
        title: &setup.title,
        application: &application.name,
        reps,
        types,
        absent: scene.err(),
        style: race::style(STYLE),
        scripts: race::scripts(SCRIPT),
        data,
    };
    Ok((fill(TEMPLATE, &page)?, axes))
}
