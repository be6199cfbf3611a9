#!/usr/bin/env bash
# Scapy's LLDP layer, which is strict about TLVs, as the neighbour of our IO-Device: it reads the device's announcements, and the
# device is found by the name of the port of this neighbour until the neighbour goes.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

at_plc ip address add "$PLC_ADDRESS/24" dev plc
at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start robot_node at_robot "$NODES/robot-node" run --interface robot
says robot_node 'IO-Device'
start peer at_plc "$VENV/bin/python" scripts/interop/peers/scapy_neighbour.py plc skillbench-robot "$ROBOT_ADDRESS"
ends peer 60
says peer 'the announcement is read in strict mode'
says peer "the station is found by its neighbour's port"
says peer 'the neighbour has gone'
pkill -INT -P "${robot_node:?}"
ends robot_node 10 130
recorded
