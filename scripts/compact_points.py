#!/usr/bin/env python3
"""Reads the compact points of a capture and compares them with the list that was to be sent; shares no code with the nodes.

  scripts/compact_points.py --write 3|6 SETUP DIR
  bench --setup DIR/setup.toml --application DIR/points.toml --mode virtual --types cm --reps 1 --capture always --out DIR/run
  scripts/compact_points.py DIR/run/plc.pcapng DIR/points.csv [--planted]

Written from docs/process-image.md alone. `--write` makes a setup file that sends compact points, from one of cell/setups, and an
application with one spline whose points differ in three or six coordinates. `--planted` then alters the images of the capture in
one way after the other, seals them again, and fails where such a fault is not found.
"""

import argparse
import csv
import math
import re
import struct
import sys

IMAGE = 256
SKILL, COMPACT, DONE = 18, 1 << 8, 1 << 1
RING = 76
CIRCLE = 75  # points: more than twice what a ring of 30 holds


def crc_table():
    """Returns the table of CRC-32C, bits reflected."""
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = (byte >> 1) ^ (0x82F63B78 if byte & 1 else 0)
        table.append(byte)
    return table


TABLE = crc_table()


def crc32c(data):
    """Returns the CRC-32C of bytes."""
    value = 0xFFFFFFFF
    for byte in data:
        value = (value >> 8) ^ TABLE[(value ^ byte) & 0xFF]
    return value ^ 0xFFFFFFFF


def check_of(image, at):
    """Returns the check of an image whose check stands at byte `at`: over the bytes after it, then those before."""
    return crc32c(image[at + 4 :] + image[:at]) or 0xFFFFFFFF


# First byte of the check, by direction.
CHECK = {"command": 32, "feedback": 116}
SEARCHED = 5_000  # frames of a length that are searched for images


def is_sealed(direction, order, image):
    """Returns whether the check of an image is right."""
    at = CHECK[direction]
    return struct.unpack_from(order + "I", image, at)[0] == check_of(image, at)


def may_be(direction, image):
    """Returns whether bytes may be an image: reserved ones are 0, an override is a percentage, and there is a check."""
    at = CHECK[direction]
    reserved = image[128:] + image[101:104] if direction == "feedback" else b""
    return any(image[at : at + 4]) and not any(reserved) and image[3 if direction == "feedback" else 7] <= 100


def read_frames(name):
    """Yields the frames of a pcapng file."""
    with open(name, "rb") as file:
        data = file.read()
    order, at = "<", 0
    while at + 12 <= len(data):
        if data[at : at + 4] == b"\x0a\x0d\x0d\x0a":
            order = "<" if data[at + 8 : at + 12] == b"\x4d\x3c\x2b\x1a" else ">"
        kind, length = struct.unpack_from(order + "II", data, at)
        if length < 12 or length % 4 or at + length > len(data):
            raise SystemExit(f"{name}: block at byte {at} has length {length}: the capture is cut or damaged")
        if kind == 6:
            (captured,) = struct.unpack_from(order + "I", data, at + 20)
            yield data[at + 28 : at + 28 + captured]
        at += length


def find_images(frame, known):
    """Returns the images in a frame, at most one of each direction, with their byte orders.

    `known` keeps for each length of a frame where images were found, and how many frames were searched. An image that is nearly
    empty fits in several places, so a place that does not fit the next frame is not the last one.
    """
    places, searched = known.setdefault(len(frame), ([], [0]))

    def at_places(directions):
        for direction, order, at in places:
            image = frame[at : at + IMAGE]
            if direction in directions and is_sealed(direction, order, image):
                directions.discard(direction)
                yield direction, order, image

    missing = set(CHECK)
    found = list(at_places(missing))
    has_room = len(frame) >= 14 + IMAGE * (len(found) + 1)
    if missing and has_room and searched[0] < SEARCHED:
        searched[0] += 1
        for at in range(14, len(frame) - IMAGE + 1):
            image = frame[at : at + IMAGE]
            for direction, order in ((direction, order) for direction in missing for order in "<>"):
                place = (direction, order, at)
                if place not in places and may_be(direction, image) and is_sealed(*place[:2], image):
                    places.append(place)
        found += at_places(missing)
    return found


def read_images(name):
    """Returns all images of a capture in their order."""
    known, images, frames = {}, [], 0
    for frame in read_frames(name):
        frames += 1
        images += find_images(frame, known)
    print(f"{frames} frames, {len(images)} images")
    return images


class Head:
    """Bytes 36..76 of a command."""

    def __init__(self, order, image):
        self.origin = struct.unpack_from(order + "6f", image, 36)
        fields = struct.unpack_from(order + "5HBBHBB", image, 60)
        self.velocity, self.acceleration, self.deceleration, self.jerk, self.zone = fields[:5]
        self.kind, frames, self.resolution, self.coordinates, self.content = fields[5:]
        self.tool, self.base = frames >> 4, frames & 15
        if self.coordinates not in (3, 6) or not 1 <= self.resolution <= 1000 or self.content != 0:
            raise Fault(f"head: resolution {self.resolution}, coordinates {self.coordinates}, content {self.content}")
        self.places = 90 // self.coordinates

    def difference(self, order, image, index):
        """Returns the differences of point `index` in steps."""
        at = RING + 2 * self.coordinates * (index % self.places)
        return struct.unpack_from(f"{order}{self.coordinates}h", image, at)

    def target(self, total):
        """Returns the coordinates of a point from the sums of the differences, in mm and degrees."""
        sums = tuple(total) + (0,) * (6 - len(total))
        return [start + steps * self.resolution / 100_000 for start, steps in zip(self.origin, sums)]


class Fault(Exception):
    """What is wrong with the images."""


def read_points(images):
    """Returns head and targets of the skill in these images, and checks how the PLC fills the ring."""
    number = head = None
    total, written, points, ring = [], 0, [], {}
    robot, count, is_done = 0, 0, False
    for direction, order, image in images:
        if direction == "feedback":
            status, _, _, echo = struct.unpack_from(order + "HBBH", image, 0)
            executed, accepted = struct.unpack_from(order + "II", image, 8)
            if number is not None and echo == number:
                services = struct.unpack_from(order + "H", image, 126)[0]
                # Without KEEPS_ACCEPTED only `executed` frees a place.
                count = max(count, accepted if services & 4 else executed)
                robot, is_done = executed, is_done or bool(status & DONE)
            continue
        control, _, this = struct.unpack_from(order + "3H", image, 0)
        if image[6] != SKILL or not control & COMPACT:
            continue
        wanted, now = struct.unpack_from(order + "II", image, 8)
        if number != this:
            if number is not None:
                raise Fault(f"command {this} after {number}: the capture must have one skill")
            number, head = this, Head(order, image)
            total = [0] * head.coordinates
            whole = wanted
        if wanted != whole or now > wanted or now < written:
            raise Fault(f"total {wanted} after {whole}, written {now} after {written}")
        if now > count + head.places:
            raise Fault(f"point {now - 1} is written when the robot has freed {count} places and the ring holds {head.places}")
        for index in range(written, now):
            ring[index % head.places] = head.difference(order, image, index)
            total = [sum(pair) for pair in zip(total, ring[index % head.places])]
            points.append(head.target(total))
        written = now
        for place, difference in ring.items():
            if head.difference(order, image, place) != difference:
                raise Fault(f"place {place} of the ring changed without a new point, at written {now}")
    if head is None:
        raise Fault("no image has skill 18 with COMPACT")
    if written != whole or robot != whole or not is_done:
        raise Fault(f"{written} of {whole} points written, {robot} executed, DONE {is_done}")
    return head, points


def compare(head, points, wanted):
    """Compares the targets with those of the list; returns the largest difference in steps."""
    if len(points) != len(wanted):
        raise Fault(f"{len(points)} points, the list has {len(wanted)}")
    if (head.kind, head.tool, head.base) != (5, 0, 1) or not head.velocity or not head.acceleration:
        raise Fault(f"head: kind {head.kind}, tool {head.tool}, base {head.base}, velocity {head.velocity}")
    differ = 6 if any(one[3:] != wanted[0][3:] for one in wanted) else 3
    if head.coordinates != differ:
        raise Fault(f"head: {head.coordinates} coordinates, the list differs in {differ}")
    step, worst = head.resolution / 100_000, 0.0
    for index, (point, target) in enumerate(zip(points, wanted)):
        for name, one, other in zip("xyzabc", point, target):
            off = abs(one - other) / step
            # The origin carries angles that do not differ, in single precision.
            least = 0.5 + 1e-6 if "xyzabc".index(name) < head.coordinates else 2e-5 / step
            if off > least:
                raise Fault(f"point {index}: {name} is {one:.6f}, the list has {other:.6f} ({off:.2f} steps)")
            worst = max(worst, off)
    return worst


def altered(images, direction, change):
    """Returns the images with those of a direction changed, and sealed again."""
    new = []
    for it, order, image in images:
        if it == direction:
            image = bytearray(image)
            if change(order, image):
                struct.pack_into(order + "I", image, CHECK[it], check_of(bytes(image), CHECK[it]))
            image = bytes(image)
        new.append((it, order, image))
    return new


def planted(images):
    """Yields faults of a sender by name, each with the images that it would send."""

    def command(change):
        def of_skill(order, image):
            if image[6] != SKILL:
                return False
            (written,) = struct.unpack_from(order + "I", image, 12)
            change(order, image, written)
            return True

        return altered(images, "command", of_skill)

    def one_step_more(order, image, _):
        (x,) = struct.unpack_from(order + "h", image, RING + 6)
        struct.pack_into(order + "h", image, RING + 6, x + 1)

    def exchanged(order, image, _):
        image[RING : RING + 4] = image[RING + 2 : RING + 4] + image[RING : RING + 2]

    def one_place_late(order, image, _):
        width = 2 * image[74]
        image[RING:] = image[IMAGE - width :] + image[RING : IMAGE - width]

    def other_order(order, image, _):
        image[RING:] = b"".join(bytes(image[at : at + 2][::-1]) for at in range(RING, IMAGE, 2))

    def coarser(order, image, _):
        (resolution,) = struct.unpack_from(order + "H", image, 72)
        struct.pack_into(order + "H", image, 72, resolution + 1)

    def origin(order, image, _):
        (x,) = struct.unpack_from(order + "f", image, 36)
        struct.pack_into(order + "f", image, 36, x + 0.001)

    def too_early(order, image, written):
        (total,) = struct.unpack_from(order + "I", image, 8)
        struct.pack_into(order + "I", image, 12, min(total, written + 1))

    def refilled(order, image, written):
        if written > 90 // image[74]:
            at = RING + 2 * image[74] * ((written + 1) % (90 // image[74]))
            image[at : at + 2 * image[74]] = bytes(2 * image[74])

    def tool(order, image, _):
        image[71] += 16

    def short(order, image, _):
        (total,) = struct.unpack_from(order + "I", image, 8)
        struct.pack_into(order + "I", image, 8, total - 1)

    for change in (one_step_more, exchanged, one_place_late, other_order, coarser, origin, too_early, refilled, tool, short):
        yield change.__name__, command(change)


def write_files(coordinates, setup, folder):
    """Writes a setup that sends compact points, an application with a spline of such points, and the list of them."""
    with open(f"cell/setups/{setup}.toml", encoding="utf-8") as file:
        text = file.read()
    refill = "accepted" if coordinates == 3 else "executed"
    text = re.sub(r"(?m)^\[plc\].*$", f'[plc]\nform = "compact"\nrefill = "{refill}"', text)
    queue = '{ value = 64, from = "assumed" }'
    text = re.sub(r"(?m)^\[robot\].*$", f"[robot]\ncompact_points = true\nqueue_motions = {queue}", text)
    with open(f"{folder}/setup.toml", "w", encoding="utf-8") as file:
        file.write(text)
    points = []
    for index in range(1, CIRCLE + 1):
        angle = 2 * math.pi * index / CIRCLE
        turn = 20 * math.sin(angle) if coordinates == 6 else 0
        place = (30 - 30 * math.cos(angle), 100 + 30 * math.sin(angle), 150 + 2 * math.sin(2 * angle))
        points.append([round(value, 4) for value in (*place, turn, 0, 180)])
    with open(f"{folder}/points.csv", "w", encoding="utf-8") as file:
        csv.writer(file).writerows([["x", "y", "z", "a", "b", "c"], *points])
    names = [f"p{index}" for index in range(len(points))]
    path = ", ".join(f'"{name}"' for name in names)
    frames = "\n".join(f"{name} = {{ mm_deg = {[float(value) for value in point]} }}" for name, point in zip(names, points))
    with open(f"{folder}/points.toml", "w", encoding="utf-8") as file:
        file.write(
            'schema = 2\nname = "points"\ntitle = "a spline through many points"\ntool = "gripper"\nbase = "table"\n'
            'start = "home"\n\n[tools]\ngripper = 0\n\n[bases]\ntable = 1\n\n[frames]\n'
            f"home = {{ mm_deg = [0.0, 100.0, 150.0, 0.0, 0.0, 180.0] }}\n{frames}\n\n"
            '[[step]]\nname = "circle"\ndoes = "a circle"\nlabels = ["accurate-path", "accurate-stop"]\nfrom = "home"\n'
            f"path = [{{ spline = [{path}] }}]\n"
        )


def main():
    """Compares the points and returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", choices=("3", "6"), help="write the files for such points: SETUP DIR follow")
    parser.add_argument("--planted", action="store_true", help="also try faults, each of which must be found")
    parser.add_argument("first", metavar="CAPTURE|SETUP")
    parser.add_argument("second", metavar="LIST|DIR")
    asked = parser.parse_args()
    if asked.write:
        write_files(int(asked.write), asked.first, asked.second)
        return 0
    images = read_images(asked.first)
    with open(asked.second, encoding="utf-8") as file:
        wanted = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:]]
    try:
        head, points = read_points(images)
        worst = compare(head, points, wanted)
    except Fault as fault:
        print(f"{asked.first}: {fault}", file=sys.stderr)
        return 1
    length = head.resolution / 100
    print(f"{len(points)} points of {head.coordinates} coordinates in steps of {length} µm: at most {worst:.3f} steps off the list")
    missed = 0
    for name, images_of_fault in planted(images) if asked.planted else ():
        try:
            compare(*read_points(images_of_fault), wanted)
            print(f"planted {name}: not found", file=sys.stderr)
            missed += 1
        except Fault as fault:
            print(f"planted {name}: found: {fault}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
