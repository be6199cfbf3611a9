#!/usr/bin/env bash
# pycomm3 as explicit client of our adapter: ListIdentity, attributes, an assembly whose life counter moves, Forward_Open
# and Forward_Close by hand.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start robot_node at_robot "$NODES/robot-node" run --setup B --interface robot
says robot_node 'adapter'
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc "$VENV/bin/python" scripts/interop/peers/pycomm3_tool.py "$ROBOT_ADDRESS"
ends peer 30
says peer 'attributes read'
says peer 'opened and closed'
recorded
