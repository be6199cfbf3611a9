#!/usr/bin/env python3
"""Judges how two arms of a cell worked together, from the traces of a run alone.

    python3 scripts/relative_pose.py RUN [--type rc|sm|cm] [--check]

Prints, one a line, of the first repetition of a type (CM where it is recorded):

    start_skew_us     true time between the first and the last arm's first motion
    mark_skew_us      longest true time between the scans in which the PLC saw the first and the last arm at a mark
    relative_pose_mm  largest distance of one arm's tool, seen from another's, from where the plan has it at the same progress: at the
                      marks, and from marks with `together` to the next one

--check compares all recorded types with RUN/results.json, and fails on a difference above the rounding of the tables.

It shares no code with the bench. Geometry is that of RUN/setup.toml, by chains of matrices; instants and progress are those of
RUN/trace-robot-STATION.csv and RUN/trace-plc-STATION.csv; from RUN/results.json it takes where each arm waits and where its tool
should be there. No arm leaves its path, so that where an arm is by plan at a progress, its own recording shows.
"""

import bisect
import csv
import itertools
import json
import math
import pathlib
import sys
import tomllib

# Joints have seven digits, progress is in whole microseconds, times are in nanoseconds. Between two cycles of 4 ms a straight line
# in the joints is 0.01 mm off the path at 5 m/s².
MOST_OFF = {"start_skew_us": 0.01, "mark_skew_us": 0.01, "relative_pose_mm": 0.02}
TYPES = ("cm", "sm", "rc")


# Frames are matrices of 4 x 4.

def times(*frames):
    product = frames[0]
    for frame in frames[1:]:
        product = [[sum(product[row][k] * frame[k][column] for k in range(4)) for column in range(4)] for row in range(4)]
    return product


def shift(x, y, z):
    return [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]


def turn(axis, degrees):
    sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    one, other = [index for index in range(3) if index != axis]
    if axis == 1:
        sine = -sine
    frame = shift(0, 0, 0)
    frame[one][one] = frame[other][other] = cosine
    frame[one][other], frame[other][one] = -sine, sine
    return frame


X, Y, Z = 0, 1, 2


def placed(x, y, z, a, b, c):
    """The frame of a position, and of angles about z, y' and x''."""
    return times(shift(x, y, z), turn(Z, a), turn(Y, b), turn(X, c))


def seen_from(frame, other):
    """Position of one frame's origin in another frame."""
    difference = [frame[axis][3] - other[axis][3] for axis in range(3)]
    return [sum(other[row][axis] * difference[row] for row in range(3)) for axis in range(3)]


# Kinematics: the flange from the joints.

def scara(arm, joints):
    one, two, lift, four = joints[:4]
    return times(turn(Z, one), shift(arm["link_1_mm"], 0, 0), turn(Z, two), shift(arm["link_2_mm"], 0, 0),
                 shift(0, 0, arm["height_mm"] + lift), turn(Z, four), turn(X, 180))


def opw(arm, joints):
    t = model(arm, joints)
    return times(turn(Z, t[0]), shift(arm["a1_mm"], arm["b_mm"], arm["c1_mm"]), turn(Y, t[1]), shift(0, 0, arm["c2_mm"]),
                 turn(Y, t[2]), shift(arm["a2_mm"], 0, arm["c3_mm"]), turn(Z, t[3]), turn(Y, t[4]), turn(Z, t[5]),
                 shift(0, 0, arm["c4_mm"]))


def three_parallel(arm, joints):
    """By the maker's Denavit-Hartenberg parameters: turn, lift, length, twist."""
    lengths = (0, arm["a2_mm"], arm["a3_mm"], 0, 0, 0)
    lifts = (arm["d1_mm"], 0, 0, arm["d4_mm"], arm["d5_mm"], arm["d6_mm"])
    twists = (90, 0, 0, 90, -90, 0)
    links = (times(turn(Z, value), shift(length, 0, lift), turn(X, twist))
             for value, lift, length, twist in zip(model(arm, joints), lifts, lengths, twists))
    return times(*links)


def model(arm, joints):
    return [sign * value - zero for value, sign, zero in zip(joints, arm["signs"], arm["offsets_deg"])]


KINDS = {"scara": scara, "opw": opw, "three-parallel": three_parallel}


def value(entry):
    return entry["value"] if isinstance(entry, dict) else entry


class Arm:
    """A station's arm in the cell, and what its traces show."""

    def __init__(self, run, station, saved, which):
        robot = station["robot"]
        self.name = station["name"]
        self.root = placed(*value(station["root_mm_deg"]))
        self.kinematics = {key: value(entry) for key, entry in robot["kinematics"].items()}
        self.waits = saved["waits"]
        self.rows = [row for row in rows(run / f"trace-robot-{self.name}.csv") if row["type"] == which]
        self.scans = [row for row in rows(run / f"trace-plc-{self.name}.csv") if row["type"] == which]
        if not self.rows or not self.scans:
            sys.exit(f"{run} has no recording of {which} at station {self.name}; record it: bench --mode virtual --types {which}")
        tools = {entry["number"]: value(entry["mm_deg"]) for entry in robot.get("tools", [])}
        number = saved.get("tool", 0)
        self.tool = placed(*tools.get(number, [0] * 6))
        self.count()

    def count(self):
        """Counts motions and progress over all commands of the repetition."""
        self.at, self.executed, self.progress, self.progress_columns, self.joints = [], [], [], [], []
        command, has_run = None, False
        before, last = (0, 0), (0, 0)
        for row in self.rows:
            has_run = has_run or row["state"] == "Running"
            if has_run and row["command"] != command:
                before = tuple(map(sum, zip(before, last)))
                command, last = row["command"], (0, 0)
            counted = (0, 0)
            if has_run:
                counted = (int(row["executed"]), int(row["progress"]))
                last = (int(row["accepted"]), int(row["progress"]))
            self.at.append(int(row["true_ns"]))
            self.executed.append(before[0] + counted[0])
            self.progress.append(before[1] + counted[1])
            self.progress_columns.append([self.progress[-1]])
            self.joints.append([float(row[f"joint_{axis}"]) for axis in range(1, 7)])

    def began(self):
        return next((at for at, row in zip(self.at, self.rows) if float(row["path_speed_mm_s"]) > 0), None)

    def came(self, nth):
        """The scan in which the PLC saw the arm at its n-th mark."""
        return next((int(scan["true_ns"]) for scan in self.scans if int(scan["marks_come"]) > nth), None)

    def reached(self, motions):
        """Index of the first cycle in which so many motions are executed."""
        return next(index for index, executed in enumerate(self.executed) if executed >= motions)

    def between(self, columns, keys, wanted):
        """Joints or progress between two cycles."""
        index = bisect.bisect_right(keys, wanted)
        low, high = max(index - 1, 0), min(index, len(keys) - 1)
        span = keys[high] - keys[low]
        share = (wanted - keys[low]) / span if span > 0 else 0.0
        share = min(max(share, 0.0), 1.0)
        return [one + (other - one) * share for one, other in zip(columns[low], columns[high])]

    def joints_at(self, at_ns):
        return self.between(self.joints, self.at, at_ns)

    def progress_at(self, at_ns):
        return self.between(self.progress_columns, self.at, at_ns)[0]

    def joints_by_plan(self, progress):
        return self.between(self.joints, self.progress, progress)

    def tool_of(self, joints):
        return times(self.root, KINDS[self.kinematics["kind"]](self.kinematics, joints), self.tool)


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        yield from csv.DictReader(file)


def start_skew_us(arms):
    began = [arm.began() for arm in arms]
    return None if None in began else (max(began) - min(began)) / 1e3


def mark_skew_us(arms):
    arrivals = {}
    for arm in arms:
        passed = {}
        for nth, wait in enumerate(arm.waits):
            key = (wait["mark"], passed.setdefault(wait["mark"], 0))
            passed[wait["mark"]] += 1
            if (at := arm.came(nth)) is not None:
                arrivals.setdefault(key, []).append(at)
    return max(((max(at) - min(at)) / 1e3 for at in arrivals.values()), default=None)


def relative_pose_mm(arms, together):
    return max(itertools.chain.from_iterable(distances(one, other, together) for one, other in itertools.combinations(arms, 2)),
               default=None)


def distances(one, other, together):
    """All distances of one tool, seen from the other, from where the plan has it."""
    for index, wait in enumerate(one.waits):
        nth = sum(before["mark"] == wait["mark"] for before in one.waits[:index])
        there = [number for number, there in enumerate(other.waits) if there["mark"] == wait["mark"]][nth:nth + 1]
        if not there:
            continue
        both = ((one, index), (other, there[0]))
        begins = [arm.reached(arm.waits[number]["after"]) for arm, number in both]
        from_ns = max(arm.at[begin] for (arm, _), begin in zip(both, begins))
        planned = [arm.waits[number].get("tool_mm_deg") for arm, number in both]
        if None not in planned:
            yield math.dist(seen_from(*(arm.tool_of(arm.joints_at(from_ns)) for arm, _ in both)),
                            seen_from(*(times(arm.root, placed(*tool)) for (arm, _), tool in zip(both, planned))))
        if wait["mark"] not in together:
            continue
        after = [arm.waits[number + 1]["after"] for arm, number in both]
        ends = [arm.reached(motions) for (arm, _), motions in zip(both, after)]
        to_ns = max(arm.at[end] for (arm, _), end in zip(both, ends))
        ways = [(arm.progress[begin], arm.progress[end]) for (arm, _), begin, end in zip(both, begins, ends)]
        first = 0 if ways[0][1] > ways[0][0] else 1
        instants = (at for arm in (one, other) for at in arm.at if from_ns <= at <= to_ns)
        for at in instants:
            begin, end = ways[first]
            share = min(max((both[first][0].progress_at(at) - begin) / (end - begin), 0.0), 1.0)
            found = seen_from(*(arm.tool_of(arm.joints_at(at)) for arm in (one, other)))
            by_plan = [arm.joints_by_plan(begin + share * (end - begin)) for arm, (begin, end) in zip((one, other), ways)]
            yield math.dist(found, seen_from(*(arm.tool_of(joints) for arm, joints in zip((one, other), by_plan))))


def judge(run, results, setup, which):
    saved = {station["name"]: station for station in results["stations"]}
    arms = [Arm(run, station, saved[station["name"]], which) for station in setup["station"]]
    together = {mark["number"] for mark in results["marks"] if mark["together"]}
    return {"start_skew_us": start_skew_us(arms), "mark_skew_us": mark_skew_us(arms),
            "relative_pose_mm": relative_pose_mm(arms, together)}


def saved_figures(result):
    skews = [mark["skew_us"][0] for mark in result["marks"] if mark["skew_us"]]
    return {"start_skew_us": result["start_skew_us"][0], "mark_skew_us": max(skews, default=None),
            "relative_pose_mm": result["relative_pose_mm"][0]}


def main(arguments):
    wanted = None
    if "--type" in arguments:
        at = arguments.index("--type")
        wanted = arguments[at + 1] if at + 1 < len(arguments) else ""
        del arguments[at:at + 2]
        if wanted not in TYPES:
            sys.exit(f"--type {wanted}: must be one of {', '.join(TYPES)}")
    is_check = "--check" in arguments
    arguments = [argument for argument in arguments if argument != "--check"]
    if len(arguments) != 1:
        sys.exit("usage: relative_pose.py RUN [--type rc|sm|cm] [--check]")
    run = pathlib.Path(arguments[0])
    try:
        results = json.loads((run / "results.json").read_text(encoding="utf-8"))
        setup = tomllib.loads((run / "setup.toml").read_text(encoding="utf-8"))
    except OSError as error:
        sys.exit(f"{run} is not a run of a cell: {error}")
    if "station" not in setup:
        sys.exit(f"{run} is a run of one station; name a run of a cell with several")
    recorded = [which for which in TYPES if results["results"].get(which, {}).get("samples_ms")]
    if not recorded:
        sys.exit(f"{run} has no repetition that succeeded; run it again")
    if not is_check:
        for name, figure in judge(run, results, setup, wanted or recorded[0]).items():
            print(f"{name} {'-' if figure is None else format(figure, '.3f')}")
        return 0
    wrong = 0
    for which in [wanted] if wanted else recorded:
        saved = saved_figures(results["results"][which])
        for name, figure in judge(run, results, setup, which).items():
            is_equal = figure == saved[name] or None not in (figure, saved[name]) and abs(figure - saved[name]) <= MOST_OFF[name]
            wrong += not is_equal
            print(f"{which} {name} {figure} results.json {saved[name]} {'ok' if is_equal else 'DIFFERS'}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
