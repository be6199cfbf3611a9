#!/usr/bin/env bash
# The tasks of a contributor and of CI, a verb each. `scripts/dev.sh help` lists them.
set -euo pipefail
cd "$(dirname "$0")/.."

# The long verbs are files of their own.
for file in scripts/verbs/*.sh; do
    # shellcheck source=/dev/null
    . "$file"
done

# The crates that contain only machines: package, and folder.
PURE=(fieldbus-machine:protocol/machine profinet-proto:protocol/profinet ethernet-ip-proto:protocol/ethernet-ip
    ethercat-subdevice:protocol/ethercat ethercat-drive:protocol/ethercat-drive fieldbus-virtual-time:protocol/virtual-time protocol:protocol)

verb_help() { #: list the verbs
    echo "usage: scripts/dev.sh VERB"
    sed -n 's/^verb_\([a-z_]*\)() { #: \(.*\)/  \1\t\2/p' scripts/dev.sh scripts/verbs/*.sh | tr _ - | sort | expand -t 16
}

verb_setup() { #: install what a new Debian machine lacks (as root)
    local missing=()
    command -v tshark >/dev/null && command -v editcap >/dev/null || missing+=(tshark)
    command -v ip >/dev/null || missing+=(iproute2)
    command -v setpriv >/dev/null || missing+=(util-linux)
    command -v shellcheck >/dev/null || missing+=(shellcheck)
    command -v python3 >/dev/null || missing+=(python3)
    command -v valgrind >/dev/null || missing+=(valgrind)
    command -v npm >/dev/null || missing+=(nodejs npm)
    browser >/dev/null || missing+=(chromium)
    command -v dockerd >/dev/null || missing+=(docker.io iptables)
    command -v docker-compose >/dev/null || missing+=(docker-compose)
    command -v setcap >/dev/null || missing+=(libcap2-bin)
    command -v cc >/dev/null || missing+=(gcc libc6-dev)
    command -v debootstrap >/dev/null || missing+=(debootstrap)
    command -v sbatch >/dev/null || missing+=(slurm-wlm munge)
    # Debian has the parts of Python that make an environment in a package of its own.
    python3 -c 'import ensurepip, venv' 2>/dev/null || missing+=(python3-venv)
    if [ ${#missing[@]} -gt 0 ]; then
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
    fi
    command -v cargo >/dev/null || { echo "cargo is missing: install Rust 1.95 or newer" >&2; exit 1; }
}

verb_format() { #: fail where the formatting differs
    cargo fmt --all --check
}

verb_spelling() { #: fail where a word is misspelt (typos)
    python_tool typos typos==1.52.0
    "$TOOLS/typos"
}

verb_words() { #: fail where a crate has more of the phrases and names to avoid than scripts/words.json allows
    python3 scripts/words.py "$@"
}

verb_unused() { #: fail where a crate depends on what it does not name
    python3 scripts/unused-dependencies.py
}

# python_tool NAME REQUIREMENT...: installs packages from the Python package index into $TOOLS, again if the requirements changed.
python_tool() {
    local environment="${CARGO_TARGET_DIR:-$PWD/target}/tools/$1"
    TOOLS="$environment/bin"
    [ "$(cat "$environment/requirements" 2>/dev/null)" = "${*:2}" ] && return
    rm -rf "$environment"
    python3 -m venv "$environment"
    "$TOOLS/pip" install --quiet "${@:2}"
    echo "${*:2}" >"$environment/requirements"
}

verb_lint() { #: clippy with warnings denied, the purity rules among them; shellcheck; documentation
    cargo clippy --workspace --all-targets --all-features --locked -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --all-features --no-deps --locked --quiet
    shellcheck --external-sources scripts/*.sh scripts/*/*.sh .ci/run
}

verb_modules() { #: fail where modules of one folder import each other in a circle
    python3 scripts/module-graph.py
}

verb_portable() { #: virtual mode without Linux: its tests, and whether its sources name what only Linux has; --skip NAME
    if cargo tree -p bench --no-default-features --target x86_64-pc-windows-msvc -e normal --prefix none --locked |
        grep -E '^(protocol-linux|rustix) '; then
        echo "the bench without real mode depends on what only Linux has" >&2
        exit 1
    fi
    cargo clippy --quiet -p bench --no-default-features --locked --message-format json-render-diagnostics -- -D warnings |
        python3 scripts/portable.py
    cargo test -p bench --no-default-features --locked --no-fail-fast -- "$@"
}

# build: builds every program with the options of the tests, so that after `test` nothing is left to build.
build() {
    cargo build --workspace --all-features --all-targets --locked
}

# built PROGRAM ARGUMENT...: runs one of them.
built() {
    "${CARGO_TARGET_DIR:-target}/debug/$1" "${@:2}"
}

verb_package() { #: package the crates under protocol/ that others can use, and build each package without this repository
    # Together, so that each finds the packages of the others where a registry would have them.
    local crates=(fieldbus-machine fieldbus-virtual-time fieldbus-capture-file protocol-linux profinet-proto ethernet-ip-proto ethercat-subdevice
        ethercat-maindevice ethercat-drive)
    local target=${CARGO_TARGET_DIR:-target}/packaged crate
    for crate in "${crates[@]}"; do
        # The driver has no page of its own.
        [ "$crate" = protocol-linux ] || cargo package --quiet --locked --allow-dirty --list -p "$crate" | grep -qx README.md ||
            { echo "the package $crate has no README.md" >&2; return 1; }
        # Cargo unpacks and compiles a version once; the packages of an earlier commit have the same one.
        rm -rf "${CARGO_HOME:-$HOME/.cargo}"/registry/src/-*/"$crate"-[0-9]*
    done
    cargo clean --quiet --locked --target-dir "$target" "${crates[@]/#/--package=}"
    CARGO_TARGET_DIR=$target cargo package --quiet --locked --allow-dirty "${crates[@]/#/--package=}"
    (cd "$target/package" && ls ./*.crate)
}

verb_docs() { #: every link of the documentation leads somewhere, every command shown in it runs (real mode: as root)
    build
    scripts/docs.sh
}

verb_test() { #: the workspace's tests
    grep -qxF '$ cargo test --workspace --all-features' README.md ||
        { echo "README.md names another command for the tests" >&2; return 1; }
    cargo test --workspace --all-features --locked --no-fail-fast
}

# browser: the path of a Chromium, by any of its names.
browser() {
    command -v chromium || command -v chromium-browser || command -v google-chrome
}

verb_mutants() { #: change one operator or value at a time; a change that no test of its crate notices survives (SHARD/SHARDS)
    local shard=() out="${CARGO_TARGET_DIR:-target}/mutants"
    command -v cargo-mutants >/dev/null || { echo "cargo install --locked cargo-mutants" >&2; return 1; }
    case ${1:-} in */*) shard=(--shard "$1") && shift ;; esac
    mkdir -p "$out"
    # What else is given goes to cargo-mutants, such as --re skill.rs.
    cargo mutants --output "$out" --no-times --baseline skip --timeout 120 "${shard[@]}" "$@"
}

verb_deny() { #: licences, doubled crates, sources and known faults of all dependencies (cargo-deny)
    command -v cargo-deny >/dev/null || { echo "cargo install --locked cargo-deny" >&2; return 1; }
    cargo deny --locked check licenses bans sources
    # The database of known faults is a repository of its own, which not every network reaches.
    if cargo deny fetch db >/dev/null 2>&1; then
        cargo deny --locked check --disable-fetch advisories
    else
        echo "the database of advisories cannot be reached: known faults of dependencies are not checked" >&2
        [ -z "${CI:-}" ]
    fi
}

# nightly COMPONENT...: fails with what is missing for a nightly toolchain with these components.
nightly() {
    local component
    for component in "$@"; do
        rustup component list --toolchain nightly --installed 2>/dev/null | grep -q "^$component" ||
            { echo "rustup toolchain install nightly --component $(tr ' ' ',' <<<"$*")" >&2; return 1; }
    done
}

verb_miri() { #: the tests of pure crates in Miri, which finds undefined behaviour, or only of the crates that are named
    nightly miri rust-src
    local crate crates=("$@")
    [ $# -gt 0 ] || crates=("${PURE[@]%%:*}")
    for crate in "${crates[@]}"; do
        echo "-- $crate"
        # Fewer cases of property tests: Miri is some hundred times slower. Snapshots and proptest read files.
        PROPTEST_CASES=4 PROPTEST_FAILURE_PERSISTENCE=off INSTA_WORKSPACE_ROOT=$PWD \
            MIRIFLAGS="${MIRIFLAGS:-} -Zmiri-disable-isolation" \
            cargo +nightly miri test --locked --package "$crate" --lib --target-dir "${CARGO_TARGET_DIR:-target}/miri"
    done
}

verb_sanitize() { #: protocol-linux, which has all unsafe code, under AddressSanitizer and ThreadSanitizer, or those that are named
    nightly rust-src
    local host sanitizer sanitizers=("$@")
    [ $# -gt 0 ] || sanitizers=(address thread)
    host=$(rustc -vV | sed -n 's/^host: //p')
    for sanitizer in "${sanitizers[@]}"; do
        echo "-- $sanitizer"
        # The standard library is built with it as well: ThreadSanitizer knows only what it has seen. Without the tests on
        # networks: their nodes lock their memory, and with it the terabytes that a sanitizer reserves.
        RUSTFLAGS="-Zsanitizer=$sanitizer" RUSTDOCFLAGS="-Zsanitizer=$sanitizer" \
            cargo +nightly test -Zbuild-std --locked --package protocol-linux --lib --target "$host" \
            --target-dir "${CARGO_TARGET_DIR:-target}/sanitize-$sanitizer"
    done
}

verb_browser() { #: open the pages in a headless Chromium: phone to desktop, light, dark and print; play the race
    CHROMIUM=$(browser) || { echo "there is no Chromium: scripts/dev.sh setup installs it" >&2; return 1; }
    export CHROMIUM
    cargo test --workspace --all-features --locked --test browser -- --ignored
}

verb_vendor() { #: make the libraries of the race page again from npm; fail where the committed ones differ
    scripts/vendor.sh --check
}

verb_gate() { #: fail where the virtual figures of a setup left their committed baseline, or CM lost ground in real time
    build
    local out status=0
    out=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$out'" EXIT
    for setup in A B C D E F G; do
        built bench gate --setup "$setup" >"$out/$setup.txt" || status=$?
        summarise "$out/$setup.txt"
    done
    for setup in E F G; do built bench --setup "$setup" --mode virtual --reps 1 --out "$out/$setup" --quiet && python3 scripts/relative_pose.py "$out/$setup" --check || status=$?; done
    python3 scripts/trajectory.py --circle "$out/circle.csv" && built bench trajectory "$out/circle.csv" --speed 500 --acceleration 5000 --queue 64 --refill accepted --export-csv "$out/cycles.csv" --export-json "$out/figures.json" && python3 scripts/trajectory.py "$out/circle.csv" "$out/cycles.csv" "$out/figures.json" --mean 480 --lowest 450 --deviation 0.02 || status=$?
    local coordinates
    for setup in A B C; do
        coordinates=$([ "$setup" = B ] && echo 6 || echo 3)
        mkdir "$out/points-$setup"
        python3 scripts/compact_points.py --write "$coordinates" "$setup" "$out/points-$setup" && built bench --setup "$out/points-$setup/setup.toml" --application "$out/points-$setup/points.toml" --mode virtual --types cm --reps 1 --capture always --out "$out/points-$setup/run" --quiet && python3 scripts/compact_points.py "$out/points-$setup/run/plc.pcapng" "$out/points-$setup/points.csv" --planted || status=$?
    done
    built bench --setup A --types rc,cm --reps 8 --out "$out/real" --quiet
    built bench gate --run "$out/real" >"$out/real.txt" || status=$?
    summarise "$out/real.txt"
    return "$status"
}

# summarise FILE: prints it, and adds it to the summary of a GitHub Actions job.
summarise() {
    cat "$1"
    if [ -n "${GITHUB_STEP_SUMMARY:-}" ]; then
        { echo '```text'; cat "$1"; echo '```'; } >>"$GITHUB_STEP_SUMMARY"
    fi
}

verb_instructions() { #: count the instructions of the hot paths; fail where one takes over 1 % more than committed (--update)
    # Cargo cuts a build that is not incremental into fewer pieces, which the compiler optimises further: up to 17 %.
    CARGO_INCREMENTAL=1 build
    built hot-path "$@"
}

verb_timing() { #: how evenly the frames of each bus come, beside a bare loop and the adapter of the crate `ciplink` (as root)
    local peers="${CARGO_TARGET_DIR:-$PWD/target}/interop/peers"
    build
    cargo build --manifest-path scripts/interop/peers/Cargo.toml --target-dir "$peers" --locked
    # All of them with the same priority: the programs are compared, not their priorities.
    built bench timing "$@" -- chrt --fifo 49 "$peers/debug/ciplink-robot"
}

verb_user() { #: a run and the tests on networks as an ordinary user, without any privilege; --skip NAME (as root)
    build
    local home
    home=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$home'" EXIT
    chown 65534:65534 "$home"
    HOME="$home" scripts/as-user.sh "${CARGO_TARGET_DIR:-$PWD/target}/debug/bench" --setup A --reps 1 --out "$home/run"
    # Cargo stays root, which has built everything; what it runs does not.
    NETWORKED_TESTS_REQUIRED=1 cargo --config "target.'cfg(unix)'.runner = '$PWD/scripts/as-user.sh'" \
        test --workspace --all-features --locked --no-fail-fast \
        --test wire --test discover --test impaired_cable --test attach --test full_disk --test mcap --test rig \
        -- "$@"
}

# ci_begin VERB [NOTE]: notes that a part of CI begins; ci_end: that it passed. The parts that run beside others do so in
# their own shell.
ci_begin() {
    CI_PART=$1 CI_NOTE=${2:-} CI_BEGAN=$SECONDS
    echo "== $CI_PART, after $SECONDS s${CI_NOTE:+, $CI_NOTE}"
}

ci_end() {
    printf '%-14s %6d s  %s\n' "$CI_PART" $((SECONDS - CI_BEGAN)) "$CI_NOTE" >>"$CI_SECONDS"
    CI_PART=
}

# ci_seconds: prints the seconds of each part, also of the one that failed.
ci_seconds() {
    if [ -n "${CI_PART:-}" ]; then
        CI_NOTE=failed
        ci_end
    fi
    echo "== seconds of each part"
    sed 's/ *$//' "$CI_SECONDS"
    printf '%-14s %6d s\n' all "$SECONDS"
}

verb_ci() { #: all of it but setup, timing and release; ends with the seconds of each part
    local verb beside
    mkdir -p "${CARGO_TARGET_DIR:-target}"
    CI_SECONDS=$(realpath "${CARGO_TARGET_DIR:-target}")/ci-seconds.txt
    : >"$CI_SECONDS"
    trap ci_seconds EXIT
    for verb in format spelling words unused lint modules purity portable package build; do
        ci_begin "$verb"
        case $verb in
            # What these compute does not depend on Linux, and `test` has them; the workflow `deep` has them here too.
            portable) (verb_portable --skip applications --skip calibrate --skip corrupted --skip drives --skip explore --skip stud) ;;
            build) (build) ;;
            *) ("verb_$verb") ;;
        esac
        ci_end
    done
    # These compile everything once more, beside what uses one core or waits for frames.
    (
        for verb in fresh demo; do
            ci_begin "$verb" "beside others"
            nice -n 10 "scripts/dev.sh" "$verb"
            ci_end
        done
    ) >"${CARGO_TARGET_DIR:-target}/beside.txt" 2>&1 &
    beside=$!
    # shellcheck disable=SC2064 # the process of now
    trap "pkill --parent $beside; kill $beside" ERR
    for verb in test docs grammars browser vendor gate optimum bits instructions studies wheel wire user examples interop; do
        ci_begin "$verb"
        case $verb in
            # What a test does to a process needs no privilege; the workflow `deep` has these tests too.
            user) (verb_user --skip stalled --skip hangs --skip killed --skip cost_of_recording) ;;
            *) ("verb_$verb") ;;
        esac
        ci_end
    done
    trap - ERR
    local status=0
    wait "$beside" || status=$?
    cat "${CARGO_TARGET_DIR:-target}/beside.txt"
    return "$status"
}

verb=${1:-help}
declare -F "verb_${verb//-/_}" >/dev/null || { verb_help >&2; exit 2; }
"verb_${verb//-/_}" "${@:2}"
