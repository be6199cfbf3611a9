#!/usr/bin/env bash
# A terminal without a mailbox emulated from an ESI, with its four digital outputs at 0x0F00; pysoem (SOEM) is MainDevice.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start digital at_robot "$NODES/robot-node" emulate "$PWD"/scripts/interop/files/made-up-terminal.xml --device-name MU2004 --interface robot
says digital 'waits for a controller'
start second at_plc "$VENV/bin/python" scripts/interop/peers/emulated_subdevice.py plc MU2004
ends second 40
says second 'data both ways'
says digital 'outputs 0f'
recorded
