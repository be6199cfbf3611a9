"""A run's motion.mcap as Foxglove's reader of ROS 2 messages has it: every message decodes and says what the table says."""

import csv
import math
import struct
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

run = Path(sys.argv[1])

rows = {}
with (run / "trace-robot.csv").open() as table:
    for row in csv.DictReader(table):
        if float(row["t_ms"]) >= 0.0:
            numbers = {key: float(value) for key, value in row.items() if key not in ("type", "state", "positions")}
            rows.setdefault(row["type"], []).append(numbers)

messages = {}
with (run / "motion.mcap").open("rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for _, channel, message, decoded in reader.iter_decoded_messages():
        messages.setdefault(channel.topic, []).append((message.log_time, decoded))


def near(found, wanted, rounding, what):
    assert len(found) == len(wanted), f"{what}: {found} is not {wanted}"
    for one, other in zip(found, wanted):
        assert abs(one - other) <= rounding, f"{what}: {found} is not {wanted}"


decoded = 0
for of, ticks in rows.items():
    names = ("joint_states", "tool", "path_speed", "programmed_speed")
    topics = {name: messages[f"/{of}/{name}"] for name in names}
    for name, said in topics.items():
        assert len(said) == len(ticks), f"/{of}/{name} has {len(said)} messages of {len(ticks)} cycles"
        decoded += len(said)
    compared = zip(ticks, topics["joint_states"], topics["tool"], topics["path_speed"])
    for tick, (at, joints), (_, tool), (_, speed) in compared:
        what = f"{of} after {tick['t_ms']} ms"
        # The table is rounded: to a microsecond, a ten-thousandth of a degree or millimetre, a thousandth of a mm/s.
        near([at / 1e6], [tick["t_ms"]], 0.6e-3, what)
        near([joints.header.stamp.sec * 1e3 + joints.header.stamp.nanosec / 1e6], [tick["t_ms"]], 0.6e-3, what)
        axes = range(1, len(joints.name) + 1)
        assert joints.name == [f"joint_{axis}" for axis in axes], f"{what}: {joints.name}"
        # Radians, and metres of the one linear axis that an arm of four has.
        of_table = [1e3 if len(axes) == 4 and axis == 3 else math.degrees(1) for axis in axes]
        positions = [scale * position for scale, position in zip(of_table, joints.position)]
        near(positions, [tick[f"joint_{axis}"] for axis in axes], 1e-4, what)
        position = tool.pose.position
        position = [1e3 * part for part in (position.x, position.y, position.z)]
        near(position, [tick[f"{axis}_mm"] for axis in "xyz"], 1e-4, what)
        near([1e3 * speed.data], [tick["path_speed_mm_s"]], 1e-3, what)
    states = topics["joint_states"]
    for (before_at, before), (_, state), (behind_at, behind) in zip(states, states[1:], states[2:]):
        passed = zip(before.position, behind.position)
        speeds = [(end - start) / (behind_at - before_at) * 1e9 for start, end in passed]
        near(state.velocity, speeds, 1e-6, f"speeds of {of} between {before_at} and {behind_at} ns")
    (_, path), = messages[f"/{of}/path"]
    assert len(path.poses) > 100, f"/{of}/path has {len(path.poses)} poses"
    (_, cloud), = messages[f"/{of}/path_points"]
    fields = [(field.name, field.offset, field.datatype, field.count) for field in cloud.fields]
    assert fields == [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("speed", 12, 7, 1)], fields
    assert (cloud.height, cloud.point_step, cloud.is_bigendian, cloud.is_dense) == (1, 16, False, True), cloud
    points = list(struct.iter_unpack("<4f", bytes(cloud.data)))
    assert len(points) == cloud.width == len(path.poses), f"/{of}/path_points has {len(points)} points"
    # The path begins where the arm does, and ends with the table.
    for (*point, speed), pose, tick in zip(points, path.poses, ticks[-len(points):]):
        position = pose.pose.position
        near(point, [position.x, position.y, position.z], 1e-6, f"/{of}/path_points")
        near([1e3 * speed], [tick["path_speed_mm_s"]], 1e-3, f"/{of}/path_points")

print(f"{decoded} messages of {len(rows)} runs decoded, each as the table has it")
