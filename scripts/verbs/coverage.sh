# shellcheck shell=bash
# Lines that the tests reach.

verb_coverage() { #: which lines the tests reach, by crate, of all crates or those that are named (llvm-tools)
    local host tools out crate
    host=$(rustc -vV | sed -n 's/^host: //p')
    tools=$(rustc --print sysroot)/lib/rustlib/$host/bin
    [ -x "$tools/llvm-profdata" ] || { echo "rustup component add llvm-tools" >&2; return 1; }
    out=${CARGO_TARGET_DIR:-$PWD/target}/coverage
    rm -rf "$out/profiles"
    mkdir -p "$out/profiles"
    local packages=(--workspace)
    if [ $# -gt 0 ]; then
        packages=()
        for crate in "$@"; do packages+=(--package "$crate"); done
    fi
    local status=0
    RUSTFLAGS="-Cinstrument-coverage" LLVM_PROFILE_FILE="$out/profiles/%p-%m.profraw" \
        cargo test "${packages[@]}" --all-features --locked --no-fail-fast --lib --tests --target-dir "$out" || status=$?
    find "$out/profiles" -name '*.profraw' >"$out/profiles.txt"
    "$tools/llvm-profdata" merge --sparse --input-files "$out/profiles.txt" --output "$out/merged.profdata"
    local objects=() object
    while read -r object; do
        objects+=(--object "$object")
    done < <(find "$out/debug" -maxdepth 2 -type f -executable ! -name '*.so' ! -name '*.rlib')
    "$tools/llvm-cov" export --summary-only --instr-profile "$out/merged.profdata" \
        --ignore-filename-regex '(/registry/|/rustc/|/tests?/|tests\.rs|/target/)' "${objects[@]}" 2>/dev/null |
        python3 scripts/coverage.py "$PWD"
    # A test that failed reaches fewer lines.
    return "$status"
}
