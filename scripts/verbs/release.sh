# shellcheck shell=bash
# Static binaries, manual pages and completions in one package.

verb_release() { #: package static binaries, manual pages and completions, for TARGET or this machine; PROFILE=dev is quicker
    local host target profile="${PROFILE:-release}" version name out program
    host=$(rustc -vV | sed -n 's/^host: //p')
    target=${1:-$host}
    version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml)
    name="skillbench-$version-$target"
    out="${CARGO_TARGET_DIR:-$PWD/target}/packages"
    rm -rf "${out:?}/$name"
    mkdir -p "$out/$name/completions"
    # The C library is linked in as well, so the programs run on any Linux. The bench of this machine makes the pages.
    export RUSTFLAGS="-C target-feature=+crt-static"
    # The nodes say their commit where the build is told; the bench finds it by itself.
    export SKILLBENCH_COMMIT=${SKILLBENCH_COMMIT:-$(git rev-parse --short=12 HEAD)}
    export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
    cargo build --locked --profile "$profile" --target "$target" --target-dir "$out/build" --features bench/mcap \
        --package plc-node --package robot-node --package bench
    for program in plc-node robot-node bench; do
        "$(strip_for "$target")" --strip-debug -o "$out/$name/$program" "$out/build/$target"/*/"$program"
    done
    local bench="$out/$name/bench"
    if [ "$target" != "$host" ]; then
        cargo build --locked --package bench
        bench="${CARGO_TARGET_DIR:-target}/debug/bench"
    fi
    "$bench" man "$out/$name/man"
    for program in plc-node robot-node bench; do
        for shell in bash zsh fish; do
            "$bench" completions "$shell" --program "$program" >"$out/$name/completions/$program.$shell"
        done
    done
    cp README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$out/$name"
    tar --create --gzip --directory "$out" --file "$out/$name.tar.gz" "$name"
    ls -l "$out/$name.tar.gz"
}

# strip_for TARGET: prints the program that removes debug information from binaries for it.
strip_for() {
    case $1 in
        aarch64-*) command -v aarch64-linux-gnu-strip || command -v strip ;;
        *) command -v strip ;;
    esac
}
