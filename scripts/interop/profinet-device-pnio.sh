#!/usr/bin/env bash
# Our IO-Controller drives the IO-Device of the crate `pnio`: identity and modules of its own, told by
# [bus.profinet.device], cyclic frames by EtherType 0x8892. The peer plays a robot that executes nothing; the runs only
# end where it sees our command image and we see its feedback.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

sed 's/^robot_station_name.*/robot_station_name = "pnio-robot"/' cell/setups/A.toml >"$OUT/setup.toml"
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
start plc_node at_plc "$NODES/plc-node" run --setup "$OUT/setup.toml" --interface plc --cyclic rt1 --types rc,cm
ends plc_node 30

# The peer's own figures have come to us ...
says plc_node 'rc .* by the robot.s clock   123\.456 ms; 7 motions'
says plc_node 'cm .* by the robot.s clock   123\.456 ms; [0-9]+ motions'
# ... and ours to the peer: the program to run, then every motion through the five slots, and a Release at the end.
says peer 'command [0-9]+: skill 17, 0 motions, program 1'
says peer 'command [0-9]+: skill 16, [0-9]+ motions'
says peer "targets .*300\.0, 300\.0"
says peer released
recorded
