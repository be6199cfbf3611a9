//! Measures a PLC and a robot from captured frames alone, whoever made them.
//!
//! [`CaptureObserver`] is a machine: it takes frames with their times and returns [`Findings`] at the end. It has no clock and no file, and
//! its memory does not grow with the number of frames.
//!
//! ```text
//! packet       a frame down to UDP, TCP or PROFINET
//! relation     what Connect and Forward_Open say of cyclic frames: direction, place of the image, cycle
//! cyclic       the cyclic frames of PROFINET and EtherNet/IP
//! seen         stations by name and identity: DCP, LLDP, ARP, ListIdentity, records, the endpoint mapper
//! content      direction and place of the image, from the bytes alone
//! flow         the frames of one connection in one direction: doubled, missing; pace: their intervals and lateness
//! skill        the skills of one PLC and one robot
//! pattern      repetitions among them, by the plan; repetition: their times
//! station      all of one robot; traffic: all of the capture besides
//! observer     the machine; findings: its results; unmeasurable: why there are none
//! ```

#![cfg_attr(not(test), warn(clippy::indexing_slicing))]

mod address;
mod content;
mod cyclic;
mod expected;
mod findings;
mod flow;
mod observer;
mod pace;
mod packet;
mod pattern;
mod relation;
mod repetition;
mod seen;
mod skill;
mod station;
mod traffic;
mod unmeasurable;

pub use address::{CyclicBus, EndAddress};
pub use expected::ExpectedRun;
pub use findings::{
    DirectionFindings, FINDINGS_VERSION, Findings, Reaction, RepetitionFindings, TypeFindings,
};
pub use observer::{CaptureObserver, TapConfig};
pub use unmeasurable::Unmeasurable;
