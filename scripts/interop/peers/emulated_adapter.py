"""pycomm3 opens a class 1 connection to an emulated adapter, whose data this script then exchanges over UDP.

usage: emulated_adapter.py ADDRESS
"""

import socket
import struct
import sys
import time

from pycomm3 import CIPDriver

(address,) = sys.argv[1:]
RPI = 20_000
identity = CIPDriver.list_identity(address)
assert identity["product_name"] == "made-up coupler", identity
assert (identity["revision"]["major"], identity["revision"]["minor"]) == (3, 2), identity
print("identified", identity["product_name"], flush=True)

cyclic = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
cyclic.bind(("0.0.0.0", 2222))
cyclic.settimeout(1)

with CIPDriver(address) as driver:

    def ask(service, class_code, instance, attribute=b"", data=b""):
        answer = driver.generic_message(
            service=service, class_code=class_code, instance=instance, attribute=attribute, request_data=data,
            connected=False, unconnected_send=False, route_path=False,
        )
        return answer.value if answer.error is None else answer.error

    sizes = [struct.unpack("<H", ask(0x0E, 0x04, instance, 4))[0] for instance in (101, 102, 103)]
    assert sizes == [8, 4, 6], sizes
    print("sizes", *sizes, flush=True)

    serial = struct.pack("<HHI", 0x0C0D, 0x1337, 0xCAFE)
    # The key of the device, then configuration 103, outputs 102, inputs 101, and six bytes of configuration data.
    key = bytes([0x34, 4]) + struct.pack("<HHHBB", 65534, 12, 77, 3, 2)
    path = key + bytes([0x20, 4, 0x24, 103, 0x2C, 102, 0x2C, 101]) + bytes([0x80, 3, 1, 2, 3, 4, 5, 6])
    head = bytes([0x0A, 0x0E])
    opened = ask(
        0x54, 0x06, 1,
        data=head + struct.pack("<II", 0, 0x7001) + serial + bytes([2, 0, 0, 0])
        + struct.pack("<IHIH", RPI, 0x4800 | 10, RPI, 0x4800 | 10) + bytes([0x01, len(path) // 2]) + path,
    )
    assert isinstance(opened, bytes), f"Forward_Open was refused: {opened}"
    (o_t,) = struct.unpack_from("<I", opened)
    assert ask(0x0E, 0x04, 103, 3) == bytes([1, 2, 3, 4, 5, 6]), "the configuration data are not there"
    echoed, counted = 0, set()
    for number in range(1, 101):
        outputs = struct.pack("<I", number)
        frame = struct.pack("<HHHII", 2, 0x8002, 8, o_t, number)
        frame += struct.pack("<HHHI", 0xB1, 10, number, 1) + outputs
        cyclic.sendto(frame, (address, 2222))
        data = cyclic.recv(200)
        assert len(data) == 28, len(data)
        counted.add(data[20])
        echoed += data[24:28] == struct.pack("<I", number - 1) or data[24:28] == outputs
        time.sleep(RPI / 1e6 / 2)
    assert echoed > 50 and len(counted) > 20, (echoed, len(counted))
    print("data both ways", flush=True)
    closed = ask(0x4E, 0x06, 1, data=head + serial + bytes([len(path) // 2, 0]) + path)
    assert isinstance(closed, bytes), f"Forward_Close was refused: {closed}"
print("closed", flush=True)
