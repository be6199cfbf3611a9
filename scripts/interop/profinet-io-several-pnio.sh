#!/usr/bin/env bash
# `plc-node io` drives three IO-Devices of one network: two of the crate `pnio` and an emulated one of ours. Each gets outputs of its own
# and sends back what tells them apart. No frame is lost: what is missing was not on the cable, since a device skipped its cycle.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh
# shellcheck source=scripts/interop/switch.sh
. scripts/interop/switch.sh

for number in 3 4; do add_station "$number"; done
for number in 2 3 4; do at "$number" ip address add "192.168.64.$number/24" dev robot; done
cat >"$OUT/script.toml" <<'SCRIPT'
[[inputs]]
place = "2.1"
echo = { place = "2.1" }
SCRIPT
files=$PWD/scripts/interop/files
start left at 2 "$PEERS/pnio-robot" robot pnio-left 192.168.64.2
start right at 4 "$PEERS/pnio-robot" robot pnio-right 192.168.64.4
start ours at 3 "$NODES/robot-node" emulate "$files/GSDML-V2.35-made-up-io-20260101.xml" --module 2=M_2AO --interface robot \
    --station-name ours --script "$OUT/script.toml"
says left listening
says right listening
says ours 'waits for a controller'
pnio=$files/GSDML-V2.35-pnio-device-20260101.xml
start cables dumpcap -q -i switch -w "$OUT/cables.pcapng"
says cables '^File:'
start io at_plc "$NODES/plc-node" io --interface switch --run --for 4s \
    --device "$pnio" --at pnio-left --name left --module 1=M_IN --module 3=M_OUT \
    --device "$pnio" --at pnio-right --name right --module 1=M_IN --module 3=M_OUT \
    --device "$files/GSDML-V2.35-made-up-io-20260101.xml" --at ours --module 2=M_2AO \
    --set "left/3.1=$(image 00011234)" --set "right/3.1=$(image 00015678)" --set ours/2.1=0a0b0c0d
ends io 40
for name in left right ours; do says io "$name: up: data are exchanged"; done
says io 'input left/1.1 = 0030[0-9a-f]{40}1234'
says io 'input right/1.1 = 0030[0-9a-f]{40}5678'
says io 'input ours/2.1 = 0a0b$'
says ours 'outputs 0a0b0c0d$'
sleep 0.2 # the last frames are in dumpcap's ring still
kill -INT "${cables:?}"
ends cables

# skipped STATION: prints the cycles that the station did not send, by the cycle counters of its frames on the cable: 128 a cycle.
skipped() {
    local mac
    mac=$(at "$1" cat /sys/class/net/robot/address)
    tshark -n -r "$OUT/cables.pcapng" -Y "pn_rt && eth.src == $mac && pn_rt.frame_id in {0x8000 .. 0xfbff}" -T fields \
        -e pn_rt.cycle_counter 2>/dev/null |
        awk 'NR > 1 { step = ($1 - last + 65536) % 65536; if (step > 128) missing += step / 128 - 1 } { last = $1 } END { print missing + 0 }'
}
for station in left=2 ours=3 right=4; do
    says io "${station%=*}: ended: [0-9]{2,} received, [0-9]+ lost"
    lost=$(sed -nE "s/^${station%=*}: ended: .* received, ([0-9]+) lost.*/\1/p" "$OUT/io.log")
    skipped=$(skipped "${station#*=}")
    echo "${station%=*}: $lost lost, $skipped cycles skipped by the device"
    [ "$lost" -le "$skipped" ] || fail "${station%=*}: frames of the cable were lost"
done
for peer in left right; do says $peer released; done
recorded
