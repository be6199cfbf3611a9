# shellcheck shell=bash
# More stations than two for a test that has sourced cell.sh: the PLC's end becomes a bridge with its address, `switch`, and each further
# station has a namespace of its own with an interface `robot`. The robot of cell.sh is station 2; the capture is of its cable.

ip link add name switch type bridge
ip address add "${PLC_ADDRESS:?}/24" dev switch
ip link set switch up
ip link set plc master switch
namespaces[2]=${robot_namespace:?}

add_station() { # add_station NUMBER: connects a station; its address 192.168.64.NUMBER is for the test to give
    unshare --net --mount sh -c 'mount -t sysfs sysfs /sys; echo there; exec sleep infinity' >"${OUT:?}/namespace-$1.log" &
    namespaces[$1]=$!
    until grep -sq there "$OUT/namespace-$1.log"; do sleep 0.02; done
    ip link add name "port$1" type veth peer name robot netns "${namespaces[$1]}"
    ip link set "port$1" master switch up
    at "$1" ip link set lo up
    at "$1" ip link set robot up
}

at() { # at NUMBER COMMAND...: runs a command at this station
    local number=$1
    shift
    nsenter --net --mount --target "${namespaces[$number]}" -- "$@"
}

# image CONTROL_AND_LIFE: prints a command image with these four bytes, which a peer sends back in bytes 22 and 23.
image() {
    printf '%s%0504d' "$1" 0
}
