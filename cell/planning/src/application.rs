//! The content of an application, with every name resolved.
//!
//! Only [`Application::parse`] makes one, so a planner never finds a name that does not exist.

use std::fmt;

use protocol::image::Configuration;

use crate::geometry::{Cuboid, Point, Pose};

/// What the robot is to do, as a process engineer describes it.
#[derive(Clone, PartialEq, Debug)]
pub struct Application {
    /// Short name.
    pub name: String,
    /// What happens in it.
    pub title: String,
    /// Base frame of all frames and obstacles, by its number in the robot.
    pub base: u8,
    /// Where the tool stands before the first step, and which tool it is.
    pub start: (Place, Tool),
    /// How blends are sized.
    pub zones: Zones,
    /// How ways over obstacles are found; may be missing without obstacles.
    pub ways: Option<Ways>,
    /// The grids that the frames move on from one cycle to the next. All have the same number of cells.
    pub grids: Vec<Grid>,
    /// The obstacles that no way may come near.
    pub obstacles: Vec<Obstacle>,
    /// The surfaces that the tool can press against.
    pub surfaces: Vec<Surface>,
    /// The process steps in order; the last ends in an accurate stop.
    pub steps: Vec<Step>,
    /// Where the arm waits for others, in order; empty where one arm works alone.
    pub waits: Vec<Wait>,
    /// The tools and bases that the file has and no step uses, such as "tool `probe`".
    pub unused: Vec<String>,
}

/// A place between steps at which the arm waits at a mark until the other arms of that mark have come.
#[derive(Clone, PartialEq, Debug)]
pub struct Wait {
    /// Number of the mark.
    pub mark: u32,
    /// How many steps come before it.
    pub after_steps: usize,
    /// What happens once the others have come.
    pub then: Option<Action>,
}

impl Application {
    /// Returns how often the steps run in one pass: once for each cell of the grids, or once without a grid.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.grids.first().map_or(1, Grid::cells)
    }

    /// Returns where the arm waits after this many steps.
    pub(crate) fn waits_after(&self, steps: usize) -> impl Iterator<Item = &Wait> {
        self.waits.iter().filter(move |wait| wait.after_steps == steps)
    }

    /// Returns the pose of a place in a cell, which is counted from 0.
    #[must_use]
    pub fn pose(&self, place: &Place, cell: usize) -> Pose {
        match place.grid.and_then(|grid| self.grids.get(grid)) {
            Some(grid) => place.pose.at(place.pose.point + grid.offset(cell)),
            None => place.pose,
        }
    }
}

/// How blends are sized.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Zones {
    /// Approximation distance in mm in place of the setup's.
    pub approximation_mm: Option<f64>,
    /// Largest deviation of an accurate path from its course in mm, where an arc runs smoothly into the next segment;
    /// with 0 the arm stops there.
    pub path_tolerance_mm: f64,
}

/// How ways over obstacles are found.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Ways {
    /// Distance in mm that stays free around the tool's path: half of tool and part, and a safety distance.
    pub clearance_mm: f64,
    /// Highest z of an intermediate position, in mm.
    pub ceiling_mm: f64,
    /// Intermediate positions lie at whole multiples of this height, in mm.
    pub height_step_mm: f64,
    /// Radius in mm of an arc that deviates from the straight line at least as much as a PTP: about the tool's smallest
    /// distance from the arm's first axis.
    pub ptp_radius_mm: f64,
    /// How much longer a way may be, in %, in order to use an intermediate position of another way of the cycle.
    pub detour_percent: f64,
}

/// Rows, columns and layers of equal pitch.
#[derive(Clone, PartialEq, Debug)]
pub struct Grid {
    /// Its name in the file.
    pub name: String,
    /// Cells along x, y and z; x counts fastest.
    pub count: [u32; 3],
    /// Distance between neighbours along x, y and z, in mm.
    pub pitch_mm: [f64; 3],
}

impl Grid {
    /// Returns the number of cells.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.count.iter().map(|&count| count as usize).product()
    }

    /// Returns the displacement from the first cell to the cell with this number, counted from 0; after the last cell the
    /// count starts again.
    #[must_use]
    pub fn offset(&self, cell: usize) -> Point {
        let mut rest = cell;
        let mut offset = [0.0; 3];
        for ((offset, count), pitch) in offset.iter_mut().zip(self.count).zip(self.pitch_mm) {
            let count = (count as usize).max(1);
            *offset = (rest % count) as f64 * pitch;
            rest /= count;
        }
        offset.into()
    }
}

/// The obstacles that no way may come near.
#[derive(Clone, PartialEq, Debug)]
pub struct Obstacle {
    /// Its name.
    pub name: String,
    /// The space that it fills.
    pub space: Cuboid,
}

/// A flat elastic surface that the tool can press against: part of the simulated cell, not of the plan.
#[derive(Clone, PartialEq, Debug)]
pub struct Surface {
    /// Its name.
    pub name: String,
    /// A point on it; its middle, where it is bounded.
    pub middle: Point,
    /// The unit vector out of it, towards where the tool is free.
    pub normal: Point,
    /// How far from its middle it reaches, in mm; none for a whole plane.
    pub radius_mm: Option<f64>,
    /// How much more it pushes back with for each millimetre that the tool is in it, in N/mm.
    pub stiffness_n_per_mm: f64,
}

/// A named frame.
#[derive(Clone, PartialEq, Debug)]
pub struct Place {
    /// Its name in the file.
    pub name: String,
    /// Where it is in the first cell.
    pub pose: Pose,
    /// The grid that it moves on.
    pub grid: Option<usize>,
    /// The joints by which a PTP gets there, in degrees (a linear axis in mm), where the configuration matters.
    pub joints_deg: Option<[f64; 6]>,
    /// The configuration in which the arm is there, where it matters.
    pub configuration: Option<Configuration>,
}

/// A tool frame of the robot.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Tool {
    /// Its name in the file.
    pub name: String,
    /// Its number in the robot; 0 is the flange.
    pub number: u8,
}

/// The labels of a process step (paper, section 4). Without any it is *blending*: smooth passage between segments.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Labels {
    /// The path is executed without blending.
    pub accurate_path: bool,
    /// Exact stop at the end.
    pub accurate_stop: bool,
}

impl fmt::Display for Labels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match (self.accurate_path, self.accurate_stop) {
            (true, true) => "accurate path, accurate stop",
            (true, false) => "accurate path",
            (false, true) => "blending, accurate stop",
            (false, false) => "blending",
        })
    }
}

/// One step of the process.
#[derive(Clone, PartialEq, Debug)]
pub struct Step {
    /// Short name; the motions are named after it.
    pub name: String,
    /// What it is for.
    pub does: String,
    /// What the process asks of the path and of its end.
    pub labels: Labels,
    /// The tool that follows the path.
    pub tool: Tool,
    /// Number of the base in which its frames are; the application's where it names none.
    pub base: Option<u8>,
    /// What is to be done.
    pub course: Course,
    /// Highest speed along the path in mm/s, besides the setup's programmed one.
    pub speed_mm_s: Option<f64>,
    /// Share of the setup's programmed speed for all motions of the step, in %.
    pub speed_percent: f64,
    /// What happens at the accurate stop.
    pub then: Option<Action>,
}

/// The task of a step for the tool.
#[derive(Clone, PartialEq, Debug)]
pub enum Course {
    /// A secondary motion: reach the frame by any path.
    Reach(Place),
    /// A primary process: follow the path.
    Follow {
        /// Where the path begins; without it, where the tool is.
        from: Option<Place>,
        /// Its segments in order, at least one.
        segments: Vec<Segment>,
        /// Length in mm of the linear pre-movement, straight into the path's first direction.
        approach_mm: f64,
        /// Length in mm of the linear post-movement, straight on in the path's last direction.
        retreat_mm: f64,
    },
}

/// One segment of a path.
#[derive(Clone, PartialEq, Debug)]
pub enum Segment {
    /// A straight line to a frame.
    Line(Place),
    /// A circle through one frame to another.
    Circle {
        /// The intermediate point.
        through: Place,
        /// Where it ends.
        to: Place,
    },
    /// A spline through all frames, from where the segment before ends.
    Spline(Vec<Place>),
    /// A straight line that ends in contact and then holds a force.
    Press {
        /// Where it ends at the latest.
        to: Place,
        /// The force in N along x, y, z of the base.
        force_n: [f64; 3],
    },
}

impl Segment {
    /// Returns the frames at which its motions end.
    pub(crate) fn places(&self) -> &[Place] {
        match self {
            Self::Line(to) | Self::Circle { to, .. } | Self::Press { to, .. } => std::slice::from_ref(to),
            Self::Spline(places) => places,
        }
    }
}

/// What happens at an accurate stop before the next continuous motion begins: a gripper, a valve.
#[derive(Clone, PartialEq, Debug)]
pub struct Action {
    /// Its name in the file.
    pub name: String,
    /// Which bit of the PLC's digital outputs, 0..=15.
    pub output: u8,
    /// Whether the output is set or cleared.
    pub set: bool,
    /// How long the PLC waits afterwards, in ms.
    pub wait_ms: f64,
}
