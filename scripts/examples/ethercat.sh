#!/usr/bin/env bash
# The examples of EtherCAT against each other: ethercrab as MainDevice brings two SubDevices to OP and gets its numbers
# back.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start subdevice at_robot "$EXAMPLES/subdevice" robot
says subdevice 'wait for a MainDevice'
start main_device at_plc "$EXAMPLES/main_device" plc
ends main_device 30
says main_device 'ECHO, serial number 1'
says main_device 'OP after'
# A host that stalls costs cycles.
says main_device '1000 cycles, [0-9]{1,2} of them bad, (9[0-9]{2}|1000) numbers came back'
says subdevice 'device 1: OP, 0x0000'
kill "${subdevice:?}"
recorded
