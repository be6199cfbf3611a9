#!/usr/bin/env python3
"""Recomputes speed and deviation of a trajectory from the exported robot cycles; shares no code with the bench.

  scripts/trajectory.py --circle circle.csv
  bench trajectory circle.csv --export-csv cycles.csv --export-json figures.json
  scripts/trajectory.py circle.csv cycles.csv figures.json [--mean MM_S] [--lowest MM_S] [--deviation MM]

Fails where a figure of the JSON differs from what the places of the tool say, or misses a bound.
"""

import argparse
import csv
import json
import math
import sys

# Places are single-precision numbers: 0.02 micrometres at 200 mm. Speeds are those of chords of a cycle.
SPEED_TOLERANCE = 0.002
PLACE_TOLERANCE_MM = 0.002


def read_points(name):
    """Returns the points of a list of coordinates."""
    points = []
    with open(name, encoding="utf-8") as file:
        for row in csv.reader(line for line in file if line.strip() and not line.startswith("#")):
            if row[0].strip() != "x":
                points.append(tuple(float(cell) for cell in row[:3]))
    return points


def from_segment(point, one, other):
    """Returns the distance of a point from a segment."""
    along = [b - a for a, b in zip(one, other)]
    square = sum(x * x for x in along)
    share = 0.0
    if square > 0.0:
        share = max(0.0, min(1.0, sum(x * (p - a) for x, p, a in zip(along, point, one)) / square))
    return math.dist(point, [a + share * x for a, x in zip(one, along)])


def deviation(points, places, ways):
    """Returns the largest distance of a point from the driven path near the same share of the way."""
    whole = sum(math.dist(one, other) for one, other in zip(points, points[1:]))
    step = ways[-1] / max(1, len(ways) - 1)
    most, way, at = 0.0, 0.0, 0
    for index, point in enumerate(points):
        way += math.dist(points[index - 1], point) if index else 0.0
        wanted = way * ways[-1] / whole
        while at + 1 < len(ways) and ways[at] < wanted:
            at += 1
        near = 6 + int(2.0 / max(step, 0.05))
        some = range(max(0, at - near), min(len(places) - 1, at + near))
        most = max(most, min(from_segment(point, places[i], places[i + 1]) for i in some))
    return most


def write_circle(name):
    """Writes points a millimetre apart on nearly four turns of a circle of 60 mm."""
    with open(name, "w", encoding="utf-8") as file:
        file.write("x,y,z\n")
        for index in range(1501):
            angle = index / 60
            file.write(f"{150 + 60 * math.cos(angle):.5f},{60 * math.sin(angle):.5f},100\n")


def main():
    """Compares the figures and returns the exit code."""
    if len(sys.argv) == 3 and sys.argv[1] == "--circle":
        write_circle(sys.argv[2])
        return 0
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path")
    parser.add_argument("cycles")
    parser.add_argument("figures")
    parser.add_argument("--mean", type=float, help="least mean speed in mm/s")
    parser.add_argument("--lowest", type=float, help="least lowest speed in mm/s")
    parser.add_argument("--deviation", type=float, help="largest deviation in mm")
    asked = parser.parse_args()
    points = read_points(asked.path)
    with open(asked.cycles, encoding="utf-8") as file:
        cycles = list(csv.DictReader(file))
    with open(asked.figures, encoding="utf-8") as file:
        figures = json.load(file)
    places = [tuple(float(cycle[f"{axis}_mm"]) for axis in "xyz") for cycle in cycles]
    times = [float(cycle["t_ms"]) / 1e3 for cycle in cycles]
    ways = [0.0]
    for one, other in zip(places, places[1:]):
        ways.append(ways[-1] + math.dist(one, other))
    ramp = min(100.0, ways[-1] / 4)
    middle = [i for i, way in enumerate(ways) if ramp <= way <= ways[-1] - ramp]
    first, last = middle[0], middle[-1]
    mean = (ways[last] - ways[first]) / (times[last] - times[first])
    lowest = min((ways[i + 1] - ways[i]) / (times[i + 1] - times[i]) for i in range(first, last))
    found = {"mean_mm_s": mean, "lowest_mm_s": lowest, "deviation_mm": deviation(points, places, ways)}
    faults = []
    for name, value in found.items():
        tolerance = PLACE_TOLERANCE_MM if name == "deviation_mm" else SPEED_TOLERANCE * value
        print(f"{name:14} {value:10.4f}  by the bench {figures[name]:10.4f}")
        if abs(value - figures[name]) > tolerance:
            faults.append(f"{name}: {figures[name]} by the bench, {value} from the places")
    counts = [(int(cycle["executed"]), int(cycle["accepted"])) for cycle in cycles]
    if any(one[0] > other[0] or one[1] > other[1] for one, other in zip(counts, counts[1:])):
        faults.append("a count falls")
    if any(executed > accepted or accepted - executed > figures["queue_motions"] for executed, accepted in counts):
        faults.append("more motions accepted than the queue holds, or more executed than accepted")
    if asked.mean is not None and mean < asked.mean:
        faults.append(f"mean speed {mean:.1f} mm/s: must be at least {asked.mean}")
    if asked.lowest is not None and lowest < asked.lowest:
        faults.append(f"lowest speed {lowest:.1f} mm/s: must be at least {asked.lowest}")
    if asked.deviation is not None and found["deviation_mm"] > asked.deviation:
        faults.append(f"deviation {found['deviation_mm']:.4f} mm: must be at most {asked.deviation}")
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
