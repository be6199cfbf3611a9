#!/usr/bin/env bash
# `plc-node io` drives three adapters of one network: two of the crate `ciplink` and an emulated one of ours. Each gets outputs of its
# own and sends back what tells them apart; none loses a datagram.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh
# shellcheck source=scripts/interop/switch.sh
. scripts/interop/switch.sh

for number in 3 4; do add_station "$number"; done
for number in 2 3 4; do at "$number" ip address add "192.168.64.$number/24" dev robot; done
cat >"$OUT/script.toml" <<'SCRIPT'
[[inputs]]
place = "101"
echo = { place = "102" }
SCRIPT
start left at 2 "$PEERS/ciplink-robot"
start right at 4 "$PEERS/ciplink-robot"
start ours at 3 "$NODES/robot-node" emulate "$PWD"/scripts/interop/files/made-up-adapter.eds --interface robot --script "$OUT/script.toml"
says left listening
says right listening
says ours 'waits for a controller'
files=$PWD/scripts/interop/files
start io at_plc "$NODES/plc-node" io --interface switch --run --for 3s \
    --device "$files/ciplink-adapter.eds" --at 192.168.64.2 --name left \
    --device "$files/ciplink-adapter.eds" --at 192.168.64.4 --name right \
    --device "$files/made-up-adapter.eds" --at 192.168.64.3 --name ours \
    --set "left/Command=$(image 01003412)" --set "right/Command=$(image 01007856)" --set ours/Outputs=0a0b0c0d
ends io 30
for name in left right ours; do says io "$name: up: data are exchanged"; done
says io 'input left/Feedback = 30[0-9a-f]{42}3412'
says io 'input right/Feedback = 30[0-9a-f]{42}7856'
says io 'input ours/Inputs = 0a0b0c0d00000000'
says ours 'outputs 0a0b0c0d$'
for name in left right ours; do says io "$name: ended: [0-9]{2,} received, 0 lost"; done
for peer in left right; do says $peer closed; done
recorded
