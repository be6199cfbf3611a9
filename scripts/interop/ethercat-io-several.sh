#!/usr/bin/env bash
# `plc-node io` drives two SubDevices of one EtherCAT cable, each by its position, beside a third one that it leaves as it is. They are
# emulated in one process: a coupler with modules, which nobody names: it detects them, a terminal with digital outputs and one with analog values.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

files=$PWD/scripts/interop/files
cat >"$OUT/coupler.toml" <<'SCRIPT'
[[inputs]]
place = "0x6020:01"
echo = { place = "0x7020:01" }
SCRIPT
cat >"$OUT/analog.toml" <<'SCRIPT'
[[inputs]]
place = "0x6000:11"
echo = { place = "0x7000:01" }
SCRIPT
start devices at_robot "$NODES/robot-node" emulate --interface robot \
    "$files/made-up-coupler.xml" --module 3=MU-2A --script "$OUT/coupler.toml" \
    "$files/made-up-terminal.xml" --device-name MU2004 \
    "$files/made-up-terminal.xml" --device-name MU1002 --script "$OUT/analog.toml"
says devices '3 EtherCAT devices wait for a controller'
at_plc "$NODES/plc-node" discover --interface plc >"$OUT/discover.log"
start io at_plc "$NODES/plc-node" io --interface plc --run --for 3s \
    --device "$files/made-up-coupler.xml" --at 1 --name coupler \
    --device "$files/made-up-terminal.xml" --at 3 --name analog --device-name MU1002 \
    --set coupler/Analog/Output=258 --set analog/Outputs/Output=-2 \
    --read coupler/0xF030:03 --read coupler/Filter
ends io 30
for name in MU3000 MU2004 MU1002; do
    grep -q "$name" "$OUT/discover.log" || fail "$name is not listed: $(cat "$OUT/discover.log")"
done
says io 'MU3000: modules detected: .*slot 3 MU-2A \(0x00000031\)'
for name in coupler analog; do says io "$name: up: data are exchanged"; done
says io 'input coupler/Analog/Input = 258$'
says io 'input analog/Inputs/Value = -2$'
says io 'coupler: read 0xF030:03 = 49$'
says io 'coupler: read Filter = 7$'
says devices 'device 1: outputs 0201$'
says devices 'device 3: outputs feff$'
if grep -q 'device 2: outputs [^w]' "$OUT/devices.log"; then fail "the device between them got process data"; fi
# That every frame came back, and its process data counted, the gate finds in the capture.
for name in coupler analog; do says io "$name: ended: [0-9]{2,} received"; done
recorded
