#!/usr/bin/env bash
# pycomm3 as explicit client of our adapter: ListIdentity, also to all, attributes, the interface's state, an assembly whose life
# counter moves, Forward_Open and Forward_Close by hand, and a silent owner.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
at_robot ip route add default via 192.168.64.254 dev robot
start robot_node at_robot "$NODES/robot-node" run --setup B --interface robot
says robot_node 'adapter'
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc "$VENV/bin/python" scripts/interop/peers/pycomm3_tool.py "$ROBOT_ADDRESS"
ends peer 60
says peer 'discovered 12 times'
says peer 'attributes read'
says peer 'opened and closed'
says peer 'owned and closed'
says robot_node '192.168.64.1 \(serial number 0x0000CAFE\) opened the connection: a frame every 10 s; it ends 5120 s after'
recorded
