//! Faults that begin with a frame: a cut cable, and a node that ends and is started again.

use std::time::Duration;

use node::role::NodeRole;
use virtual_time::Side;

use super::{Change, FaultError, frame, time};

/// A fault that begins when a frame is put into the cable, and ends some time later.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct AtFrame {
    /// The sender of the frame.
    pub from: Side,
    /// Its number among those of its sender, counted from 1.
    pub frame: u64,
    /// What happens then; a cut takes the frame as well.
    pub first: Change,
    /// What ends it.
    pub then: Change,
    /// Time from the one to the other.
    pub after: Duration,
}

impl AtFrame {
    /// Parses a fault from its sender, its key and its value, such as `cut-frame` and `17@10ms`; `None` for another
    /// form.
    pub(super) fn parse(from: Side, key: &str, value: &str) -> Option<Result<Self, FaultError>> {
        let (first, then) = match key {
            "cut-frame" => (Change::Cut, Change::Mend),
            "restart-robot" => (Change::Kill(NodeRole::Robot), Change::Restart(NodeRole::Robot)),
            "restart-plc" => (Change::Kill(NodeRole::Plc), Change::Restart(NodeRole::Plc)),
            _ => return None,
        };
        let (number, after) = value.split_once('@')?;
        let with_number = |frame| Ok(Self { from, frame, first, then, after: time(after)? });
        Some(frame(number).and_then(with_number))
    }

    /// Returns the node that ends and is started again, if any.
    #[must_use]
    pub const fn restarted(&self) -> Option<NodeRole> {
        match self.then {
            Change::Restart(node) => Some(node),
            _ => None,
        }
    }
}
