"""The skill process image as a foreign PLC sees it: written from its byte tables, not from the nodes' code.

command   0 control (1 enable, 2 execute, 32 reset)  2 life  4 number  6 skill  7 override  16 program  32 check
feedback  0 status (1 busy, 2 done, 8 error, 32 enabled)  2 state  4 number  8 executed  22 life echo  24 life  44 joints
          116 check

The check is a CRC-32C over the bytes behind it and then those before it.
"""

import struct
import time

LENGTH = 256
ENABLE, EXECUTE, RESET = 1, 2, 32
BUSY, DONE, ERROR, ENABLED = 1, 2, 8, 32
READY, RUNNING = 1, 2
RUN_PROGRAM = 17


def table_entry(byte):
    """What a byte does to a CRC-32C."""
    for _ in range(8):
        byte = byte >> 1 ^ (0x82F63B78 if byte & 1 else 0)
    return byte


TABLE = [table_entry(byte) for byte in range(256)]


def check(image, at):
    """The check of an image that has it at this byte."""
    crc = 0xFFFFFFFF
    for byte in image[at + 4 :] + image[:at]:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return crc ^ 0xFFFFFFFF or 0xFFFFFFFF


class Plc:
    """Enables and resets the robot, has it run its program 1, and checks what it says meanwhile."""

    def __init__(self, order):
        self.order = order  # ">" on PROFINET, "<" on EtherNet/IP
        self.start = time.monotonic()
        self.control = ENABLE | RESET
        self.number = 0

    def command(self):
        """The next image to the robot."""
        # Scans of one millisecond, however often the bus asks.
        self.life = int((time.monotonic() - self.start) * 1000) & 0xFFFF
        image = bytearray(LENGTH)
        struct.pack_into(self.order + "HHHBB", image, 0, self.control, self.life, self.number, RUN_PROGRAM, 100)
        struct.pack_into(self.order + "H", image, 16, 1)
        struct.pack_into(self.order + "I", image, 32, check(image, 32))
        return bytes(image)

    def feedback(self, image):
        """What the test asks of the robot's image."""
        status, state, _, number, error = struct.unpack_from(self.order + "HBBHH", image)
        (executed,) = struct.unpack_from(self.order + "I", image, 8)
        (given,) = struct.unpack_from(self.order + "I", image, 116)
        assert given == check(image, 116), f"the check of the feedback is {given:#010x}, not {check(image, 116):#010x}"
        echo, life = struct.unpack_from(self.order + "HH", image, 22)
        joints = struct.unpack_from(self.order + "4f", image, 44)
        return status, state, number, error, executed, echo, life, joints

    def run(self, exchange, seconds=20):
        """Runs the program. `exchange` takes our image and gives the robot's, or None where there is none yet."""
        end = time.monotonic() + seconds
        lives, echoes, places = set(), set(), set()
        busy = False
        while time.monotonic() < end:
            image = exchange(self.command())
            if image is None:
                continue
            assert len(image) == LENGTH, f"{len(image)} bytes of feedback"
            status, state, number, error, executed, echo, life, joints = self.feedback(image)
            assert not status & ERROR, f"the robot reports error {error}"
            lives.add(life)
            echoes.add(echo)
            places.add(tuple(round(joint, 1) for joint in joints))
            if self.number == 0 and state == READY and status & ENABLED:
                print("robot ready", flush=True)
                self.control, self.number = ENABLE | EXECUTE, 0x0B0B
            busy |= status & BUSY and number == self.number
            if busy and status & DONE and number == self.number:
                # 126..128 says what the robot serves: bit 0, that it follows a master.
                assert sum(image[126:128]) == 1, f"services {image[126:128].hex()}"
                assert not any(image[96:116] + image[120:126] + image[128:]), "the end of the image is not zero"
                # The robot's counter moves, and it has followed ours.
                assert len(lives) > 20 and len(echoes) > 20, f"{len(lives)} lives, {len(echoes)} echoes"
                assert len(places) > 20, f"the arm was seen in {len(places)} places only"
                print(f"{executed} motions, {len(lives)} lives, {len(echoes)} echoes, {len(places)} places", flush=True)
                return
        raise SystemExit(f"the robot did not finish: control {self.control:#x}, {len(lives)} lives")
