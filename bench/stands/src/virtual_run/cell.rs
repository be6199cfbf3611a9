//! Both nodes on a virtual cable.

use plc_node::PlcNode;
use plc_node::bus::PlcBus;
use robot_node::RobotNode;
use robot_node::bus::RobotBus;
use virtual_time::Pair;

/// The PLC node, on side A, and the robot node, on side B, each on the bus that its setup names.
pub(super) type VirtualCell = Pair<PlcNode<PlcBus>, RobotNode<RobotBus>>;
