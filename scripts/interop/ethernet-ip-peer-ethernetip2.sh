#!/usr/bin/env bash
# `bench doctor --peer plc` looks at ethernetip2 as class 1 scanner: who connects, what it asks for, its images, and its first
# command, which is held suspended.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start doctor at_robot "$NODES/bench" doctor --setup B --interface robot --peer plc --wait 20 --json
sleep 3 # the search comes first; what follows is the PLC's turn
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc "$VENV/bin/python" scripts/interop/peers/ethernetip2_plc.py "$ROBOT_ADDRESS" 10
ends doctor 40
says doctor "\"found\": \"$PLC_ADDRESS sent a Forward_Open O→T assembly 150, connection size 262, every 10000 µs"
says doctor '"found": "number 2827, RunProgram, program 1' # 0x0B0B, the peer's number
recorded
