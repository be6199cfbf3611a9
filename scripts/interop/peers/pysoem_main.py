"""SOEM as MainDevice of the example `subdevice`: to OP, SDOs both ways, a file, process data, and back.

usage: pysoem_main.py INTERFACE
"""

import struct
import sys
import time

import pysoem

ROUNDS = 500

# Seconds between two frames with process data.
CYCLE = 0.001


def main(interface):
    master = pysoem.Master()
    master.open(interface)
    assert master.config_init() == 2, "two devices were expected"
    echo, simple = master.slaves
    assert (echo.name, simple.name) == ("ECHO", "SIMPLE"), (echo.name, simple.name)
    assert (echo.man, echo.id, echo.rev) == (0xF00, 2, 1), (echo.man, echo.id, echo.rev)
    print("found", echo.name, simple.name, flush=True)

    assert master.state_check(pysoem.PREOP_STATE, 500_000) == pysoem.PREOP_STATE
    sdo(echo)
    # What SOEM reads of the dictionary by the information service.
    objects = {item.index: item.name.decode() for item in echo.od}
    assert objects[0x8001] == "Text" and objects[0x1018] == "Identity", objects
    entries = [entry.name.decode() for item in echo.od if item.index == 0x1018 for entry in item.entries]
    assert entries[1:] == ["Vendor ID", "Product code", "Revision", "Serial number"], entries
    print(len(objects), "objects", flush=True)
    foe(echo)

    size = master.config_map()
    assert size == 32, size
    assert master.config_dc(), "a device has a clock"
    print("process data of", size, "bytes", flush=True)
    assert master.state_check(pysoem.SAFEOP_STATE, 500_000) == pysoem.SAFEOP_STATE
    master.state = pysoem.OP_STATE
    master.write_state()
    exchange(master)
    assert master.state_check(pysoem.OP_STATE, 500_000) == pysoem.OP_STATE, hex(echo.al_status)
    print("OP", flush=True)
    for number in range(1, ROUNDS + 1):
        echo.output = struct.pack("<Q", number)
        simple.output = struct.pack("<Q", number << 32)
        # The devices copy between two cycles, a cycle later if the host is busy.
        for _ in range(50):
            exchange(master)
            time.sleep(CYCLE)
            received = struct.unpack("<Q", echo.input) + struct.unpack("<Q", simple.input)
            if received == (number, number << 32):
                break
        assert received == (number, number << 32), (number, received)
    print(ROUNDS, "numbers came back", flush=True)

    # While in OP the mailbox goes on.
    assert echo.sdo_read(0x8000, 0) == b"\x2a\x00"
    master.state = pysoem.INIT_STATE
    master.write_state()
    assert master.state_check(pysoem.INIT_STATE, 500_000) == pysoem.INIT_STATE
    master.close()
    print("done", flush=True)


def exchange(master):
    """One cycle, with every device counted."""
    master.send_processdata()
    counted = master.receive_processdata(10_000)
    assert counted == master.expected_wkc, (counted, master.expected_wkc)


def sdo(device):
    """Transfers of each kind both ways."""
    assert device.sdo_read(0x1008, 0) == b"ECHO"
    device.sdo_write(0x8000, 0, struct.pack("<H", 42))
    assert device.sdo_read(0x8000, 0) == b"\x2a\x00"
    for length in (3, 4, 5, 240, 241, 1000, 2000):
        text = bytes(65 + at % 26 for at in range(length))
        device.sdo_write(0x8001, 0, text)
        assert device.sdo_read(0x8001, 0, 2000) == text, length
    try:
        device.sdo_read(0x5555, 0)
    except pysoem.SdoError as error:
        assert error.abort_code == 0x06020000, hex(error.abort_code)
    else:
        raise AssertionError("an object that does not exist was read")
    print("SDOs of every kind", flush=True)


def foe(device):
    """A file there and back."""
    content = bytes(at % 251 for at in range(5000))
    device.foe_write("robot.toml", 0, content)
    assert device.foe_read("robot.toml", 0, 8192) == content
    print("file of", len(content), "bytes", flush=True)


main(sys.argv[1])
