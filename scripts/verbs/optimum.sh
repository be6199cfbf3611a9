# shellcheck shell=bash
# How near random lines, circles and turns are to the time optimum, by a reference outside of Rust.

# Largest ratio through singular positions, and elsewhere.
AT_MOST="1.10 1.05"
SAMPLED=3

verb_optimum() { #: compare random lines, circles and turns of A, B and D with linear programs of scipy; a slower law must fail
    local out setup seed drawn=$RANDOM
    cargo build -p robot-node --example near_optimum --locked
    python_tool optimum numpy==2.4.6 scipy==1.17.1
    out=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$out'" EXIT
    for seed in 7 "$drawn"; do
        echo "seed $seed"
        for setup in A B D; do
            "${CARGO_TARGET_DIR:-target}/debug/examples/near_optimum" "$setup" "$SAMPLED" "$seed" "$out/$setup.json" >/dev/null
            # shellcheck disable=SC2086 # two numbers
            "$TOOLS/python" scripts/optimum.py "$out/$setup.json" $AT_MOST
        done
    done
    "${CARGO_TARGET_DIR:-target}/debug/examples/near_optimum" B 1 7 "$out/slower.json" 80 >/dev/null
    # shellcheck disable=SC2086 # two numbers
    if "$TOOLS/python" scripts/optimum.py "$out/slower.json" $AT_MOST >"$out/slower.txt"; then
        cat "$out/slower.txt"
        echo "a law with 80 % of the acceleration passes: the comparison finds nothing" >&2
        return 1
    fi
    echo "a law with 80 % of the acceleration fails, as it must: $(grep -o 'worst [0-9.]*' "$out/slower.txt" | sort | tail -1)"
}
