#!/usr/bin/env bash
# The messages of our nodes on errors: a scanner that requests what the adapter does not have, a second scanner, and
# ports that another program uses.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

# Programs are started without a shell function, so that a signal reaches the program and not a shell.
# shellcheck disable=SC2034 # by name, in holds
plc_end=()
robot_end=(nsenter --net --mount --target "${robot_namespace:?}" --)

# asks NAME SED-ARGUMENTS...: a PLC that expects an adapter in which these keys have other values.
asks() {
    local name=$1
    shift
    {
        sed -e "s/^cycle_us = { value = 1000/cycle_us = { value = ${cycle_us:-1000}/" \
            -e "s/^watchdog_cycles = { value = [0-9]*/watchdog_cycles = { value = 128/" cell/setups/B.toml
        echo '[bus.ethernet_ip.adapter]'
        printf '%s\n' 'consumed_assembly = 150' 'consumed_bytes = 256' 'produced_assembly = 100' \
            'produced_bytes = 256' 'configuration_assembly = 151' \
            'key = { vendor = 65535, device_type = 43, product_code = 1, major_revision = 1, minor_revision = 1 }' |
            sed "$@"
    } >"$OUT/$name.toml"
    start "$name" "$NODES/plc-node" run --setup "$OUT/$name.toml" --interface plc --types rc
}

# stops NAME: ends it in order; it may have the exit code of a run that could not start.
stops() {
    kill -TERM "${!1}"
    wait "${!1}" || true
}

start robot_node "${robot_end[@]}" "$NODES/robot-node" run --setup B --interface robot
says robot_node adapter

asks assembly 's/150/99/'
says assembly 'no such O to T assembly .*0x01, .*0x012A.*; asked for O.T assembly 99 .*; by its EDS file the device has .*150 for O.T \(256 bytes\)'
stops assembly
asks size 's/consumed_bytes = 256/consumed_bytes = 100/'
says size 'O to T size is not .*0x0127.*; asked for 100 bytes of data O.T to assembly 150 .connection size 106.; the device has 256 bytes of data .connection size 262 '
stops size
asks key 's/major_revision = 1/major_revision = 3/'
says key 'electronic key does not fit .*0x25.*; asked for .* revision 3\.1; the device is .* revision 1\.1, serial number 0x'
stops key
cycle_us=400 asks interval ''
says interval 'intervals are not acceptable .*0x0112.*; asked for a packet every 400 .*; the device would take at least 500 .*; by its EDS file the device serves 500 to 10000000 '
stops interval

# The owner disappeared without closing, and the adapter keeps its connection for the requested time: 128 × 20 ms.
cycle_us=20000 asks owner ''
says owner '^connected'
kill -KILL "${owner:?}"
cycle_us=20000 asks second ''
says second 'another scanner owns the outputs .*0x0106.*; by its EDS file the device has outputs for 1 owner; stop the other scanner'
says second '^connected' # once the adapter gave the first one up
stops second
stops robot_node

# holds plc|robot ADDRESS udp|tcp PORT: lets another program use this port at this end of the cable.
holds() {
    local type=SOCK_DGRAM
    [ "$3" = udp ] || type=SOCK_STREAM
    local -n end="$1_end"
    holder="holder_$1_$3_$4"
    start "$holder" "${end[@]}" "$VENV/bin/python" -uc "
import socket, time
holder = socket.socket(socket.AF_INET, socket.$type)
holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, '$3' == 'tcp') # connections of before linger
holder.bind(('$2', $4))
if '$3' == 'tcp': holder.listen()
print('holds'); time.sleep(60)"
    says "$holder" holds
}

at_robot ip address replace "$ROBOT_ADDRESS/24" dev robot
at_plc ip address replace "$PLC_ADDRESS/24" dev plc
for port in 'tcp 44818' 'udp 44818' 'udp 2222'; do
    read -r transport number <<<"$port"
    name="robot_${transport}_$number"
    holds robot "$ROBOT_ADDRESS" "$transport" "$number"
    start "$name" "${robot_end[@]}" "$NODES/robot-node" run --setup B --interface robot
    says "$name" "${transport^^} port $number on .robot. is taken by another program at $ROBOT_ADDRESS:$number; .ss "
    kill "${!holder}"
done
holds plc 0.0.0.0 udp 2222
asks plc_udp ''
says plc_udp 'UDP port 2222 on .plc. is taken by another program at 0\.0\.0\.0:2222; '
kill "${!holder}"
recorded
