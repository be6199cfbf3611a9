#!/usr/bin/env bash
# st-ethernet-ip as class 1 scanner of our adapter at 10 ms. It ends without Forward_Close, so the connection has to
# time out.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start robot_node at_robot "$NODES/robot-node" run --setup B --interface robot
says robot_node 'adapter'
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc env NODE_PATH="$NODE_MODULES" node scripts/interop/peers/st_ethernet_ip_plc.js "$ROBOT_ADDRESS" 10
ends peer 30

says peer '[0-9]+ motions, [0-9]+ lives, [0-9]+ echoes'
says robot_node 'command 2827: 13 motions' # 0x0B0B, the peer's number
says robot_node 'not connected'
recorded
