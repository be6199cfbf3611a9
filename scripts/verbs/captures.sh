# shellcheck shell=bash
# Captures through tshark: the gate of each bus, and that it finds faults.

# PROFINET gate: no malformed or short frame, no error, no reserved bit set, and nothing but PROFINET on its ports.
PROFINET_TRAFFIC='pn_rt || dcerpc'
PROFINET_FAULTS='(eth.type==0x8892 || vlan.etype==0x8892 || pn_rt || pn_io || pn_dcp || dcerpc || lldp || udp.port in {34962 .. 34964}) && (_ws.malformed || _ws.short || _ws.expert.severity >= 0x00600000 || pn_rt.transfer_status != 0 || pn_rt.ds_res3 == 1 || pn_rt.ds_Reserved_2 == 1 || (udp.port == 34964 && !dcerpc && !icmp) || (udp.port in {34962 .. 34963} && !pn_rt && !icmp))'

# gate_profinet CAPTURE: prints the faults in a capture; fails if there are any, or if the capture is empty.
gate_profinet() {
    local frames faults
    frames=$(tshark -n -r "$1" -Y "$PROFINET_TRAFFIC" 2>/dev/null | wc -l)
    faults=$(tshark -n -r "$1" -2 -Y "$PROFINET_FAULTS" 2>/dev/null | tee >(cat >&2) | wc -l)
    echo "$1: $frames PROFINET frames, $faults faults"
    [ "$frames" -gt 0 ] && [ "$faults" -eq 0 ]
}

# EtherNet/IP gate: nothing else on its ports, no malformed or short frame, no error, and one sequenced address item
# and one connected data item in each I/O datagram.
ENIP_TRAFFIC='(tcp.port==44818||udp.port==44818||udp.port==2222)&&!icmp'
gate_ethernet_ip() {
    local dissect=(tshark -n -2 -r "$1" -d "udp.port==2222,cipio" -d "udp.port==44818,enip" -d "tcp.port==44818,enip")
    local frames faults
    frames=$("${dissect[@]}" -Y "($ENIP_TRAFFIC)&&(enip||cipio)" 2>/dev/null | wc -l)
    faults=$(
        for fault in \
            "$ENIP_TRAFFIC&&(_ws.malformed||_ws.short||_ws.expert.group==0x07000000||_ws.expert.severity==0x00800000)" \
            "(udp.port==44818||udp.port==2222)&&!icmp&&!enip&&!cipio" \
            "cipio&&!(enip.cpf.typeid==0x8002||enip.cpf.typeid==0x00a1)"; do
            "${dissect[@]}" -Y "$fault" 2>/dev/null
        done | tee >(cat >&2) | wc -l
    )
    echo "$1: $frames EtherNet/IP frames, $faults faults"
    [ "$frames" -gt 0 ] && [ "$faults" -eq 0 ]
}

# EtherCAT gate: no malformed or short frame, no error, no cut datagram, every request came back, and no process data
# passed all devices without being counted. SOEM sends from a group address, which is a warning of Ethernet's.
ETHERCAT_FAULTS='_ws.malformed || _ws.short || (_ws.expert.severity >= 0x00600000 && !eth.src_not_group) || ecat_mailbox.invalid || ecat_mailbox.coe.invalid || ecat_mailbox.foe.invalid || ecatf.type != 1 || ecatf.length + 16 > frame.len || ecat.cmd > 14 || ecat.sub1.cmd > 14 || ecat.sub2.cmd > 14 || ecat.sub3.cmd > 14'

# unprocessed_data CAPTURE: prints the replies in which no device processed a datagram of process data (LRD, LWR, LRW). Commands and
# working counters are compared datagram by datagram: a filter would take them from different ones.
unprocessed_data() {
    tshark -n -r "$1" -Y 'ecatf && eth.src.lg == 1' -T fields -e frame.number -e ecat.cmd -e ecat.cnt 2>/dev/null | awk -F '\t' '{
        count = split($2, commands, ","); split($3, counters, ",")
        for (at = 1; at <= count; at++)
            if (commands[at] ~ /^0x0[abc]$/ && counters[at] == 0) { print "frame " $1 ": process data without a working counter"; break }
    }'
}

gate_ethercat() {
    local requests replies early open faults
    # Devices set a bit of the source address. The MainDevice may look before the device's process listens, so that all frames but one
    # before the first reply get none; and the capture may end between a frame and its reply.
    read -r requests replies early open < <(tshark -n -r "$1" -Y ecatf -T fields -e eth.src.lg 2>/dev/null | awk '
        { is_reply = $1 ~ /^(1|True)$/ }
        is_reply { if (!replies++ && requests) early = requests - 1 }
        !is_reply { requests++ }
        END { print requests + 0, replies + 0, early + 0, replies && !is_reply ? 1 : 0 }')
    faults=$(tshark -n -r "$1" -Y "$ETHERCAT_FAULTS" 2>/dev/null | tee >(cat >&2) | wc -l)
    faults=$((faults + $(unprocessed_data "$1" | tee >(cat >&2) | wc -l)))
    [ "$requests" -eq $((replies + early + open)) ] || faults=$((faults + 1))
    echo "$1: $requests EtherCAT frames, $replies replies, $early before the first reply, $faults faults"
    [ "$requests" -gt 0 ] && [ "$faults" -eq 0 ]
}

# gate_sees_faults GATE CAPTURE: checks that a gate finds faults, in the same capture with the last eight bytes of
# each frame cut off. Randomly changed bytes would not be enough: in a capture of a dozen frames they may hit only
# addresses, and a frame that is not ours is no fault.
gate_sees_faults() {
    local broken verdict
    broken=$(mktemp --suffix .pcapng)
    editcap -C -8 -L "$2" "$broken"
    if verdict=$("$1" "$broken" 2>/dev/null) || [[ ! $verdict =~ ,\ [1-9][0-9]*\ faults$ ]]; then
        echo "$1 did not see the faults put into $2: $verdict" >&2
        rm "$broken"
        return 1
    fi
    rm "$broken"
}

# gate_capture GATE CAPTURE: checks a capture, and that the gate finds faults in it.
gate_capture() {
    "$1" "$2"
    gate_sees_faults "$1" "$2"
}

# gate_images CAPTURE: the dissector of the image finds both images, thousands of them, and each check is right.
gate_images() {
    local states commands feedbacks wrong
    states=$(tshark -n -X lua_script:protocol/devices/skillbench-image.lua -r "$1" -Y skillbench -T fields \
        -e skillbench.command.skill -e skillbench.feedback.state -e skillbench.check_state 2>/dev/null)
    # grep fails where it counts none.
    commands=$(cut -f 1 <<<"$states" | grep -c . || true)
    feedbacks=$(cut -f 2 <<<"$states" | grep -c . || true)
    wrong=$(cut -f 3 <<<"$states" | grep -c '[02]' || true)
    echo "$1: $commands commands, $feedbacks feedbacks, $wrong frames with a check that is not right"
    [ "$commands" -gt 1000 ] && [ "$feedbacks" -gt 1000 ] && [ "$wrong" -eq 0 ]
}

# gate_run GATE DIRECTORY: checks the captures of both ends of a run, and the images in them.
gate_run() {
    local capture
    for capture in "$2/plc.pcapng" "$2/robot.pcapng"; do
        gate_capture "$1" "$capture"
        gate_images "$capture"
    done
}
