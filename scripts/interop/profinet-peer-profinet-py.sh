#!/usr/bin/env bash
# `bench doctor --peer plc` looks at profinet-py as IO-Controller: who connects, what it asks for, its images, and its first
# command, which is held suspended.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start doctor at_robot "$NODES/bench" doctor --setup A --interface robot --peer plc --wait 20 --json
sleep 3 # the search comes first; what follows is the PLC's turn
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start peer at_plc "$VENV/bin/python" scripts/interop/peers/profinet_py_plc.py plc skillbench-robot "$ROBOT_ADDRESS"
ends doctor 40
says doctor '"found": ".* asks for .skillbench-robot."'
says doctor "\"found\": \"$PLC_ADDRESS \(.*sent a Connect over rt1: a frame every 16 ms"
says doctor '"found": "number 2827, RunProgram, program 1' # 0x0B0B, the peer's number
recorded
