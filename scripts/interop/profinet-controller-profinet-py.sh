#!/usr/bin/env bash
# profinet-py as IO-Controller drives our IO-Device: DCP Identify and Set, Connect in the old manner (RT class 1,
# FrameID 0xC001, neither device access point nor consumer status), cyclic data both ways at 16 ms, I&M0, Release.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start robot_node at_robot "$NODES/robot-node" run --interface robot
says robot_node 'IO-Device'
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc "$VENV/bin/python" scripts/interop/peers/profinet_py_plc.py plc skillbench-robot "$ROBOT_ADDRESS"
ends peer 45

says peer 'found skillbench-robot at 192\.168\.64\.2'
says peer '[0-9]+ motions, [0-9]+ lives, [0-9]+ echoes, [0-9]+ places'
says robot_node 'command 2827: 13 motions' # 0x0B0B, the peer's number
says peer released
says robot_node 'the controller released the connection'
recorded
