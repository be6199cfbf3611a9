//! From motions to joints: geometry without time, limits, corners, one speed along the path, and a sample of it every
//! robot cycle.
//!
//! [`Segment`] is one checked motion on its [`Curve`]; [`Blend`] the corner between two; [`Profile`] the time law of
//! what lies between corners; [`Path`] the look-ahead over all that is known; [`Interpolator`] drives along it, and
//! holds each cycle against what the axes are rated for before it is driven.

mod along;
mod append;
mod arc;
mod axis_monitor;
mod blend;
mod curve;
mod derivatives;
mod flange;
mod interpolator;
mod load;
mod path;
mod plan;
mod profile;
mod segment;
mod settle;
mod spline;
mod split;

pub use append::Appended;
pub use arc::Arc;
pub use blend::Blend;
pub use curve::{AxisLine, Curve, Line};
pub use flange::Flange;
pub use interpolator::{Interpolator, Step};
pub use path::{Path, Place};
pub use profile::{Change, Limits, Pace, Profile, reachable_speed};
pub use segment::{Programmed, Segment};
pub(crate) use settle::next_change;
pub use spline::Spline;
