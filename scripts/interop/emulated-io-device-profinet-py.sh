#!/usr/bin/env bash
# An IO-Device emulated from a GSDML, with profinet-py as IO-Controller: two modules of different sizes, data both ways, an
# alarm that the controller acknowledges.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

cat >"$OUT/script.toml" <<'SCRIPT'
[[inputs]]
place = "1.1"
type = "uint8"
value = 165
[[inputs]]
place = "2.1"
echo = { place = "2.1" }
[[faults]]
at = 6
seconds = 1
kind = "alarm"
slot = 2
code = 6
SCRIPT
at_plc ip address add "$PLC_ADDRESS/24" dev plc
start device at_robot "$NODES/robot-node" emulate "$PWD"/scripts/interop/files/GSDML-V2.35-made-up-io-20260101.xml \
    --module 1=M_8DI --module 2=M_2AO --interface robot --script "$OUT/script.toml"
says device 'waits for a controller'
start peer at_plc "$VENV/bin/python" scripts/interop/peers/emulated_io_device.py plc made-up-io "$ROBOT_ADDRESS"
ends peer 60
says peer 'connected to order MU-IO-77'
says peer 'data both ways'
says device 'fault Alarm ends'
says peer 'alarms 2'
says peer released
recorded
