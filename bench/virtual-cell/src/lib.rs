//! Both nodes on a virtual cable, from event to event: where a virtual run spends its time.
//!
//! This is a crate of its own because [`Pair`] is generic: the crate that names the machines of a pair also compiles what
//! drives them. In the dev profile this crate is optimised and the bench, most of which only reads, formats and writes
//! files, is not.

use machine::Instant;
use plc_node::bus::PlcBus;
use plc_node::{PlcEvent, PlcNode};
use robot_node::bus::RobotBus;
use robot_node::{RobotEvent, RobotNode};
use virtual_time::{Event, Pair};

/// The PLC node, on side A, and the robot node, on side B, each on the bus that its setup names.
pub type VirtualCell = Pair<PlcNode<PlcBus>, RobotNode<RobotBus>>;

/// Returns the next event of either node up to `until` in true time, as [`Pair::next_event`] does.
pub fn next_event(cell: &mut VirtualCell, until: Instant) -> Option<Event<PlcEvent, RobotEvent>> {
    cell.next_event(until)
}
