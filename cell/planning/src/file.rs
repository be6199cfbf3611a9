//! The application file as it is written; `resolve` makes an [`Application`](crate::Application) of it.
//!
//! Values whose errors should name a line are [`Spanned`].

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::Spanned;

/// A name that stands elsewhere in the file, with its place.
pub(crate) type Name = Spanned<String>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct File {
    pub(crate) schema: Spanned<u32>,
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) tool: Name,
    pub(crate) base: Name,
    pub(crate) start: Name,
    pub(crate) tools: BTreeMap<String, Spanned<u8>>,
    pub(crate) bases: BTreeMap<String, Spanned<u8>>,
    #[serde(default)]
    pub(crate) zones: Zones,
    pub(crate) ways: Option<Ways>,
    pub(crate) frames: BTreeMap<String, Spanned<Frame>>,
    #[serde(default)]
    pub(crate) grids: BTreeMap<String, Spanned<Grid>>,
    #[serde(default)]
    pub(crate) actions: BTreeMap<String, Spanned<Action>>,
    #[serde(default, rename = "obstacle")]
    pub(crate) obstacles: Vec<Spanned<Obstacle>>,
    #[serde(default, rename = "surface")]
    pub(crate) surfaces: Vec<Spanned<Surface>>,
    #[serde(rename = "step")]
    pub(crate) steps: Vec<Spanned<Step>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct Zones {
    pub(crate) approximation_mm: Option<Spanned<f64>>,
    pub(crate) path_tolerance_mm: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Ways {
    pub(crate) clearance_mm: Spanned<f64>,
    pub(crate) ceiling_mm: Spanned<f64>,
    pub(crate) height_step_mm: Spanned<f64>,
    pub(crate) ptp_radius_mm: Spanned<f64>,
    pub(crate) detour_percent: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Frame {
    pub(crate) mm_deg: Option<[f64; 6]>,
    pub(crate) on: Option<Name>,
    pub(crate) shift_mm: Option<[f64; 3]>,
    pub(crate) joints_deg: Option<[f64; 6]>,
    pub(crate) configuration: Option<Spanned<Configuration>>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(deny_unknown_fields)]
pub(crate) struct Configuration {
    pub(crate) status: u8,
    pub(crate) turn: Option<u8>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Grid {
    pub(crate) corner: Name,
    pub(crate) count: [u32; 3],
    pub(crate) pitch_mm: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Action {
    pub(crate) output: u8,
    pub(crate) set: bool,
    pub(crate) wait_ms: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Obstacle {
    pub(crate) name: String,
    pub(crate) lower_mm: [f64; 3],
    pub(crate) upper_mm: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Surface {
    pub(crate) name: String,
    pub(crate) middle: Name,
    pub(crate) normal: [f64; 3],
    pub(crate) radius_mm: Option<Spanned<f64>>,
    pub(crate) stiffness_n_per_mm: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Step {
    pub(crate) name: String,
    #[serde(default)]
    pub(crate) does: String,
    pub(crate) labels: Spanned<Vec<Label>>,
    pub(crate) tool: Option<Name>,
    pub(crate) reach: Option<Name>,
    pub(crate) from: Option<Name>,
    pub(crate) path: Option<Spanned<Vec<Segment>>>,
    pub(crate) approach_mm: Option<Spanned<f64>>,
    pub(crate) retreat_mm: Option<Spanned<f64>>,
    pub(crate) speed_mm_s: Option<f64>,
    pub(crate) speed_percent: Option<f64>,
    pub(crate) then: Option<Name>,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Label {
    Blending,
    AccuratePath,
    AccurateStop,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Segment {
    Line(Name),
    Circle(Circle),
    Spline(Spanned<Vec<Name>>),
    Press(Press),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Circle {
    pub(crate) through: Name,
    pub(crate) to: Name,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Press {
    pub(crate) to: Name,
    pub(crate) force_n: Spanned<[f64; 3]>,
}
