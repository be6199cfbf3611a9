//! The application file for several arms as it is written. Each arm's part is made into a [`File`] of its own, which is resolved
//! as any application is.

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::Spanned;

use crate::file::{Action, File, Frame, Grid, Label, Name, Obstacle, Segment, Step, Surface, Ways, Zones};

/// An application for several arms: what each is to do, and where they wait for each other.
#[derive(Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, schemars(rename = "ArmsApplication"))]
pub(crate) struct ArmsFile {
    /// Version of this file format: 3.
    #[cfg_attr(test, schemars(with = "u32"))]
    pub(crate) schema: Spanned<u32>,
    /// Short name.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) name: Name,
    /// What happens, one line.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) title: Name,
    /// How the motions of all arms blend.
    #[serde(default)]
    pub(crate) zones: Zones,
    /// Frames by their names, for all arms.
    #[cfg_attr(test, schemars(with = "BTreeMap<String, Frame>"))]
    pub(crate) frames: BTreeMap<String, Spanned<Frame>>,
    /// Rows, columns and layers of equal distance, for all arms. The steps of each arm run once for each cell.
    #[serde(default)]
    #[cfg_attr(test, schemars(with = "BTreeMap<String, Grid>"))]
    pub(crate) grids: BTreeMap<String, Spanned<Grid>>,
    /// What the PLC (in RC the robot's program) does at an accurate stop or after a mark.
    #[serde(default)]
    #[cfg_attr(test, schemars(with = "BTreeMap<String, Action>"))]
    pub(crate) actions: BTreeMap<String, Spanned<Action>>,
    /// Boxes that no motion of any arm may come near.
    #[serde(default, rename = "obstacle")]
    #[cfg_attr(test, schemars(with = "Vec<Obstacle>"))]
    pub(crate) obstacles: Vec<Spanned<Obstacle>>,
    /// Elastic surfaces that LIN force can press against; part of the simulated cell, not of the plan.
    #[serde(default, rename = "surface")]
    #[cfg_attr(test, schemars(with = "Vec<Surface>"))]
    pub(crate) surfaces: Vec<Spanned<Surface>>,
    /// The marks at which arms wait for each other.
    #[serde(default, rename = "mark")]
    #[cfg_attr(test, schemars(with = "Vec<Mark>"))]
    pub(crate) marks: Vec<Spanned<Mark>>,
    /// The arms. A setup says by `station.application` which station is which arm.
    #[serde(rename = "arm")]
    #[cfg_attr(test, schemars(with = "Vec<Arm>"))]
    pub(crate) arms: Vec<Spanned<Arm>>,
}

/// A place in the work of several arms at which they wait for each other.
#[derive(Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Mark {
    /// Its number, 1 to 65535.
    pub(crate) number: u32,
    /// What has happened there, in a word or two.
    pub(crate) name: String,
    /// Whether the arms of this mark move together from here to the next mark, each on its own path.
    #[serde(default)]
    pub(crate) together: bool,
}

/// What one arm is to do.
#[derive(Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Arm {
    /// Its name, which `station.application` of a setup gives.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) name: Name,
    /// Tool of all its steps that name no other.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) tool: Name,
    /// Base in which all frames and obstacles are given. The bases of all arms must be one place in the cell.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) base: Name,
    /// Frame at which its tool stands before the first step.
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) start: Name,
    /// Numbers of the tools in its robot, 0 to 15; tool 0 is the flange.
    #[cfg_attr(test, schemars(with = "BTreeMap<String, u8>"))]
    pub(crate) tools: BTreeMap<String, Spanned<u8>>,
    /// Numbers of the bases in its robot, 0 to 15; base 0 is the robot's root.
    #[cfg_attr(test, schemars(with = "BTreeMap<String, u8>"))]
    pub(crate) bases: BTreeMap<String, Spanned<u8>>,
    /// How its secondary motions find their way over obstacles; required if there are obstacles.
    pub(crate) ways: Option<Ways>,
    /// Its process steps and the marks between them, in order.
    #[serde(rename = "step")]
    #[cfg_attr(test, schemars(with = "Vec<ArmStep>"))]
    pub(crate) steps: Vec<Spanned<ArmStep>>,
}

/// A process step, or a mark at which the arm waits.
#[derive(Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct ArmStep {
    /// Short name; the motions are named after it. A mark may go without.
    #[serde(default)]
    pub(crate) name: String,
    /// What it is for.
    #[serde(default)]
    pub(crate) does: String,
    /// Number of the mark at which the arm waits, instead of a motion; only with `name`, `does` and `then`.
    #[cfg_attr(test, schemars(with = "Option<u32>"))]
    pub(crate) mark: Option<Spanned<u32>>,
    /// What the process asks of the motions; required of a step that moves.
    #[cfg_attr(test, schemars(with = "Option<Vec<Label>>"))]
    pub(crate) labels: Option<Spanned<Vec<Label>>>,
    /// Tool of this step; the arm's if left out.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub(crate) tool: Option<Name>,
    /// Base of this step's frames; the arm's if left out.
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
    /// Action at the end of the step, which then needs the label `accurate-stop`, or once the others have come to the mark.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub(crate) then: Option<Name>,
}

impl ArmStep {
    /// Returns the first key that a mark cannot have.
    pub(crate) const fn key_of_a_motion(&self) -> Option<&'static str> {
        match self {
            Self { labels: Some(_), .. } => Some("labels"),
            Self { tool: Some(_), .. } => Some("tool"),
            Self { base: Some(_), .. } => Some("base"),
            Self { reach: Some(_), .. } => Some("reach"),
            Self { from: Some(_), .. } => Some("from"),
            Self { path: Some(_), .. } => Some("path"),
            Self { approach_mm: Some(_), .. } => Some("approach_mm"),
            Self { retreat_mm: Some(_), .. } => Some("retreat_mm"),
            Self { speed_mm_s: Some(_), .. } => Some("speed_mm_s"),
            Self { speed_percent: Some(_), .. } => Some("speed_percent"),
            _ => None,
        }
    }

    /// Returns the step of an application for one arm, if this is one with labels.
    pub(crate) fn step(self) -> Option<Step> {
        let Self { name, does, mark: None, labels: Some(labels), tool, base, reach, from, .. } = self else {
            return None;
        };
        let Self { path, approach_mm, retreat_mm, speed_mm_s, speed_percent, then, .. } = self;
        Some(Step {
            name,
            does,
            labels,
            tool,
            base,
            reach,
            from,
            path,
            approach_mm,
            retreat_mm,
            speed_mm_s,
            speed_percent,
            then,
        })
    }
}

impl ArmsFile {
    /// Returns the file of one arm with these steps, as if it worked alone.
    pub(crate) fn of_arm(&self, arm: &Arm, steps: Vec<Spanned<Step>>) -> File {
        File {
            schema: self.schema.clone(),
            name: Spanned::new(self.name.span(), format!("{}-{}", self.name.get_ref(), arm.name.get_ref())),
            title: self.title.clone(),
            tool: arm.tool.clone(),
            base: arm.base.clone(),
            start: arm.start.clone(),
            tools: arm.tools.clone(),
            bases: arm.bases.clone(),
            zones: self.zones.clone(),
            ways: arm.ways.clone(),
            frames: self.frames.clone(),
            grids: self.grids.clone(),
            actions: self.actions.clone(),
            obstacles: self.obstacles.clone(),
            surfaces: self.surfaces.clone(),
            steps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::ArmsFile;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    fn the_committed_schema_of_several_arms_is_that_of_the_types() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/arms-application.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(ArmsFile)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            include_str!("../../schemas/arms-application.schema.json") == schema,
            "the keys of an application changed: INSTA_UPDATE=always cargo test -p planning the_committed_schema"
        );
    }
}
