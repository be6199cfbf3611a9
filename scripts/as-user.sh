#!/usr/bin/env bash
# Runs a program of this repository as an ordinary user without any privilege (as root). Usage: as-user.sh PROGRAM ...
#
# If the repository is in a folder that is closed to that user, the user gets a view of the file system in which the
# outermost such folder is open and contains nothing but the repository.
set -euo pipefail
repository=$(cd "$(dirname "$0")/.." && pwd)
user=(setpriv --reuid 65534 --regid 65534 --clear-groups --inh-caps=-all)

closed=
while read -r -d / folder; do
    path="${path:-}$folder/"
    if ! "${user[@]}" test -x "$path"; then
        closed=$path
        break
    fi
done <<<"$repository/"
if [ -z "$closed" ]; then exec "${user[@]}" "$@"; fi

# shellcheck disable=SC2016 # expanded by the inner shell
exec unshare --mount bash -euc '
    closed=$1 repository=$2 directory=$3
    shift 3
    mount --bind "$repository" /mnt
    mount -t tmpfs -o mode=755 tmpfs "$closed"
    mkdir -p "$repository"
    mount --bind /mnt "$repository"
    umount /mnt
    cd "$directory"
    exec "$@"
' - "$closed" "$repository" "$PWD" "${user[@]}" "$@"
