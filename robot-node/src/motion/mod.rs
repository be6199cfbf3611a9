//! From motions to joints: geometry without time, limits, corners, one speed along the path, and a sample of it every
//! robot cycle.
//!
//! [`Segment`] is one checked motion on its [`Curve`], and [`Blend`] the corner between two; both are in the crate `arm`, as
//! planning asks for them before a run. The law (`law/`) says how fast they are driven from one rest to the
//! next. [`Path`] is the look-ahead over all motions that are known. [`Interpolator`] drives along the path, and
//! compares each cycle with the ratings of the axes before the arm goes there.

mod append;
mod axis_monitor;
mod batch;
mod capacity;
mod cell;
mod correction;
mod extremes;
mod grid;
mod interpolator;
mod knot;
mod law;
mod load;
mod node;
mod override_ramp;
mod path;
mod piece;
mod refine;
mod refinement;
mod replan;
mod settle;
mod slopes;
mod thinning;
mod time_scale;

use ::arm::motion::{blend, curve, nodes, segment, spline};

pub use ::arm::motion::{Arc, AxisLine, Blend, Curve, Flange, Limits, Line, Programmed, Segment, Spline};
pub use append::Appended;
pub use capacity::MOST_MOTIONS;
pub use interpolator::{Interpolator, Step};
pub use path::{Path, Place};
pub(crate) use settle::next_change;
