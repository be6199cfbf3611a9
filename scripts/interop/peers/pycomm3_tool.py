"""pycomm3 as explicit client: identity, attributes, an assembly, raw Forward_Open and Forward_Close.

usage: pycomm3_tool.py ADDRESS
"""

import struct
import sys
import time

from pycomm3 import CIPDriver

(address,) = sys.argv[1:]
identity = CIPDriver.list_identity(address)
assert identity["product_name"] == "skillbench robot", identity
print(f"identified {identity['product_name']}", flush=True)

# It listens for a second, and leaves the delay of the answer to the device.
broadcast = address.rsplit(".", 1)[0] + ".255"
found = [CIPDriver.discover(broadcast) for _ in range(12)]
assert all([device["ip_address"] for device in devices] == [address] for devices in found), found
print("discovered 12 times of 12", flush=True)

with CIPDriver(address) as driver:

    def ask(service, class_code, instance, attribute=b"", data=b""):
        answer = driver.generic_message(
            service=service, class_code=class_code, instance=instance, attribute=attribute, request_data=data,
            connected=False, unconnected_send=False, route_path=False,
        )
        return answer.value if answer.error is None else answer.error

    vendor = ask(0x0E, 0x01, 1, 1)
    assert vendor == b"\xff\xff", vendor
    name = ask(0x0E, 0x01, 1, 7)
    assert name == b"\x10skillbench robot", name
    feedback = ask(0x0E, 0x04, 100, 3)
    assert len(feedback) == 256, feedback
    # The robot's life counter moves, whoever looks.
    time.sleep(0.05)
    later = ask(0x0E, 0x04, 100, 3)
    assert feedback[24:26] != later[24:26], "the life counter stands still"
    assert "not supported" in ask(0x0E, 0x01, 1, 99).lower(), ask(0x0E, 0x01, 1, 99)
    # The interface as the kernel has it: a veth has 10 Gbit/s in full duplex.
    deadline = time.monotonic() + 5
    while len(ask(0x0E, 0xF6, 1, 4)) != 44:
        assert time.monotonic() < deadline, "the counters of the interface are not there"
    speed, flags = (struct.unpack("<I", ask(0x0E, 0xF6, 1, attribute))[0] for attribute in (1, 2))
    assert (speed, flags & 3) == (10_000, 3), (speed, flags)
    octets, = struct.unpack_from("<Q", ask(0x0E, 0xF6, 1, 12))
    assert octets > 1_000 and len(ask(0x0E, 0xF6, 1, 5)) == 48 and len(ask(0x0E, 0xF6, 1, 13)) == 48, octets
    cleared = ask(0x4C, 0xF6, 1, 12)
    assert struct.unpack_from("<Q", cleared)[0] >= octets, cleared
    assert struct.unpack_from("<Q", ask(0x0E, 0xF6, 1, 12))[0] < octets
    gateway = ask(0x0E, 0xF5, 1, 5)[8:12]
    assert gateway == bytes([254, 64, 168, 192]), gateway
    print("attributes read", flush=True)

    # Path: assembly class, configuration 151, O->T 152 (input-only heartbeat), T->O 100.
    path = bytes([0x20, 4, 0x24, 151, 0x2C, 152, 0x2C, 100])
    head = bytes([0x0A, 0x0E])  # priority and tick time, time-out ticks
    serial = struct.pack("<HHI", 0x0C0D, 0x1337, 0xCAFE)
    rpi = 100_000
    opened = ask(
        0x54, 0x06, 1,
        data=head + struct.pack("<II", 0, 0x7001) + serial + bytes([2, 0, 0, 0])
        + struct.pack("<IHIH", rpi, 0x4800 | 2, rpi, 0x4800 | 258) + bytes([0x01, len(path) // 2]) + path,
    )
    assert isinstance(opened, bytes), f"Forward_Open was refused: {opened}"
    o_t, t_o = struct.unpack_from("<II", opened)
    assert (o_t != 0, t_o, opened[8:16]) == (True, 0x7001, serial), opened
    assert struct.unpack_from("<II", opened, 16) == (rpi, rpi), opened
    # Who has it: by its triad and by its number.
    data = ask(0x57, 0x06, 1, data=serial)
    assert len(data) == 56 and data[8:16] == serial and struct.unpack_from("<I", data, 28) == (rpi,), data
    assert ask(0x56, 0x06, 1, data=data[:2]) == data
    closed = ask(0x4E, 0x06, 1, data=head + serial + bytes([len(path) // 2, 0]) + path)
    assert isinstance(closed, bytes) and closed[:8] == serial, f"Forward_Close was refused: {closed}"
    assert "destination unknown" in ask(0x57, 0x06, 1, data=serial).lower(), ask(0x57, 0x06, 1, data=serial)
    print("opened and closed", flush=True)

    # An owner that may be silent for 5120 s: the robot names it.
    path = bytes([0x20, 4, 0x24, 151, 0x2C, 150, 0x2C, 100])
    rpi = 10_000_000
    opened = ask(
        0x54, 0x06, 1,
        data=head + struct.pack("<II", 0, 0x7002) + serial + bytes([7, 0, 0, 0])
        + struct.pack("<IHIH", rpi, 0x4800 | 262, rpi, 0x4800 | 258) + bytes([0x01, len(path) // 2]) + path,
    )
    assert isinstance(opened, bytes), f"Forward_Open was refused: {opened}"
    owner = ask(0x5A, 0x06, 1, data=bytes([0, len(path) // 2]) + path)
    assert owner == bytes([1, 0, 0, 1]) + serial, owner
    closed = ask(0x4E, 0x06, 1, data=head + serial + bytes([len(path) // 2, 0]) + path)
    assert isinstance(closed, bytes), f"Forward_Close was refused: {closed}"
    print("owned and closed", flush=True)
