# shellcheck shell=bash
# Our stacks against each other as examples, and against those of others.

verb_examples() { #: the stacks' examples against each other, each in a process of its own; captures through the gates (as root)
    local target="${CARGO_TARGET_DIR:-$PWD/target}" stack gate
    export EXAMPLES="$target/debug/examples" OUT
    build
    for stack in profinet ethernet-ip ethercat ethercat-drive; do
        OUT="$target/interop/examples-$stack"
        echo "-- $stack"
        timeout 90 bash "scripts/examples/$stack.sh"
        case $stack in
            ethernet-ip) gate=gate_ethernet_ip ;;
            *) gate=gate_${stack%-drive} ;;
        esac
        "$gate" "$OUT/capture.pcapng"
    done
}

verb_interop() { #: our stacks against those of others, each in a process of its own; captures through the gates (as root)
    local target="${CARGO_TARGET_DIR:-$PWD/target}" interop=scripts/interop
    export NODES="$target/debug" PEERS="$target/interop/peers/debug" VENV="$target/interop/python"
    export NODE_MODULES="$target/interop/node_modules" EXAMPLES="$target/debug/examples" OUT
    build
    cargo build --manifest-path "$interop/peers/Cargo.toml" --target-dir "$target/interop/peers" --locked
    if ! cmp -s "$interop/peers/python.txt" "$VENV/python.txt"; then
        rm -rf "$VENV"
        python3 -m venv "$VENV"
        # ethernetip2 asks for Python 3.12 but runs on Debian 12's 3.11.
        "$VENV/bin/pip" install --quiet --ignore-requires-python --requirement "$interop/peers/python.txt"
        cp "$interop/peers/python.txt" "$VENV/python.txt"
    fi
    if ! cmp -s "$interop/peers/package-lock.json" "$target/interop/package-lock.json"; then
        cp "$interop/peers/"package{,-lock}.json "$target/interop"
        npm ci --prefix "$target/interop" --no-audit --no-fund --silent
    fi
    local test name index tests=() lane lanes=() status=0
    for test in "$interop"/*-*.sh; do
        name=$(basename "$test" .sh)
        case " ${*:-$name} " in *" $name "*) tests+=("$name") ;; esac
    done
    # Most of a test is waiting for frames, so two run at a time; each is in namespaces of its own.
    for lane in 0 1; do
        (for ((index = lane; index < ${#tests[@]}; index += 2)); do interop_test "${tests[index]}"; done) \
            >"$target/interop/lane-$lane.txt" 2>&1 &
        lanes+=($!)
    done
    for lane in 0 1; do
        wait "${lanes[lane]}" || status=$?
        cat "$target/interop/lane-$lane.txt"
    done
    return "$status"
}

# interop_test NAME: runs a test of `interop`, and the gate of its bus on the capture.
interop_test() {
    local gate
    OUT="$target/interop/$1"
    echo "-- $1"
    timeout 90 bash "$interop/$1.sh"
    case $1 in
        playback-*) return ;; # no bus
        profinet-* | emulated-io-device-*) gate=gate_profinet ;;
        ethercat-* | emulated-digital-* | emulated-subdevice-*) gate=gate_ethercat ;;
        *) gate=gate_ethernet_ip ;;
    esac
    "$gate" "$OUT/capture.pcapng"
    gate_sees_faults "$gate" "$OUT/capture.pcapng"
}
