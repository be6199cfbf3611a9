#!/usr/bin/env bash
# SubDevices emulated from an ESI, with pysoem (SOEM) as MainDevice: a terminal with a mailbox, an object and an emergency, and
# one with four digital outputs at 0x0F00.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

cat >"$OUT/script.toml" <<'SCRIPT'
[[inputs]]
place = "0x6000:11"
type = "int16"
echo = { place = "0x7000:01" }
[[faults]]
at = 3
kind = "emergency"
code = 0x8130
SCRIPT
start device at_robot "$NODES/robot-node" emulate scripts/interop/files/made-up-terminal.xml --device-name MU1002 \
    --interface robot --script "$OUT/script.toml"
says device 'waits for a controller'
start peer at_plc "$VENV/bin/python" scripts/interop/peers/emulated_subdevice.py plc MU1002
ends peer 40
says peer 'identified MU1002 0xfffe 0x77 0x20001'
says peer 'object read and written'
says peer 'sizes 2 4'
says peer 'data both ways'
says device 'fault Emergency begins'
kill "${device:?}"
wait "$device" || true
start digital at_robot "$NODES/robot-node" emulate scripts/interop/files/made-up-terminal.xml --device-name MU2004 --interface robot
says digital 'waits for a controller'
start second at_plc "$VENV/bin/python" scripts/interop/peers/emulated_subdevice.py plc MU2004
ends second 40
says second 'data both ways'
says digital 'outputs 0f'
recorded
