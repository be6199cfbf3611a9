//! From motions to joints: geometry without time, limits, corners, one speed along the path, and a sample of it every
//! robot cycle.
//!
//! [`Segment`] is one checked motion on its [`Curve`], with what that asks of the arm at a row of nodes; [`Blend`] the corner
//! between two; the law (`law.rs`) how fast all of it is driven from one rest to the next; [`Path`] the look-ahead over all that is
//! known; [`Interpolator`] drives along it, and holds each cycle against what the axes are rated for before it is driven.

mod along;
mod append;
mod arc;
mod axis_monitor;
mod blend;
mod cell;
mod curve;
mod derivatives;
mod flange;
mod grid;
mod interpolator;
mod knot;
mod law;
mod load;
mod node;
mod nodes;
mod override_ramp;
mod path;
mod piece;
mod replan;
mod segment;
mod settle;
mod slopes;
mod spline;
mod time_scale;

pub use append::Appended;
pub use arc::Arc;
pub use blend::Blend;
pub use curve::{AxisLine, Curve, Line};
pub use flange::Flange;
pub use interpolator::{Interpolator, Step};
pub use node::Limits;
pub use path::{Path, Place};
pub use segment::{Programmed, Segment};
pub(crate) use settle::next_change;
pub use spline::Spline;
