#!/usr/bin/env bash
# The examples of the PROFINET stack against each other: a device without an address is found, gets one from the
# controller, and sends 1000 numbers back, by either transport.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start device at_robot "$EXAMPLES/device" robot echo
says device 'waits for a controller'
for transport in rt1 udp; do
    start controller at_plc "$EXAMPLES/controller" plc "$PLC_ADDRESS" echo "$ROBOT_ADDRESS" "$transport"
    ends controller 30
    says controller '1000 numbers came back'
done
says device "address $ROBOT_ADDRESS"
says device 'down: the peer ended the connection'
start identify at_plc "$EXAMPLES/identify" plc
ends identify
says identify '1 stations'
says identify "echo +echo +$ROBOT_ADDRESS"
kill "${device:?}"
recorded
