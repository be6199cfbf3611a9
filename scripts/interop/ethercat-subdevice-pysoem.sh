#!/usr/bin/env bash
# pysoem (SOEM) as MainDevice of our SubDevices: found, SDOs of every kind, every object listed, a file, the EEPROM, OP, 500 numbers through
# two devices, errors acknowledged, overlapped process data, BOOT.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

start subdevice at_robot "$EXAMPLES/subdevice" robot
says subdevice 'wait for a MainDevice'
start peer at_plc "$VENV/bin/python" scripts/interop/peers/pysoem_main.py plc
ends peer 40
says peer '17 objects with 57 values listed without a complaint'
says peer '500 numbers came back'
says peer 'watchdogs expired and acknowledged'
says peer 'overlapped process data'
says peer 'a file in BOOT'
says peer 'done'
says subdevice 'device 1: OP, 0x0000'
kill "${subdevice:?}"
recorded
