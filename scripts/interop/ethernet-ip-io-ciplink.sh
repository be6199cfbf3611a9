#!/usr/bin/env bash
# `plc-node io` drives the adapter of the crate `ciplink` by an EDS: found by its identity, outputs by name, inputs that answer, an
# attribute read by its name.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

at_plc ip address add "$PLC_ADDRESS/24" dev plc
at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start peer at_robot "$PEERS/ciplink-robot"
says peer listening
start io at_plc "$NODES/plc-node" io --device "$PWD"/scripts/interop/files/ciplink-adapter.eds --interface plc --run \
    --set Control=1 --read 'Product code' --for 2s
ends io 30
says peer 'opened: .*input_size: 256.*output_size: 256'
says io 'up: data are exchanged'
# Bit 4 is ready, and bit 5 is the peer's answer to bit 0 of Control.
says io 'input Status = 48$'
says io 'read Product code = 1'
says io 'ended: [0-9]+ received'
says peer closed
recorded
