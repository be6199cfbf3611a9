//! CIP explicit messages: paths, requests, replies and their statuses (volume 1).

mod intervals;
mod key;
mod message;
mod object_class;
mod path;
mod status;
mod violation;

pub use intervals::{AcceptableIntervals, IntervalLimit};
pub use key::{ElectronicKey, KeyMismatch, Revision};
pub use message::{Reply, Request, emit_refusal, emit_reply, service};
pub use object_class::{ObjectClass, class};
pub use path::{Application, Logical, Path, PathError, Segment, Target, write_logical};
pub use status::{Extended, General};
pub use violation::{Extra, Status, Violation};
