# shellcheck shell=bash
# Short real and virtual runs through the gates.

verb_wire() { #: short real and virtual runs, the captures of both ends through tshark's gates
    build
    local out
    out=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$out'" EXIT
    for cyclic in udp rt1; do
        for mode in real virtual; do
            built bench --setup A --mode "$mode" --cyclic "$cyclic" --types cm --reps 1 \
                --capture always --out "$out/$mode-$cyclic"
            gate_run gate_profinet "$out/$mode-$cyclic"
        done
    done
    built bench --setup B --mode virtual --types cm --reps 1 --capture always --out "$out/virtual-B"
    gate_run gate_ethernet_ip "$out/virtual-B"
    for mode in real virtual; do
        built bench --setup C --mode "$mode" --types cm --reps 1 --capture always --out "$out/$mode-C"
        gate_run gate_ethercat "$out/$mode-C"
    done
    # Each port of the switch carries one bus.
    built bench --setup E --mode real --types cm --reps 1 --capture always --out "$out/real-E"
    gate_capture gate_profinet "$out/real-E/robot-left.pcapng"
    gate_capture gate_ethernet_ip "$out/real-E/robot-right.pcapng"
    gate_capture gate_profinet "$out/real-E/plc-left.pcapng"
    gate_capture gate_ethernet_ip "$out/real-E/plc-right.pcapng"
    built bench --setup F --mode real --types cm --reps 1 --capture always --out "$out/real-F"
    gate_capture gate_profinet "$out/real-F/plc-left.pcapng"
    gate_capture gate_ethercat "$out/real-F/plc-right.pcapng"
    gate_capture gate_ethercat "$out/real-F/robot-right.pcapng"
    local fault capture
    for capture in "$out"/real-[EF]/plc-*.pcapng; do
        gate_images "$capture"
    done
    built bench --setup A --mode real --types cm --reps 1 --capture always --out "$out/faults" \
        --fault loss=0.01 --fault duplicate=0.01 --fault reorder=0.01@3ms
    gate_run gate_profinet "$out/faults"
    for capture in "$out"/faults/*.pcapng; do
        for fault in "lost" "arrives twice" "held back by 3ms"; do
            tshark -n -r "$capture" -Y "frame.comment contains \"fault: $fault\"" 2>/dev/null | grep -c . >/dev/null ||
                { echo "$capture has no comment at a frame with the fault: $fault" >&2; return 1; }
        done
    done
}
