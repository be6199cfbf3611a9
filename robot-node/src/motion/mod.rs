//! From motions to joints: geometry without time, limits, corners, one speed along the path, and a sample of it every
//! robot cycle.
//!
//! [`Segment`] is one checked motion on its [`Curve`]; [`Blend`] the corner between two; [`Profile`] the time law of
//! what lies between corners; [`Path`] the look-ahead over all that is known; [`Interpolator`] drives along it.

mod along;
mod append;
mod arc;
mod blend;
mod curve;
mod derivatives;
mod interpolator;
mod path;
mod plan;
mod profile;
mod segment;
mod spline;

pub use append::Appended;
pub use arc::Arc;
pub use blend::Blend;
pub use curve::{AxisLine, Curve, Flange, Line};
pub use interpolator::{Interpolator, Step};
pub use path::{Path, Place};
pub use profile::{Change, Limits, Pace, Profile, reachable_speed};
pub use segment::Segment;
pub use spline::Spline;
