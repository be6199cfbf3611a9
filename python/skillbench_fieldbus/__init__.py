"""Devices and controllers of PROFINET, EtherNet/IP and EtherCAT in tests.

`Cable` is two network namespaces with a cable between them, `Interface` an interface of this machine. On an end of either,
`EmulatedDevice` is the device of a file, `DrivenDevice` the controller of one, `PlcNode` and `RobotNode` the two nodes of skillbench.
The plugin of pytest has the fixtures `fieldbus_cable` and `fieldbus_end`.
"""

from .cable import Cable, End, Interface
from .devices import DrivenDevice, EmulatedDevice
from .lines import Ended, Refused, Silence
from .nodes import Execution, PlcNode, RobotNode, control_schema
from .program import bench

__all__ = [
    "Cable",
    "DrivenDevice",
    "EmulatedDevice",
    "End",
    "Ended",
    "Execution",
    "Interface",
    "PlcNode",
    "Refused",
    "RobotNode",
    "Silence",
    "bench",
    "control_schema",
]
