//! Judges the robot's motion by kinematics and laws that are not the robot's own.
//!
//! ```text
//! generator   an arm, motions and disturbances at random, from a seed
//! case        the same as a file that runs again
//! driver      runs a case on the robot's controller in virtual time
//! law         holds every robot cycle against what must always be so, with ...
//! ├─ kinematics  ... its own forward kinematics from the link drawings, and
//! └─ way         its own geometry of lines and circles
//! shrink      the least case that breaks the same law
//! ```
//!
//! The robot's own modules for arm, motion and quality are not used: an error in them must not judge itself. The limits
//! are those of the setup or, where the arm is a random one, of the case.

pub mod case;
pub mod driver;
pub mod generator;
pub mod hunt;
pub mod kinematics;
pub mod law;
pub mod shrink;
pub mod violation;
mod way;

pub use case::{Case, CaseError};
pub use driver::{Outcome, run};
pub use hunt::{Tally, hunt};
pub use violation::{Broken, Class, Violation};
