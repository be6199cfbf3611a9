#!/usr/bin/env bash
# The program in Python of docs/control-port.md, as the page has it, controls a PLC node: three sequences as CM with our robot node over
# EtherNet/IP, with seven short motions each.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

awk '/^```python$/ { on = 1; next } /^```$/ { on = 0 } on' docs/control-port.md >"$OUT/controller.py"
[ "$(grep -c . "$OUT/controller.py")" -ge 15 ] || fail "docs/control-port.md has no program in Python"
short=(--setup B --application "$PWD"/bench/studies/src/explore/short.toml)
start robot_node at_robot "$NODES/robot-node" run "${short[@]}" --interface robot
says robot_node 'adapter'
start plc_node at_plc "$NODES/plc-node" run "${short[@]}" --interface plc --control 127.0.0.1:7700
says plc_node 'controlled over 127.0.0.1:7700'
start controller at_plc python3 "$OUT/controller.py"
ends controller 30
[ "$(grep -cE '^[0-9]+(\.[0-9]+)? ms$' "$OUT/controller.log")" -eq 3 ] || fail "three execution times were expected"
says robot_node 'command 4: 7 motions'
recorded
