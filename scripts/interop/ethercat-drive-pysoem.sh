#!/usr/bin/env bash
# pysoem (SOEM) as controller of our drives: startup by SDO, power on, a motion, a quick stop, lost process data, a reset.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start drives at_robot "$EXAMPLES/drives" robot
says drives 'wait for a controller'
start peer at_plc "$VENV/bin/python" scripts/interop/peers/pysoem_drives.py plc
ends peer 40
says peer 'moved 10000 increments'
says peer 'a fault of each drive, reset'
says peer 'done'
says drives 'drive 5: OperationEnabled, 0x0000'
kill "${drives:?}"
recorded
