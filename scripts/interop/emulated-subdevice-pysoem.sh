#!/usr/bin/env bash
# A terminal emulated from an ESI, with pysoem (SOEM) as MainDevice: identity, an object, data both ways, an emergency.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

cat >"$OUT/script.toml" <<'SCRIPT'
[[inputs]]
place = "0x6000:11"
type = "int16"
echo = { place = "0x7000:01" }
[[faults]]
at = 2
kind = "emergency"
code = 0x8130
SCRIPT
start device at_robot "$NODES/robot-node" emulate "$PWD"/scripts/interop/files/made-up-terminal.xml --device-name MU1002 \
    --interface robot --script "$OUT/script.toml"
says device 'waits for a controller'
start peer at_plc "$VENV/bin/python" scripts/interop/peers/emulated_subdevice.py plc MU1002
ends peer 40
says peer 'identified MU1002 0xfffe 0x77 0x20001'
says peer 'object read and written'
says peer 'sizes 2 4'
says peer 'data both ways'
says device 'fault Emergency begins'
says peer 'emergencies 0x8130'
recorded
