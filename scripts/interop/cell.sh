# shellcheck shell=bash
# A cell for one test of interop or of the examples, which sources this file: network namespaces of a PLC and a robot with a cable between
# them, a capture of the cable, and programs with logs.
#
# The test restarts itself in unnamed namespaces, including one for process numbers: all its programs, interfaces and
# namespaces end with the test, however it ends.
#
#   NODES  directory of plc-node and robot-node      PEERS  directory of the peers written in Rust
#   VENV   virtual environment of the Python peers   NODE_MODULES  packages of the Node.js peers
#   EXAMPLES  directory of the stacks' examples
#   OUT    directory for output and capture of this test
set -euo pipefail
: "${OUT:?}"

if [ -z "${CELL:-}" ]; then
    rm -rf "$OUT"
    mkdir -p "$OUT"
    CELL=1 exec unshare --net --pid --fork --kill-child --mount-proc "$BASH" "$0" "$@"
fi
# The kernel does not send the first process of a namespace signals that it has no handler for.
trap 'exit 130' INT TERM

# What a node keeps permanently ends with the test.
export XDG_STATE_HOME="$OUT/state"
export PLC_ADDRESS=192.168.64.1 ROBOT_ADDRESS=192.168.64.2

# Programs look for their interface in /sys, which shows the namespace of the process that mounted it.
mount -t sysfs sysfs /sys
unshare --net --mount sh -c 'mount -t sysfs sysfs /sys; echo there; exec sleep infinity' >"$OUT/robot-namespace.log" &
robot_namespace=$!
until grep -sq there "$OUT/robot-namespace.log"; do sleep 0.02; done

# at_plc COMMAND... and at_robot COMMAND...: run a command at that end of the cable.
at_plc() { "$@"; }
at_robot() { nsenter --net --mount --target "$robot_namespace" -- "$@"; }

ip link add name plc type veth peer name robot netns "$robot_namespace"
for interface in lo plc; do ip link set "$interface" up; done
for interface in lo robot; do at_robot ip link set "$interface" up; done

fail() { # fail WORDS...: ends the test and shows what its programs said last
    echo "FAILED: $*" >&2
    tail -n 12 "$OUT"/*.log >&2
    exit 1
}

# start NAME COMMAND...: runs it beside the test; its output goes to NAME.log, its process number to the variable
# NAME.
start() {
    local name=$1
    shift
    "$@" >"$OUT/$name.log" 2>&1 &
    printf -v "$name" %s $!
}

# says NAME PATTERN [SECONDS]: waits until the program has printed it.
says() {
    local tenths=$((${3:-10} * 10)) over=
    until grep -sqE -- "$2" "$OUT/$1.log"; do
        # The program's last output may have come after its log was read.
        [ -z "$over" ] || fail "$1 did not say /$2/"
        sleep 0.1
        [ $((tenths -= 1)) -gt 0 ] && kill -0 "${!1}" 2>/dev/null || over=1
    done
}

# ends NAME [SECONDS [CODE]]: waits until the program has ended with this exit code, 0 if none is given.
ends() {
    local tenths=$((${2:-10} * 10)) code=0
    while kill -0 "${!1}" 2>/dev/null; do
        [ $((tenths -= 1)) -gt 0 ] || fail "$1 did not end"
        sleep 0.1
    done
    wait "${!1}" || code=$?
    [ "$code" = "${3:-0}" ] || fail "$1 ended with exit code $code"
}

# From here on the capture contains everything on the cable.
start recorder dumpcap -q -i plc -w "$OUT/capture.pcapng"
says recorder '^File:'

# recorded: ends the capture.
recorded() {
    sleep 0.2 # the last frames are in dumpcap's ring still
    kill -INT "${recorder:?}"
    ends recorder
}
