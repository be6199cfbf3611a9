#!/usr/bin/env bash
# Prints what a terminal gets from the live view of `plc-node io` at an emulated adapter, for the quote in docs/test-my-device.md. It runs
# in network namespaces of its own, as root or as a user who may make user namespaces. PROGRAMS is where the programs are.
set -euo pipefail
cd "$(dirname "$0")/../.."

if [ "${1:-}" != inside ]; then
    as_root=()
    [ "$(id -u)" -eq 0 ] || as_root=(--map-root-user)
    exec unshare "${as_root[@]}" --net "$0" inside
fi

file=scripts/interop/files/made-up-adapter.eds
unshare --net sleep 60 &
robot=$!
trap 'kill "$robot" 2>/dev/null || true' EXIT
# The namespace is there once the process in it differs from this one.
until [ "$(readlink "/proc/$robot/ns/net")" != "$(readlink /proc/self/ns/net)" ]; do :; done
ip link add plc type veth peer name robot netns "$robot"
at_robot() { nsenter --target "$robot" --net "$@"; }
ip address add 192.168.64.1/24 broadcast + dev plc
ip link set plc up
at_robot ip address add 192.168.64.2/24 broadcast + dev robot
at_robot ip link set robot up
# Not by the function: its shell would be what ends.
nsenter --target "$robot" --net "$PROGRAMS/robot-node" emulate "$file" --interface robot >/dev/null 2>&1 &
emulated=$!
trap 'kill "$emulated" "$robot" 2>/dev/null || true' EXIT

# A terminal of 120 columns whose user presses q once data are exchanged, or after 30 s.
python3 - "$PROGRAMS/plc-node" io --device "$file" --interface plc --at 192.168.64.2 <<'TERMINAL'
import fcntl, os, pty, select, struct, sys, termios, time

child, terminal = pty.fork()
if child == 0:
    os.execv(sys.argv[1], sys.argv[1:])
fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
shown, pressed, end = b"", False, time.monotonic() + 30
while True:
    if select.select([terminal], [], [], 1)[0]:
        try:
            news = os.read(terminal, 65536)
        except OSError:
            break
        if not news:
            break
        shown += news
    # The whole screen: its last line comes once more after data are exchanged.
    is_whole = b"keys: " in shown.partition(b"up: data are exchanged")[2]
    if not pressed and (is_whole or time.monotonic() > end):
        os.write(terminal, b"q")
        pressed = True
os.waitpid(child, 0)
sys.stdout.buffer.write(shown.replace(b"\r", b""))
TERMINAL
