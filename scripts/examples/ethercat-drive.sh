#!/usr/bin/env bash
# Six emulated drives and their controller: all are switched on, move for five seconds at 1 ms, and none stops.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start drives at_robot "$EXAMPLES/drives" robot
says drives 'wait for a controller'
start axes at_plc "$EXAMPLES/axes" plc 5
ends axes 30
# A host that stalls costs cycles.
says axes '[0-9]{4} cycles with all drives on, [0-9]{1,2} without the full working counter'
says drives 'drive 5: OperationEnabled, 0x0000'
kill "${drives:?}"
recorded
