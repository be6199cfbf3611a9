#!/usr/bin/env bash
# ethernetip2 as class 1 scanner of our adapter at 10 ms: Forward_Open, cyclic data both ways, Forward_Close.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start robot_node at_robot "$NODES/robot-node" run --setup B --interface robot
says robot_node 'adapter'
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc "$VENV/bin/python" scripts/interop/peers/ethernetip2_plc.py "$ROBOT_ADDRESS" 10
ends peer 30

says peer '[0-9]+ motions, [0-9]+ lives, [0-9]+ echoes'
says robot_node 'command 2827: 13 motions' # 0x0B0B, the peer's number
says peer closed
recorded
