//! Opening and closing connections: the Connection Manager's services (volume 1, 3-5).

mod data;
mod format;
mod open;
mod parameters;
mod timing;
mod triad;

pub use data::{ConnectionData, DirectionData};
pub use format::RealTimeFormat;
pub use open::{CloseReply, CloseRequest, OpenReply, OpenRequest, RefusedReply};
pub use parameters::{ConnectionType, Parameters, Priority, Transport, Trigger};
pub use timing::{Inhibit, TimeoutMultiplier, Watchdog, sequence};
pub use triad::Triad;
