#!/usr/bin/env bash
# `plc-node io` drives the IO-Device of the crate `pnio` by a GSDML: found by its identity, with the modules of the options; the device
# refuses to list its modules, which is said.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

at_plc ip address add "$PLC_ADDRESS/24" dev plc
at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start peer at_robot "$PEERS/pnio-robot" robot pnio-robot "$ROBOT_ADDRESS"
says peer listening
start io at_plc "$NODES/plc-node" io --device "$PWD"/scripts/interop/files/GSDML-V2.35-pnio-device-20260101.xml --interface plc \
    --module 1=M_IN --module 3=M_OUT --run --set Control=1 --read 0.1:0xF000 --for 2s
ends io 30
says io 'up: data are exchanged'
# Bit 4 is ready, and bit 5 is the peer's answer to bit 0 of Control.
says io 'input 1.1/Status = 48$'
says io 'not read 0.1:0xF000: the device refuses it'
says io 'ended: [0-9]+ received'
says peer released
recorded
