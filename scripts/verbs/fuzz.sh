# shellcheck shell=bash
# libFuzzer on the stable toolchain.

# What libFuzzer needs to see which code its input reached: counters at each edge, and what is compared with what.
FUZZ_FLAGS="--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares"

verb_fuzz() { #: let libFuzzer attack each target for SECONDS (60), or only the targets that are named behind them
    local seconds=${1:-60} host target program corpus found status=0 seeds longest
    host=$(rustc -vV | sed -n 's/^host: //p')
    found=${CARGO_TARGET_DIR:-target}/fuzz
    # For a target that is named, build scripts and procedural macros get none of it.
    RUSTFLAGS=$FUZZ_FLAGS cargo build --quiet --locked --package fuzz --bin fuzz --profile fuzz --target "$host" \
        --target-dir "$found"
    program=$found/$host/fuzz/fuzz
    for corpus in fuzz/corpus/*/; do
        target=$(basename "$corpus")
        case " ${*:2} " in "  " | *" $target "*) ;; *) continue ;; esac
        mkdir -p "$found/corpus/$target" "$found/crashes"
        seeds=() longest=8192
        # A longer seed would be cut: setups of several stations have more than 10 kB.
        case $target in setup | application) seeds=("cell/${target}s") longest=16384 ;; esac
        # New inputs go into the first folder.
        if ! FUZZ_TARGET=$target "$program" "$found/corpus/$target" "$corpus" "${seeds[@]}" -max_total_time="$seconds" -max_len="$longest" \
            -timeout=20 -rss_limit_mb=2048 -print_final_stats=1 -artifact_prefix="$found/crashes/$target-" \
            >"$found/$target.log" 2>&1; then
            tail -n 60 "$found/$target.log" >&2
            echo "$target: failed; FUZZ_TARGET=$target cargo run -p fuzz -- FILE repeats it" >&2
            status=1
        fi
        echo "$target: $(fuzz_figures "$found/$target.log")"
    done
    return "$status"
}

# fuzz_figures LOG: prints how many inputs ran and how many edges they reached.
fuzz_figures() {
    local executed edges
    executed=$(sed -n 's/^stat::number_of_executed_units: *//p' "$1")
    edges=$(sed -n 's/^#.* cov: \([0-9]*\) .*/\1/p' "$1" | tail -n 1)
    echo "${executed:-0} executions, ${edges:-0} edges"
}
