#!/usr/bin/env bash
# One PLC, both buses at once, on each a stranger beside our robot: one IO-Controller with the IO-Device of the crate `pnio` and our
# device, one scanner with the adapter of the crate `ciplink` and ours. The strangers act as robots that execute nothing; each
# station has an application of its own. The capture is of the cable to `pnio`.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

# The stations of Setups A and B twice: each a stranger and ours.
python3 - "$OUT/setup.toml" <<'END'
import re
import sys

MODULES = """
[station.bus.profinet.device]
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
"""


def parts(setup):
    """The [plc] of a setup, and the rest as tables of a station."""
    text = open(f"cell/setups/{setup}.toml").read()
    tables = re.split(r"^(?=\[)", text, flags=re.M)[1:]
    plc = [table for table in tables if table.startswith("[plc]")]
    station = [table for table in tables if not table.startswith(("[plc]", "[paper"))]
    return "".join(plc), re.sub(r"^(\[+)", r"\1station.", "".join(station), flags=re.M)


def station(name, setup, address, x_mm):
    tables = parts(setup)[1]
    tables = re.sub(r'(robot_address = ")[^"]*', rf"\g<1>192.168.64.{address}", tables)
    tables = re.sub(r'(robot_station_name = ")[^"]*', rf"\g<1>{name}", tables)
    tables = re.sub(r'cyclic = "udp"', 'cyclic = "rt1"', tables)
    root = f'root_mm_deg = {{ value = [{x_mm}.0, 0.0, 0.0, 0.0, 0.0, 0.0], from = "assumed" }}'
    head = f'\n[[station]]\nname = "{name}"\napplication = "pick-and-place"\n{root}\n\n'
    return head + tables + (MODULES if name == "pnio-robot" else "")


stations = [("pnio-robot", "A", 2), ("ours-profinet", "A", 3), ("ciplink-robot", "B", 4), ("ours-ethernet-ip", "B", 5)]
with open(sys.argv[1], "w") as out:
    out.write('schema = 2\nname = "strangers"\ntitle = "a stranger beside our robot on each of two buses"\n\n')
    out.write(parts("A")[0])
    for index, (name, setup, address) in enumerate(stations):
        out.write(station(name, setup, address, 3000 * index))
END

# The first robot's cable, and one more for each other, on a bridge: the PLC is at the bridge.
# shellcheck source=scripts/interop/switch.sh
. scripts/interop/switch.sh
for number in 3 4 5; do add_station "$number"; done
for number in 2 4; do at "$number" ip address add "192.168.64.$number/24" dev robot; done

start pnio at 2 "$PEERS/pnio-robot" robot pnio-robot 192.168.64.2
start ciplink at 4 "$PEERS/ciplink-robot"
start our_device at 3 "$NODES/robot-node" run --setup "$OUT/setup.toml" --station ours-profinet --interface robot
start our_adapter at 5 "$NODES/robot-node" run --setup "$OUT/setup.toml" --station ours-ethernet-ip --interface robot
says pnio listening
says ciplink listening
start plc_node at_plc "$NODES/plc-node" run --setup "$OUT/setup.toml" --interface profinet=switch,ethernet-ip=switch --types rc,cm
ends plc_node 60

# The strangers' own figures have come to us, and ours from our robots ...
for type in rc cm; do
    for stranger in pnio-robot ciplink-robot; do
        says plc_node "$stranger: $type .* by the robot.s clock   123\.456 ms; [0-9]+ motions"
    done
    for ours in ours-profinet ours-ethernet-ip; do
        says plc_node "$ours: $type .* by the robot.s clock +[0-9]{4}\.[0-9]+ ms; 13 motions, 0 blends"
    done
done
# ... and the PLC's commands to each stranger: the program to run, then every motion through the five slots.
for stranger in pnio ciplink; do
    says $stranger 'command [0-9]+: skill 17, 0 motions, program 1'
    says $stranger 'command [0-9]+: skill 16, [0-9]+ motions'
    says $stranger 'targets .*300\.0, 300\.0'
done
says pnio released
recorded
