# shellcheck shell=bash
# The README's commands on a new Debian.

verb_fresh() { #: the README's commands on a new Debian with what the README says to install (as root)
    local root packages promised megabytes
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
    promised=$(sed -n 's/^You need Linux, \([0-9]*\) GB of disk space .*/\1/p' README.md)
    megabytes=$(du --summarize --block-size=1MB "$root/skillbench" | cut -f 1)
    echo "$megabytes MB of disk space"
    [ "$megabytes" -le $((promised * 1000)) ] ||
        { echo "README.md says that $promised GB of disk space are enough" >&2; return 1; }
}
