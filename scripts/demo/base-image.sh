#!/usr/bin/env bash
# Makes the base image of the Dockerfile from the packages installed on this Debian machine, for hosts that cannot
# pull one: the compiler, the linker, setcap, and the crates that Cargo has downloaded. Usage: base-image.sh TAG
set -euo pipefail

root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root"/{tmp,root,usr/{bin,sbin,lib,lib64},usr/local/{rust,cargo}}
chmod 1777 "$root/tmp"
for directory in bin sbin lib lib64; do ln -s "usr/$directory" "$root/$directory"; done

# Copies whole packages with all their dependencies. Their file lists use the names from before the merge of / and
# /usr, and contain directories and files that a container's Debian leaves out.
relations=(--no-recommends --no-suggests --no-conflicts --no-breaks --no-replaces --no-enhances)
packages() { apt-cache depends --recurse --installed "${relations[@]}" "$@" | grep '^[a-z0-9]' | sort -u; }
packages gcc libc6-dev dash coreutils sed libcap2-bin | xargs dpkg -L \
    | sed -E 's,^/(bin|sbin|lib|lib64)/,/usr/\1/,; s,^/,,' | grep -vE '^usr/share/(doc|man|locale|info)/' | sort -u \
    | (
        cd /
        while read -r file; do
            if [ -L "$file" ] || [ -f "$file" ]; then echo "$file"; fi
        done | grep -vE '^(bin|sbin|lib|lib64)$' | tar --create --files-from -
    ) | tar --extract --directory "$root"
ln -sf gcc "$root/usr/bin/cc"
ln -sf dash "$root/usr/bin/sh"

sysroot=$(rustc --print sysroot)
tar --create --directory "$sysroot" --exclude lib/rustlib/src bin lib | tar --extract --directory "$root/usr/local/rust"
cargo fetch --locked --quiet
tar --create --directory "${CARGO_HOME:-$HOME/.cargo}" registry/index registry/cache \
    | tar --extract --directory "$root/usr/local/cargo"

tar --create --directory "$root" . | docker import \
    --change 'ENV PATH=/usr/local/rust/bin:/usr/sbin:/usr/bin CARGO_HOME=/usr/local/cargo CARGO_NET_OFFLINE=true' \
    --message 'stands in for the image of this name' - "$1"
