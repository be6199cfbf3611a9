#!/usr/bin/env bash
# `bench doctor --peer robot` looks at the IO-Device of the crate `pnio`: its name, identity and modules, then its images. The
# peer gets no command.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

sed -e 's/^robot_station_name.*/robot_station_name = "pnio-robot"/' -e 's/^cyclic = .*/cyclic = "rt1"/' cell/setups/A.toml >"$OUT/setup.toml"
cat >>"$OUT/setup.toml" <<'END'

[bus.profinet.device]
vendor = 0x0A0B
device = 0x0C0D
modules = [
    { slot = 0, ident = 1, submodules = [
        { subslot = 1, ident = 1 },
        { subslot = 0x8000, ident = 0x8000 },
        { subslot = 0x8001, ident = 0x8001 },
    ] },
    { slot = 1, ident = 0x101, submodules = [{ subslot = 1, ident = 1, input_bytes = 256 }] },
    { slot = 3, ident = 0x103, submodules = [{ subslot = 1, ident = 1, output_bytes = 256 }] },
]
END

at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start peer at_robot "$PEERS/pnio-robot" robot pnio-robot "$ROBOT_ADDRESS"
says peer listening
# Our own robot is expected: the first look names the identity that is there.
sed 's/^robot_station_name.*/robot_station_name = "pnio-robot"/' cell/setups/A.toml >"$OUT/other.toml"
start other at_plc "$NODES/bench" doctor --setup "$OUT/other.toml" --interface plc --peer robot --wait 3
ends other 30 5
says other 'MISSING +identity +VendorID 0x0A0B, DeviceID 0x0C0D'
start doctor at_plc "$NODES/bench" doctor --setup "$OUT/setup.toml" --interface plc --peer robot
ends doctor 30
says doctor 'good +name +.pnio-robot.'
says doctor 'good +module'
says doctor 'good +life counter'
says doctor 'good +answer +the robot echoes life counter'
says doctor 'Every step of the robot was seen'
! grep -q 'command ' "$OUT/peer.log" || fail "the peer got a command"
recorded
