//! One motion as the arm follows it, and the corner into the next one: geometry and limits, without time.
//!
//! [`Segment`] is one checked motion on its [`Curve`], with the derivatives of joints and tool at a row of nodes.
//! [`Blend`] is the corner between two motions. The robot node drives along both; planning makes the same before a run, so
//! that it refuses what the robot node would refuse, by the same figures.

mod along;
mod arc;
pub mod blend;
mod chebyshev;
mod corner;
pub mod curve;
mod derivatives;
mod flange;
pub mod node;
pub mod nodes;
pub mod segment;
pub mod spline;

pub use arc::Arc;
pub use blend::Blend;
pub use corner::Hindrance;
pub use curve::{AxisLine, Curve, Line};
pub use flange::Flange;
pub use node::Limits;
pub use segment::{Programmed, Robot, Segment};
pub use spline::Spline;
