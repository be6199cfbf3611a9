//! The paper's planning method (section 4): from process steps with labels to motions and continuous motions.
//!
//! A process engineer writes an [`Application`]: frames, steps that name what the process asks of the path, obstacles.
//! [`plan()`] makes motions of it on a [`Setup`](setup::Setup):
//!
//! 1. the accurate-path motions from the process frames (step I),
//! 2. extended by linear pre- and post-movements (step II),
//! 3. the secondary motions in between as PTP, on a way that is free of obstacles (step III),
//! 4. gathered into continuous motions, each of which ends in an accurate stop, with a zone for every junction
//!    (step IV).
//!
//! A [`Plan`] prints itself with the reason for every zone, and gives the motions in the units of the wire. A long
//! repetition is a [`stream()`], which holds one cycle; motions from elsewhere are read from a list by
//! [`MotionLines`], which holds one.
//!
//! Several arms have one [`ArmsApplication`]: each arm's part is planned like any application, on the setup of its station, and
//! the marks at which they wait for each other become places in its list of motions ([`PlannedCell`]).
//!
//! What can be known without an arm is refused while planning, with the step, the motion, the quantity and its limit.
//! [`Plan::reach`] then follows a plan with the arm of a setup.

mod application;
mod arms;
mod arms_file;
mod cell;
mod check;
mod clearance;
mod compact_form;
mod course;
mod display;
mod error;
mod file;
mod geometry;
mod list;
mod load;
mod mark_outputs;
mod mark_signal;
mod meeting;
mod motion;
mod out_of_reach;
mod path;
mod plan;
mod planner;
mod points;
mod reach;
mod refusal;
mod resolve;
mod shared_zone;
mod source;
mod step_base;
mod stopped;
mod stream;
mod swing;
mod vary;
mod warnings;
mod way;
mod wire;
mod zone;

pub use application::{
    Action, Application, Course, Grid, Labels, Obstacle, Place, Segment, Step, Surface, Tool, Wait, Ways,
    Zones,
};
pub use arms::{ArmApplication, ArmsApplication, Mark};
pub use cell::{
    FoundCell, PlannedCell, PlannedStation, applications_of, cell_and_application, cell_with_applications,
};
pub use compact_form::NotCompact;
pub use error::Error;
pub use geometry::{Cuboid, Point, Pose};
pub use list::{COLUMNS, ListError, MotionLines, write_header, write_motion};
pub use load::{
    APPLICATIONS, ARMS_APPLICATIONS, Found, application, setup_and_application, setup_with_application,
};
pub use mark_outputs::{assign_mark_signals, outputs_of_waits};
pub use mark_signal::MarkSignal;
pub use meeting::NoMeeting;
pub use motion::{Motion, Role};
pub use out_of_reach::{OrBase, OutOfReach, SwingsTooNear};
pub use plan::{Continuous, Plan, Reason, StepLabels, ToStart, WaitAt, ZoneVisit};
pub use planner::plan;
pub use points::{CompactError, CompactPath};
pub use reach::Reached;
pub use refusal::{LEAST_MM, Refusal};
pub use shared_zone::{ArmVolume, MOST_ZONES, NoTurns, StationZones, Waited, ZoneSet, check_turns};
pub use source::Source;
pub use stopped::{Stopped, Unfit};
pub use stream::{Stream, Streamed, count, stream, to_start};
pub use wire::{Meeting, PROGRAM, ProgramSection, Stop, Switch};
pub use zone::Why;
