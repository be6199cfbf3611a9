#!/usr/bin/env bash
# Our search finds the adapter of the crate `ciplink` by ListIdentity, and lists it once however often it answers.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

ip address add "$PLC_ADDRESS/24" dev plc
at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start peer at_robot "$PEERS/ciplink-robot"
says peer listening
start search at_plc "$NODES/plc-node" discover --interface plc --bus ethernet-ip
ends search
says search '^EtherNet/IP: 1 device$'
says search "^ *$ROBOT_ADDRESS +([0-9a-f]{2}:){5}[0-9a-f]{2} +ciplink robot +65535 "
recorded
