#!/usr/bin/env bash
# pnio-dcp as engineering tool on our IO-Device: Identify, Get, Set of address and name, Signal.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start robot_node at_robot "$NODES/robot-node" run --interface robot
says robot_node 'IO-Device'
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc "$VENV/bin/python" scripts/interop/peers/pnio_dcp_tool.py "$PLC_ADDRESS" skillbench-robot "$ROBOT_ADDRESS"
ends peer 40
says peer 'address, name and signal are set'
# The address is not only said: the interface has it.
at_robot ip -brief address show dev robot | grep -q "$ROBOT_ADDRESS/24" || fail "the interface has not got the address"
recorded
