#!/usr/bin/env bash
# pnio-dcp as engineering tool on our IO-Device: Identify, Get, Set of address and name for now, Signal; then for good:
# both are there after a restart of the node, until a reset to factory.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

station="$OUT/station.json"
tool() { # tool PART: has the engineering tool do this
    start peer at_plc "$VENV/bin/python" scripts/interop/peers/pnio_dcp_tool.py \
        "$PLC_ADDRESS" skillbench-robot "$ROBOT_ADDRESS" "$1"
    ends peer 40
}
run_robot() { # run_robot NAME: starts the node under this name of its log
    start "$1" at_robot "$NODES/robot-node" run --interface robot --station-file "$station"
    says "$1" 'IO-Device'
}
stop_robot() { # stop_robot NAME: ends it, and takes away the address that it leaves on the interface
    pkill -INT -P "${!1}"
    ends "$1" 10 130
    at_robot ip address flush dev robot
}
has_gateway() { at_robot ip route show default dev robot | grep -q "via $PLC_ADDRESS"; }
has_address() { at_robot ip -brief address show dev robot | grep -q "$1"; }

at_plc ip address add "$PLC_ADDRESS/24" dev plc
run_robot robot_node
tool for-now
says peer 'address, name and signal are set'
# The address is not only said: the interface has it.
has_address "$ROBOT_ADDRESS/24" || fail "the interface has not got the address"
! has_gateway || fail "the interface has a gateway that nobody set"
[ ! -e "$station" ] || fail "what is set for now was stored"

tool permanent
says robot_node 'named stored-robot, address 192\.168\.64\.2, stored in'
has_gateway || fail "the gateway is confirmed, but the interface has no route to it"
stop_robot robot_node

run_robot robot_again
says robot_again 'named stored-robot, address 192\.168\.64\.2: stored in'
has_address "$ROBOT_ADDRESS/24" || fail "the stored address is not on the interface"
has_gateway || fail "the stored gateway is not on the interface"
tool stored
says peer 'name and address are those of before'
tool reset
says peer 'neither name nor address is left'
[ ! -e "$station" ] || fail "the reset left the station file"
! has_address "$ROBOT_ADDRESS" || fail "the reset left the address on the interface"
! has_gateway || fail "the reset left the gateway on the interface"
stop_robot robot_again
recorded
