#!/usr/bin/env bash
# The tasks of a contributor and of CI, a verb each. `scripts/dev.sh help` lists them.
set -euo pipefail
cd "$(dirname "$0")/.."

# PROFINET gate: no malformed or short frame, no error, no reserved bit set, and nothing but PROFINET on its ports.
PROFINET_TRAFFIC='pn_rt || dcerpc'
PROFINET_FAULTS='(eth.type==0x8892 || vlan.etype==0x8892 || pn_rt || pn_io || pn_dcp || dcerpc || lldp || udp.port in {34962 .. 34964}) && (_ws.malformed || _ws.short || _ws.expert.severity >= 0x00600000 || pn_rt.transfer_status != 0 || pn_rt.ds_res3 == 1 || pn_rt.ds_Reserved_2 == 1 || (udp.port == 34964 && !dcerpc && !icmp) || (udp.port in {34962 .. 34963} && !pn_rt && !icmp))'

# The crates that contain only machines: package, and folder.
PURE=(fieldbus-machine:protocol/machine profinet-proto:protocol/profinet ethernet-ip-proto:protocol/ethernet-ip
    ethercat-subdevice:protocol/ethercat ethercat-drive:protocol/ethercat-drive fieldbus-virtual-time:protocol/virtual-time protocol:protocol)

verb_help() { #: list the verbs
    echo "usage: scripts/dev.sh VERB"
    sed -n 's/^verb_\([a-z_]*\)() { #: \(.*\)/  \1\t\2/p' "scripts/dev.sh" | tr _ - | expand -t 14
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

verb_lint() { #: clippy with warnings denied, the purity rules among them; shellcheck; documentation
    cargo clippy --workspace --all-targets --all-features --locked -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --all-features --no-deps --locked --quiet
    shellcheck --external-sources scripts/*.sh scripts/*/*.sh .ci/run
}

verb_modules() { #: fail where modules of one folder import each other in a circle
    python3 scripts/module-graph.py
}

verb_portable() { #: virtual mode without Linux: its tests, and whether its sources name what only Linux has
    local target=${CARGO_TARGET_DIR:-target}/portable
    if cargo tree -p bench --no-default-features --target x86_64-pc-windows-msvc -e normal --prefix none --locked |
        grep -E '^(protocol-linux|rustix) '; then
        echo "the bench without real mode depends on what only Linux has" >&2
        exit 1
    fi
    cargo check --quiet -p bench --no-default-features --locked --target-dir "$target"
    python3 scripts/portable.py "$target"
    cargo test -p bench --no-default-features --locked --no-fail-fast
}

verb_purity() { #: prove that the crates of machines can name no clock, socket, thread or file
    # These crates and their dependencies are `no_std`: a crate built for a target without an operating system cannot
    # use one. If that target is not installed, the attribute and the dependencies' features are checked instead.
    local crate folder found dependency
    local allowed="libm rand_core rand_pcg thiserror thiserror-impl proc-macro2 quote syn unicode-ident"
    for crate in "${PURE[@]}"; do allowed+=" ${crate%%:*}"; done
    for crate in "${PURE[@]}"; do
        folder=${crate##*:} crate=${crate%%:*}
        grep -q '^#!\[cfg_attr(not(test), no_std)\]' "$folder/src/lib.rs" ||
            { echo "$folder is not no_std" >&2; exit 1; }
        if grep -rnE 'extern crate std|\bstd::' "$folder/src" --include='*.rs' | grep -vE '/tests?(/|\.rs)|//'; then
            echo "$folder names std" >&2
            exit 1
        fi
        found=$(cargo tree -p "$crate" -e normal --prefix none --no-dedupe --locked | awk '{print $1}' | sort -u)
        for dependency in $found; do
            case " $allowed " in
                *" $dependency "*) ;;
                *) echo "$folder depends on $dependency: is it no_std and free of clocks and sockets?" >&2; exit 1 ;;
            esac
        done
        if cargo tree -p "$crate" -e features,normal --locked | grep -E '(thiserror|rand_core|rand_pcg) feature "std"'; then
            echo "a dependency of $folder has its std feature on" >&2
            exit 1
        fi
    done
    if cargo tree -p protocol-linux -e normal --prefix none --locked | grep -E "^(profinet|ethernet-ip|protocol) "; then
        echo "protocol-linux names a bus: a machine says by ports() what it needs open" >&2
        exit 1
    fi
    if cargo tree --workspace -e features --locked -i ethercrab | grep 'ethercrab feature "std"'; then
        echo "ethercrab's feature std is on: it would wait by the system's clock instead of by a machine's" >&2
        exit 1
    fi
    # Steps of the host's clock change nothing: only what stamps captures and measured arrivals reads UTC.
    local utc_users
    utc_users=$(grep -rlE 'SystemTime|ClockId::Realtime|clock::utc|instant_of' --include='*.rs' \
        protocol/src protocol/*/src node/src plc-node/src robot-node/src cell |
        grep -vE '^protocol/linux/src/(clock|recorder|packet_socket|impaired/mod)\.rs$' || true)
    [ -z "$utc_users" ] || { echo "UTC is read in $utc_users" >&2; exit 1; }
    if grep -rlE 'packet_socket::receive' --include='*.rs' protocol/linux/src | grep -vE '/(packet_socket|arrivals|impaired/mod)\.rs$'; then
        echo "a node's frames are taken with their stamps in UTC" >&2
        exit 1
    fi
    local unsafe_users
    unsafe_users=$(grep -rlP '(?<!-)\bunsafe\b(?!-)' --include='*.rs' . | grep -vE '^\./(target|protocol/linux)/' || true)
    [ -z "$unsafe_users" ] || { echo "unsafe outside protocol-linux: $unsafe_users" >&2; exit 1; }
    echo "${PURE[*]##*:}: pure; unsafe stands in protocol-linux alone"
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

# What libFuzzer needs to see which code its input reached: counters at each edge, and what is compared with what.
FUZZ_FLAGS="--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares"

verb_fuzz() { #: let libFuzzer attack each target for SECONDS (60), or only the targets that are named behind them
    local seconds=${1:-60} host target program corpus found status=0 seeds
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
        seeds=()
        case $target in setup | application) seeds=("cell/${target}s") ;; esac
        # New inputs go into the first folder.
        if ! FUZZ_TARGET=$target "$program" "$found/corpus/$target" "$corpus" "${seeds[@]}" -max_total_time="$seconds" -max_len=8192 \
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

verb_browser() { #: open the pages in a headless Chromium: phone to desktop, light, dark and print; play the race
    CHROMIUM=$(browser) || { echo "there is no Chromium: scripts/dev.sh setup installs it" >&2; return 1; }
    export CHROMIUM
    cargo test --workspace --all-features --locked --test browser -- --ignored
}

verb_vendor() { #: make the libraries of the race page again from npm; fail where the committed ones differ
    scripts/vendor.sh --check
}

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
ETHERCAT_FAULTS='_ws.malformed || _ws.short || (_ws.expert.severity >= 0x00600000 && !eth.src_not_group) || ecat_mailbox.invalid || ecat_mailbox.coe.invalid || ecat_mailbox.foe.invalid || ecatf.type != 1 || ecatf.length + 16 > frame.len || ecat.cmd > 14 || ecat.sub1.cmd > 14 || ecat.sub2.cmd > 14 || ecat.sub3.cmd > 14 || (eth.src.lg == 1 && ecat.cmd in {10 .. 12} && ecat.cnt == 0)'
gate_ethercat() {
    local requests replies faults
    requests=$(tshark -n -r "$1" -Y 'ecatf && eth.src.lg == 0' 2>/dev/null | wc -l)
    replies=$(tshark -n -r "$1" -Y 'ecatf && eth.src.lg == 1' 2>/dev/null | wc -l)
    faults=$(tshark -n -r "$1" -Y "$ETHERCAT_FAULTS" 2>/dev/null | tee >(cat >&2) | wc -l)
    [ "$requests" -eq "$replies" ] || faults=$((faults + 1))
    echo "$1: $requests EtherCAT frames, $replies replies, $faults faults"
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

# gate_run GATE DIRECTORY: checks the captures of both ends of a run.
gate_run() {
    local capture
    for capture in "$2/plc.pcapng" "$2/robot.pcapng"; do
        "$1" "$capture"
        gate_sees_faults "$1" "$capture"
    done
}

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
    local fault capture
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

verb_gate() { #: fail where the virtual figures of a setup left their committed baseline, or CM lost ground in real time
    build
    local out status=0
    out=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$out'" EXIT
    for setup in A B C D; do
        built bench gate --setup "$setup" >"$out/$setup.txt" || status=$?
        summarise "$out/$setup.txt"
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
    local test name gate
    for test in "$interop"/*-*.sh; do
        name=$(basename "$test" .sh)
        case " ${*:-$name} " in *" $name "*) ;; *) continue ;; esac
        OUT="$target/interop/$name"
        echo "-- $name"
        timeout 90 bash "$test"
        case $name in
            playback-*) continue ;; # no bus
            profinet-*) gate=gate_profinet ;;
            ethercat-*) gate=gate_ethercat ;;
            *) gate=gate_ethernet_ip ;;
        esac
        "$gate" "$OUT/capture.pcapng"
        gate_sees_faults "$gate" "$OUT/capture.pcapng"
    done
}

# Switches that make glibc use its simplest variant of every function, as on a processor without AVX and FMA.
PLAIN_PROCESSOR="glibc.cpu.hwcaps=-AVX,-AVX2,-AVX512F,-AVX512VL,-AVX_Fast_Unaligned_Load,-FMA,-FMA4,-ERMS,-FSRM"

# virtual_runs DIRECTORY: runs every application on every setup there, with results, traces and captures; if one is
# refused, keeps the message. Their paths are relative, so that they are the same in each directory.
virtual_runs() {
    local program applications setups setup application name capture
    program=$(realpath "${CARGO_TARGET_DIR:-target}/debug/bench")
    applications=$PWD/cell/applications setups=$PWD/cell/setups
    mkdir -p "$1"
    cd "$1"
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

verb_fresh() { #: the README's commands on a new Debian with what the README says to install (as root)
    local root packages
    # shellcheck disable=SC2016 # the backticks are Markdown's
    packages=$(sed -n 's/.*`apt install \([a-z0-9. -]*\)`.*/\1/p' README.md)
    root=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$root'" EXIT
    debootstrap --variant=minbase --include="${packages// /,}" bookworm "$root" >"$root.log" ||
        { tail "$root.log" >&2; return 1; }
    rm "$root.log"
    # Rust as this machine has it, and the crates that it downloaded: rustup.rs is no package.
    mkdir -p "$root/rust" "$root/cargo" "$root/skillbench"
    tar --create --directory "$(rustc --print sysroot)" --exclude lib/rustlib/src --exclude share bin lib |
        tar --extract --directory "$root/rust"
    cargo fetch --locked --quiet
    tar --create --directory "${CARGO_HOME:-$HOME/.cargo}" registry/index registry/cache |
        tar --extract --directory "$root/cargo"
    git ls-files -z | tar --create --null --files-from - | tar --extract --directory "$root/skillbench"
    # shellcheck disable=SC2016 # likewise
    sed -n '/^```sh$/,/^```$/ { /^```/! p }' README.md >"$root/commands"
    echo "new Debian with $packages and:"
    cat "$root/commands"
    # What is mounted ends with the namespace.
    # shellcheck disable=SC2016 # expanded by the inner shell
    unshare --mount --pid --fork bash -euc '
        mount -t proc proc "$1/proc"
        exec chroot "$1" env -i HOME=/root PATH=/rust/bin:/usr/sbin:/usr/bin:/sbin:/bin CARGO_HOME=/cargo \
            CARGO_NET_OFFLINE=true bash -euc "cd /skillbench; . /commands"
    ' - "$root"
    du --summarize --human-readable "$root/skillbench/target"
}

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

# demo_compose ARGUMENT...: runs compose, either the engine's plugin or the separate program. The latter lets the
# docker client build images; Debian's client does so by BuildKit, without a plugin.
demo_compose() {
    if docker compose version >/dev/null 2>&1; then
        docker compose "$@"
    else
        PATH="/usr/bin:$PATH" DOCKER_BUILDKIT=1 COMPOSE_DOCKER_CLI_BUILD=1 docker-compose "$@"
    fi
}

# demo_engine: starts an engine of our own, so that nothing of ours stays in another one. It has a local image in
# place of the one that the Dockerfile would pull.
demo_engine() {
    DEMO_ENGINE=$(mktemp -d)
    export DOCKER_HOST="unix://$DEMO_ENGINE/socket"
    dockerd --data-root "$DEMO_ENGINE/data" --exec-root "$DEMO_ENGINE/exec" --pidfile "$DEMO_ENGINE/pid" \
        --host "$DOCKER_HOST" >"$DEMO_ENGINE/log" 2>&1 &
    local engine=$! tries=0
    until docker info >/dev/null 2>&1; do
        if ! kill -0 "$engine" 2>/dev/null || [ $((tries += 1)) -gt 150 ]; then
            echo "dockerd does not run here; it said:" >&2
            tail "$DEMO_ENGINE/log" >&2
            return 1
        fi
        sleep 0.2
    done
    scripts/demo/base-image.sh "$(sed -n 's/^FROM \(.*\) AS build$/\1/p' Dockerfile)"
}

# demo_end: removes everything that verb_demo started.
demo_end() {
    demo_compose down --volumes --rmi all --remove-orphans >/dev/null 2>&1 || true
    if [ -n "${DEMO_ENGINE:-}" ]; then
        local engine
        engine=$(cat "$DEMO_ENGINE/pid" 2>/dev/null || true)
        if [ -n "$engine" ] && kill "$engine" 2>/dev/null; then tail --pid "$engine" -f /dev/null; fi
        ip link delete docker0 2>/dev/null || true
        rm -rf "$DEMO_ENGINE"
    fi
    rm -rf "${RUNS:-}"
}

# demo_up FILE: runs the containers until the bench ends, with its exit code; also writes their output to the file.
demo_up() {
    demo_compose up --no-color --build --abort-on-container-exit --exit-code-from bench | tee "$1"
}

# demo_wrong_robot: starts a robot of another name at the robot's address, and expects that the PLC refuses it.
demo_wrong_robot() {
    local output
    mkdir -p "$RUNS/station"
    echo '{ "name": "old-robot" }' >"$RUNS/station/old-robot.json"
    output=$(demo_compose -f docker-compose.yml -f scripts/demo/wrong-robot.yml up --no-color \
        --abort-on-container-exit --exit-code-from bench 2>&1) && { echo "$output"; return 1; }
    demo_compose -f docker-compose.yml -f scripts/demo/wrong-robot.yml down
    grep -m 1 'another station has this IP address' <<<"$output" || { echo "$output"; return 1; }
}

verb_demo() { #: the containers of docs/permissions.md for real, Setups A, B and C, REPS=1 of each type (as root)
    export REPS="${REPS:-1}" PROFILE="${PROFILE:-dev}" COMPOSE_PROJECT_NAME=skillbench-ci IMAGES=skillbench-ci
    export SETUP RUNS BENCH_USER=65534:65534
    trap demo_end EXIT
    docker info >/dev/null 2>&1 || demo_engine
    RUNS=$(mktemp -d)
    chown "$BENCH_USER" "$RUNS"
    local output type
    for SETUP in A B C; do
        output="$RUNS/$SETUP.txt"
        demo_up "$output"
        for type in RC SM CM; do grep -qE "\| +$type +[0-9]+\.[0-9]" "$output"; done
        ls "$RUNS"/*"-$SETUP-real/results.json"
        # What a plain build lacks it refuses in words.
        output=$(demo_compose run --rm --no-deps bench --mode virtual --mcap 2>&1) && return 1
        grep -q -- '--features mcap' <<<"$output"
        demo_compose down
    done
    SETUP=A
    demo_wrong_robot
    docker images --format '{{.Repository}} {{.Size}}' | grep "^$IMAGES/"
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
    for verb in format lint modules purity portable package test docs browser vendor gate bits instructions; do
        ci_begin "$verb"
        ("verb_$verb")
        ci_end
    done
    # These compile everything once more, beside what waits for frames most of the time.
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
    for verb in wire user examples interop; do
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
