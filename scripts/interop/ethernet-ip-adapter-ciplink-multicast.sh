#!/usr/bin/env bash
# Our scanner requests a multicast from the adapter of the crate `ciplink`: it joins the group in the reply, and
# receives every byte of the feedback on it.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

{
    cat cell/setups/B.toml
    printf '%s\n' '[bus.ethernet_ip]' 'multicast = true'
} >"$OUT/setup.toml"
at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start peer at_robot "$PEERS/ciplink-robot"
says peer listening
start plc_node at_plc "$NODES/plc-node" run --setup "$OUT/setup.toml" --interface plc --types rc
ends plc_node 30
says plc_node 'rc .* by the robot.s clock   123\.456 ms; 7 motions, 0 blends suppressed, 0 frames missing'
says peer closed
recorded
multicasts=$(tshark -n -r "$OUT/capture.pcapng" -Y 'ip.dst==239.0.0.0/8 && udp.port==2222' 2>/dev/null | wc -l)
[ "$multicasts" -gt 100 ] || fail "only $multicasts frames went to a group"
