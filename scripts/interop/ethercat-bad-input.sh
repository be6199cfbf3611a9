#!/usr/bin/env bash
# The messages of our MainDevice on errors: another device than the setup wants, process data of another size, more devices,
# nobody there, and a cable without a link that gets one. The first two are captured.
# Programs are started without a shell function, so that a signal reaches the program and not a shell.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

# asks NAME KEY=VALUE...: a PLC that expects a device with these keys.
asks() {
    local name=$1
    shift
    {
        cat cell/setups/C.toml
        printf '%s\n' '' '[bus.ethercat.device]' 'vendor = 0xFFFFFFFF' "$@"
    } >"$OUT/$name.toml"
    start "$name" "$NODES/plc-node" run --setup "$OUT/$name.toml" --interface plc --types rc
}

# stops NAME: ends it in order; it may have the exit code of a run that could not start.
stops() {
    kill -TERM "${!1}"
    wait "${!1}" || true
}

robot='.skillbench-robot. \(vendor 0xFFFFFFFF, product 0x00000001, revision 0x00010000\)'
start robot_node nsenter --net --mount --target "${robot_namespace:?}" -- \
    "$NODES/robot-node" run --setup C --interface robot
says robot_node 'EtherCAT SubDevice'
asks identity 'product = 9' 'output_bytes = 256' 'input_bytes = 256'
says identity "other devices: expected 1: vendor 0xFFFFFFFF, product 0x00000009; found 1: $robot"
stops identity
asks size 'product = 1' 'output_bytes = 256' 'input_bytes = 64'
says size "device 1, $robot, has 256 bytes of outputs and 256 of inputs; expected 256 and 64"
stops size
recorded
stops robot_node

start alone "$NODES/plc-node" run --setup C --interface plc --types rc
says alone 'no EtherCAT frame comes back; is the cable plugged in, and is the device on'
start devices nsenter --net --mount --target "$robot_namespace" -- "$EXAMPLES/subdevice" robot
says alone 'other devices: expected 1: .*; found 2: .ECHO. .*, then .SIMPLE. '
kill "${devices:?}"
stops alone

at_robot ip link set robot down
start unplugged "$NODES/plc-node" run --setup C --interface plc --types rc
says unplugged 'no EtherCAT frame comes back; is the cable plugged in'
at_robot ip link set robot up
start robot_node nsenter --net --mount --target "$robot_namespace" -- \
    "$NODES/robot-node" run --setup C --interface robot
says unplugged '^connected'
ends unplugged 30
