# shellcheck shell=bash
# The crates of machines can name no clock, socket, thread or file.

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
