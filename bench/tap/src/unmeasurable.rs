//! Reasons why a capture cannot be measured.

use records::counted::counted;

use crate::address::{CyclicBus, EndAddress};

/// Reason why a capture cannot be measured.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Unmeasurable {
    /// There are no cyclic frames.
    #[error(
        "no cyclic frame of PROFINET or EtherNet/IP among {}: capture on the cable between PLC and robot, or at a \
         mirror port",
        counted(*packets, "packet")
    )]
    NoCyclicFrames {
        /// Packets in the capture.
        packets: u64,
    },
    /// No cyclic frame has the image.
    #[error(
        "{frames} cyclic frames, none with the process image: begin the capture before the PLC connects, or have both ends send \
         the check"
    )]
    NoImage {
        /// Cyclic frames in the capture.
        frames: u64,
    },
    /// Only one direction is there.
    #[error("only frames {present} are in the capture, none {missing}: mirror both directions of the port")]
    OneDirection {
        /// The direction that is there.
        present: &'static str,
        /// The other one.
        missing: &'static str,
    },
    /// Several robots.
    #[error("{} robots are in the capture, {}: choose one by --robot", .0.len(), listed(.0))]
    SeveralRobots(Vec<EndAddress>),
    /// Robots on several buses have one address, so that none can be chosen by it.
    #[error(
        "{} robots in the capture have the address {robot}, over {}: leave the frames of one bus out of the capture",
        buses.len(),
        buses.iter().map(ToString::to_string).collect::<Vec<_>>().join(" and over ")
    )]
    SharedAddress {
        /// The address.
        robot: EndAddress,
        /// The buses.
        buses: Vec<CyclicBus>,
    },
    /// The chosen robot is not there.
    #[error("no robot {wanted} in the capture: it has {}", listed(found))]
    OtherRobots {
        /// The chosen one.
        wanted: EndAddress,
        /// Those that are there.
        found: Vec<EndAddress>,
    },
    /// Several PLCs command the robot.
    #[error("{} PLCs command the robot {robot}, {}: capture with one of them", plcs.len(), listed(plcs))]
    SeveralPlcs {
        /// The robot.
        robot: EndAddress,
        /// The PLCs.
        plcs: Vec<EndAddress>,
    },
    /// No repetition is complete.
    #[error("no complete repetition in the capture: {0}")]
    NoRepetition(String),
}

fn listed(addresses: &[EndAddress]) -> String {
    addresses.iter().map(ToString::to_string).collect::<Vec<_>>().join(" and ")
}
