#!/usr/bin/env bash
# An adapter emulated from an EDS, with pycomm3 as its client: identity, sizes, configuration data, data both ways.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

cat >"$OUT/script.toml" <<'SCRIPT'
[[inputs]]
place = "101"
type = "uint8"
counter = { seconds = 0.01 }
[[inputs]]
place = "101"
byte = 4
echo = { place = "102" }
SCRIPT
at_plc ip address add "$PLC_ADDRESS/24" dev plc
at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start device at_robot "$NODES/robot-node" emulate "$PWD"/scripts/interop/files/made-up-adapter.eds --interface robot --script "$OUT/script.toml"
says device 'waits for a controller'
start peer at_plc "$VENV/bin/python" scripts/interop/peers/emulated_adapter.py "$ROBOT_ADDRESS"
ends peer 30
says peer 'identified made-up coupler'
says peer 'sizes 8 4 6'
says peer 'data both ways'
says device 'outputs 64000000'
says device 'takes the identity of another maker'
recorded
