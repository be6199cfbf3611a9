# shellcheck shell=bash
# Virtual runs are the same bytes on every processor.

# Switches that make glibc use its simplest variant of every function, as on a processor without AVX and FMA.
PLAIN_PROCESSOR="glibc.cpu.hwcaps=-AVX,-AVX2,-AVX512F,-AVX512VL,-AVX_Fast_Unaligned_Load,-FMA,-FMA4,-ERMS,-FSRM"

# virtual_runs DIRECTORY: runs every application on every setup there, with results, traces and captures; if one is
# refused, keeps the message. Their paths are relative, so that they are the same in each directory.
virtual_runs() {
    local program applications setups setup application name capture
    program=$(realpath "${CARGO_TARGET_DIR:-target}/debug/bench")
    applications=$PWD/cell/applications setups=$PWD/cell/setups
    mkdir -p "$1"
    cd "$1" || return
    for setup in A B; do
        for application in "$applications"/*.toml; do
            name=$(basename "$application" .toml)
            # 84 minutes of the plant on Setup B: their frames are 10 GB.
            capture=always
            [ "$name" != palletising ] || capture=never
            sed "s/^application = .*/application = \"$name\"/" "$setups/$setup.toml" >"$setup-$name.toml"
            "$program" --setup "./$setup-$name.toml" --mode virtual --reps 1 --trace --capture "$capture" --quiet \
                --out "$setup-$name" >"$setup-$name.txt" 2>&1 || echo "exit code $?" >>"$setup-$name.txt"
        done
    done
    for setup in E F G; do
        "$program" --setup "$setup" --mode virtual --reps 1 --trace --capture always --quiet --out "$setup" >"$setup.txt" 2>&1 ||
            echo "exit code $?" >>"$setup.txt"
    done
}

verb_bits() { #: prove that virtual runs are the same bytes whatever glibc picks for the processor
    build
    local out program imported compared
    # What a node decides by comes from no other library at all; the bench draws with some of it.
    for program in plc-node robot-node; do
        imported=$(nm --dynamic --undefined-only "${CARGO_TARGET_DIR:-target}/debug/$program" |
            grep -wE 'a?(sin|cos|tan)h?f?|atan2f?|sincosf?|cbrtf?|hypotf?|(exp|log)(2|10|m1|1p)?f?|powf?|fmaf?' || true)
        [ -z "$imported" ] || { echo "$program takes from the C library: $imported" >&2; return 1; }
    done
    out=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$out'" EXIT
    (virtual_runs "$out/this") &
    (GLIBC_TUNABLES=$PLAIN_PROCESSOR virtual_runs "$out/plain") &
    wait -n && wait -n
    # host.json and the report contain the time of the run, the race its directory.
    diff --recursive --brief --exclude host.json --exclude report.html --exclude race.html "$out/this" "$out/plain"
    compared=$(find "$out/this" -name results.json | wc -l)
    [ "$compared" -ge 12 ] || { cat "$out/this/"*.txt; return 1; }
    echo "$compared virtual runs are the same bytes with and without AVX and FMA: results, samples, traces, captures"
}
