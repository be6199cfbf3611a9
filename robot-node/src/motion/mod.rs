//! From motions to joints: geometry without time, limits, corners, one speed along the path, and a sample of it every
//! robot cycle.
//!
//! [`Segment`] is one checked motion on its [`Curve`], with the derivatives of joints and tool at a row of nodes.
//! [`Blend`] is the corner between two motions. The law (`law/`) says how fast they are driven from one rest to the
//! next. [`Path`] is the look-ahead over all motions that are known. [`Interpolator`] drives along the path, and
//! compares each cycle with the ratings of the axes before the arm goes there.

mod along;
mod append;
mod arc;
mod axis_monitor;
mod blend;
mod cell;
mod chebyshev;
mod correction;
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
