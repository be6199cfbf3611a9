//! The application file as it is written; `resolve` makes an [`Application`](crate::Application) of it.
//!
//! Values whose errors should name a line are [`Spanned`].

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::Spanned;

/// A name that stands elsewhere in the file, with its place.
pub(crate) type Name = Spanned<String>;

/// An application: what the robot is to do, without a particular robot.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, schemars(rename = "Application"))]
pub(crate) struct File {
    /// Version of this file format: 2.
    #[cfg_attr(test, schemars(with = "u32"))]
    pub(crate) schema: Spanned<u32>,
    /// Short name.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) name: Name,
    /// What happens, one line.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) title: Name,
    /// Tool of all steps that name no other.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) tool: Name,
    /// Base in which all frames and obstacles are given.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) base: Name,
    /// Frame at which the tool stands before the first step. The PLC moves the arm there before each repetition, which no figure counts.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) start: Name,
    /// Numbers of the tools in the robot, 0 to 15; tool 0 is the flange.
    #[cfg_attr(test, schemars(with = "BTreeMap<String, u8>"))]
    pub(crate) tools: BTreeMap<String, Spanned<u8>>,
    /// Numbers of the bases in the robot, 0 to 15; base 0 is the robot's root.
    #[cfg_attr(test, schemars(with = "BTreeMap<String, u8>"))]
    pub(crate) bases: BTreeMap<String, Spanned<u8>>,
    /// How motions blend.
    #[serde(default)]
    pub(crate) zones: Zones,
    /// How secondary motions find their way over obstacles; required if there are obstacles.
    pub(crate) ways: Option<Ways>,
    /// Frames by their names.
    #[cfg_attr(test, schemars(with = "BTreeMap<String, Frame>"))]
    pub(crate) frames: BTreeMap<String, Spanned<Frame>>,
    /// Rows, columns and layers of equal distance. The steps run once for each cell.
    #[serde(default)]
    #[cfg_attr(test, schemars(with = "BTreeMap<String, Grid>"))]
    pub(crate) grids: BTreeMap<String, Spanned<Grid>>,
    /// What the PLC (in RC the robot's program) does at an accurate stop.
    #[serde(default)]
    #[cfg_attr(test, schemars(with = "BTreeMap<String, Action>"))]
    pub(crate) actions: BTreeMap<String, Spanned<Action>>,
    /// Boxes that no motion may come near.
    #[serde(default, rename = "obstacle")]
    #[cfg_attr(test, schemars(with = "Vec<Obstacle>"))]
    pub(crate) obstacles: Vec<Spanned<Obstacle>>,
    /// Elastic surfaces that LIN force can press against; part of the simulated cell, not of the plan.
    #[serde(default, rename = "surface")]
    #[cfg_attr(test, schemars(with = "Vec<Surface>"))]
    pub(crate) surfaces: Vec<Spanned<Surface>>,
    /// The process steps, in order.
    #[serde(rename = "step")]
    #[cfg_attr(test, schemars(with = "Vec<Step>"))]
    pub(crate) steps: Vec<Spanned<Step>>,
}

/// How motions blend.
#[derive(Clone, Deserialize, Default)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Zones {
    /// Approximation distance in mm, instead of the setup's.
    #[cfg_attr(test, schemars(with = "Option<f64>"))]
    pub(crate) approximation_mm: Option<Spanned<f64>>,
    /// How far an accurate path may leave its course where one segment runs smoothly into the next, in mm; 0 stops there.
    #[cfg_attr(test, schemars(with = "Option<f64>"))]
    pub(crate) path_tolerance_mm: Option<Spanned<f64>>,
}

/// How secondary motions find their way over obstacles.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Ways {
    /// Distance from obstacles that tool, part and safety need, in mm.
    #[cfg_attr(test, schemars(with = "f64"))]
    pub(crate) clearance_mm: Spanned<f64>,
    /// Highest z of an intermediate position, in mm.
    #[cfg_attr(test, schemars(with = "f64"))]
    pub(crate) ceiling_mm: Spanned<f64>,
    /// Intermediate positions are at whole multiples of this height, in mm.
    #[cfg_attr(test, schemars(with = "f64"))]
    pub(crate) height_step_mm: Spanned<f64>,
    /// A PTP deviates from the straight line by no more than an arc of this radius, in mm.
    #[cfg_attr(test, schemars(with = "f64"))]
    pub(crate) ptp_radius_mm: Spanned<f64>,
    /// How much longer a way may be in order to reuse the intermediate position of another way, in %.
    #[cfg_attr(test, schemars(with = "f64"))]
    pub(crate) detour_percent: Spanned<f64>,
}

/// A frame: either by `mm_deg`, or `on` another one.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Frame {
    /// x, y, z in mm and a, b, c in degrees about z, y', x'', in the base.
    pub(crate) mm_deg: Option<[f64; 6]>,
    /// Frame or grid that this one is derived from.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub(crate) on: Option<Name>,
    /// Shift from the frame `on`, in mm along the base's axes.
    pub(crate) shift_mm: Option<[f64; 3]>,
    /// Joints by which a PTP reaches the frame, in degrees; a linear joint in mm, unused ones 0.
    pub(crate) joints_deg: Option<[f64; 6]>,
    /// Configuration in which the arm is there.
    #[cfg_attr(test, schemars(with = "Option<Configuration>"))]
    pub(crate) configuration: Option<Spanned<Configuration>>,
}

/// A configuration of the arm.
#[derive(Deserialize, Clone, Copy)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Configuration {
    /// Which of the ways to reach the pose: three bits.
    pub(crate) status: u8,
    /// One bit for each joint: 1 if it is below 0°.
    pub(crate) turn: Option<u8>,
}

/// A grid of frames.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Grid {
    /// Frame of the first cell.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) corner: Name,
    /// Cells along x, y and z; x counts fastest.
    pub(crate) count: [u32; 3],
    /// Distance between neighbours along x, y and z, in mm.
    pub(crate) pitch_mm: [f64; 3],
}

/// An output that is switched, and a wait.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Action {
    /// Digital output, 0 to 15.
    pub(crate) output: u8,
    /// Whether the output is set or cleared.
    pub(crate) set: bool,
    /// Time to wait afterwards, in ms.
    pub(crate) wait_ms: f64,
}

/// A box that no motion may come near, in the base.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Obstacle {
    /// Name in messages.
    pub(crate) name: String,
    /// Lowest x, y, z, in mm.
    pub(crate) lower_mm: [f64; 3],
    /// Highest x, y, z, in mm.
    pub(crate) upper_mm: [f64; 3],
}

/// A flat elastic surface.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Surface {
    /// Name.
    pub(crate) name: String,
    /// Frame of a point of the surface; of its middle if it has a radius.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) middle: Name,
    /// Direction out of the surface, to where the tool is free.
    pub(crate) normal: [f64; 3],
    /// Extent from the middle, in mm; a whole plane if left out.
    #[cfg_attr(test, schemars(with = "Option<f64>"))]
    pub(crate) radius_mm: Option<Spanned<f64>>,
    /// Force for each mm that the tool is inside, in N/mm.
    #[cfg_attr(test, schemars(with = "f64"))]
    pub(crate) stiffness_n_per_mm: Spanned<f64>,
}

/// A process step.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Step {
    /// Short name; the motions are named after it.
    pub(crate) name: String,
    /// What it is for.
    #[serde(default)]
    pub(crate) does: String,
    /// What the process asks of the motions.
    #[cfg_attr(test, schemars(with = "Vec<Label>"))]
    pub(crate) labels: Spanned<Vec<Label>>,
    /// Tool of this step; the application's if left out.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub(crate) tool: Option<Name>,
    /// Base of this step's frames; the application's if left out.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub(crate) base: Option<Name>,
    /// Frame to be at, by whatever way. Either this or `path`.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub(crate) reach: Option<Name>,
    /// Frame at which the path begins; where the tool is if left out.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub(crate) from: Option<Name>,
    /// Segments to follow.
    #[cfg_attr(test, schemars(with = "Option<Vec<Segment>>"))]
    pub(crate) path: Option<Spanned<Vec<Segment>>>,
    /// Length of the linear pre-movement in mm; needs `from`.
    #[cfg_attr(test, schemars(with = "Option<f64>"))]
    pub(crate) approach_mm: Option<Spanned<f64>>,
    /// Length of the linear post-movement in mm; after `press` straight back.
    #[cfg_attr(test, schemars(with = "Option<f64>"))]
    pub(crate) retreat_mm: Option<Spanned<f64>>,
    /// Highest speed on the path in mm/s, in addition to the setup's.
    #[cfg_attr(test, schemars(with = "Option<f64>"))]
    pub(crate) speed_mm_s: Option<Spanned<f64>>,
    /// Share of the setup's programmed speed in %, for all motions of the step.
    #[cfg_attr(test, schemars(with = "Option<f64>"))]
    pub(crate) speed_percent: Option<Spanned<f64>>,
    /// Action at the end of the step; needs the label `accurate-stop`.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub(crate) then: Option<Name>,
}

/// What the process asks of the motions of a step.
#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Label {
    /// Smooth transition between the motions.
    Blending,
    /// The path is executed without blending.
    AccuratePath,
    /// The arm stops exactly at the end of the step.
    AccurateStop,
}

/// A segment of a path.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Segment {
    /// Straight line to this frame.
    Line(#[cfg_attr(test, schemars(with = "String"))] Name),
    /// Circular arc.
    Circle(Circle),
    /// Spline through these frames, from where the tool is.
    Spline(#[cfg_attr(test, schemars(with = "Vec<String>"))] Spanned<Vec<Name>>),
    /// Straight line until contact, then the force.
    Press(Press),
}

/// An arc.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Circle {
    /// Frame that the arc passes.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) through: Name,
    /// Frame at its end.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) to: Name,
}

/// A straight line until contact, and a force there.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Press {
    /// Frame where it ends at the latest.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) to: Name,
    /// Force in N along the base's axes, pointing along the line.
    #[cfg_attr(test, schemars(with = "[f64; 3]"))]
    pub(crate) force_n: Spanned<[f64; 3]>,
}

#[cfg(test)]
mod tests {
    use super::File;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    fn the_committed_schema_is_that_of_the_types() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/application.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(File)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            include_str!("../../schemas/application.schema.json") == schema,
            "the keys of an application changed: INSTA_UPDATE=always cargo test -p planning the_committed_schema"
        );
    }
}
