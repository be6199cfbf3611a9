#!/usr/bin/env bash
# Our search finds the IO-Device of the crate `pnio` by DCP Identify, once however often it answers.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start peer at_robot "$PEERS/pnio-robot" robot foreign-robot "$ROBOT_ADDRESS"
says peer listening
start search at_plc "$NODES/plc-node" discover --interface plc --bus profinet
ends search
says search '^PROFINET: 1 station$'
says search "^ *foreign-robot +([0-9a-f]{2}:){5}[0-9a-f]{2} +$ROBOT_ADDRESS .*0x0A0B +0x0C0D +IO-Device"
recorded
