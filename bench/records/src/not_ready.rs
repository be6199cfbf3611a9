//! Why a virtual run did not begin.

use std::time::Duration;

/// The nodes of a virtual run did not connect, or the robot did not get ready. In virtual time neither host nor network can
/// be the reason: without a fault it is the setup.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum NotReady {
    /// The bus found another robot than the setup describes; with the reason in its words.
    #[error("no connection to the robot: {0}")]
    OtherRobot(String),
    /// The bus found no robot, or lost it at once; with the reason in its words.
    #[error("no connection to the robot: {0}")]
    NotConnected(String),
    /// Nothing came of the connection within this time.
    #[error("the robot was not ready within {} s of virtual time", .0.as_secs())]
    Late(Duration),
    /// The PLC only waited.
    #[error("the PLC has waited {seconds} s of virtual time for {for_what}")]
    Waiting {
        /// Time without progress, in s.
        seconds: u32,
        /// What it waits for, as text.
        for_what: String,
    },
    /// The arm was still moving to where the application starts.
    #[error(
        "the arm was still on its way to the start of the application after {} s of virtual time: raise \
         motions.velocity_percent, or begin the application nearer to the robot's home_deg",
        .0.as_secs()
    )]
    StillMoving(Duration),
}
