#!/usr/bin/env bash
# The examples of the EtherNet/IP stack against each other: an adapter is found, and sends 1000 numbers back.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

ip address add "$PLC_ADDRESS/24" broadcast + dev plc
at_robot ip address add "$ROBOT_ADDRESS/24" broadcast + dev robot
start adapter at_robot "$EXAMPLES/adapter" robot
says adapter 'waits for a scanner'
start list_identity at_plc "$EXAMPLES/list_identity" plc
ends list_identity
says list_identity "$ROBOT_ADDRESS +echo"
start scanner at_plc "$EXAMPLES/scanner" plc "$ROBOT_ADDRESS"
ends scanner 30
says scanner '1000 numbers came back'
says adapter 'down: the peer ended the connection'
kill "${adapter:?}"
recorded
