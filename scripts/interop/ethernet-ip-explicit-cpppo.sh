#!/usr/bin/env bash
# cpppo as explicit client of our adapter: ListServices, ListIdentity and ListInterfaces over TCP and UDP, attributes, a
# class 3 connection from Forward_Open to Forward_Close.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start robot_node at_robot "$NODES/robot-node" run --setup B --interface robot
says robot_node 'adapter'
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc "$VENV/bin/python" scripts/interop/peers/cpppo_tool.py "$ROBOT_ADDRESS"
ends peer 30
says peer 'listed over UDP'
says peer 'listed over TCP'
says peer 'attributes read'
says peer 'opened, asked and closed'
recorded
