//! What stands around the arm: obstacles and targets, in the root's frame.

use planning::Application;
use protocol::image::Motion;
use robot_node::arm::Frame;
use serde::Serialize;

use super::chain::Placed;

/// Targets that are drawn at most: those of a grid would hide the arm.
const TARGETS: usize = 200;

/// What stands around the arm.
#[derive(Serialize, Debug)]
pub(super) struct Cell {
    /// Frame of the obstacles.
    base: Placed,
    pub(super) obstacles: Vec<SceneObstacle>,
    /// Programmed targets, each position once.
    pub(super) targets: Vec<[f64; 3]>,
}

/// A box along the axes of the base.
#[derive(Serialize, Debug)]
pub(super) struct SceneObstacle {
    lower_mm: [f64; 3],
    upper_mm: [f64; 3],
    /// Its corners in the root's frame.
    #[serde(skip)]
    pub(super) corners: [[f64; 3]; 8],
}

impl Cell {
    pub(super) fn of(application: &Application, base: &Frame, motions: &[Motion]) -> Self {
        let obstacle = |obstacle: &planning::Obstacle| {
            let (lower, upper) = (obstacle.space.lower, obstacle.space.upper);
            let corner = |index: usize| {
                let pick = |bit: usize, low: f64, high: f64| if index >> bit & 1 == 0 { low } else { high };
                base.point([pick(0, lower.x, upper.x), pick(1, lower.y, upper.y), pick(2, lower.z, upper.z)])
            };
            SceneObstacle {
                lower_mm: [lower.x, lower.y, lower.z],
                upper_mm: [upper.x, upper.y, upper.z],
                corners: std::array::from_fn(corner),
            }
        };
        let mut targets: Vec<[f64; 3]> = Vec::new();
        for motion in motions.iter().filter(|motion| !motion.kind.has_joint_target()) {
            let [x, y, z, ..] = motion.target.map(f64::from);
            let at = base.point([x, y, z]);
            if targets.len() < TARGETS && !targets.contains(&at) {
                targets.push(at);
            }
        }
        Self {
            base: Placed::new(base),
            obstacles: application.obstacles.iter().map(obstacle).collect(),
            targets,
        }
    }
}
