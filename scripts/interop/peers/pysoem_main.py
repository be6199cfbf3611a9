"""SOEM as MainDevice of the example `subdevice`: to OP, SDOs both ways, the EEPROM, a file, process data in two layouts, errors, BOOT,
and back.

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
    master.read_state()
    for device in master.slaves:
        slaveinfo(device)
    foe(echo)
    eeprom(echo)
    refused(echo)

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
    watchdog(master)
    to_init(master)
    overlapped(master)
    to_init(master)
    boot(master.slaves[0])
    to_init(master)
    master.close()
    print("done", flush=True)


def to_init(master):
    master.state = pysoem.INIT_STATE
    master.write_state()
    assert master.state_check(pysoem.INIT_STATE, 500_000) == pysoem.INIT_STATE


def request(device, state):
    """Requests a state; returns the AL status and its code once the device has answered."""
    device.state = state
    device.write_state()
    for _ in range(100):
        time.sleep(0.01)
        device._master.read_state()
        if device.state & 0x0F == state & 0x0F or device.state & 0x10:
            break
    return device.state, device.al_status


def eeprom(device):
    """A word that nothing uses is written, and read with the one behind it."""
    assert device.eeprom_read(0x08) == struct.pack("<I", device.man)
    device.eeprom_write(0x3F0, b"\x34\x12")
    assert device.eeprom_read(0x3F0) == b"\x34\x12\xff\xff"
    print("EEPROM read and written", flush=True)


def refused(device):
    """A request that is refused, which only an acknowledgement ends. Before OP, outputs are objects like others."""
    assert request(device, pysoem.PREOP_STATE | 0x10) == (pysoem.PREOP_STATE, 0)
    assert request(device, 3) == (pysoem.PREOP_STATE | 0x10, 0x0011)
    assert request(device, pysoem.PREOP_STATE) == (pysoem.PREOP_STATE | 0x10, 0x0011)
    assert request(device, pysoem.PREOP_STATE | pysoem.STATE_ACK) == (pysoem.PREOP_STATE, 0)
    device.sdo_write(0x7000, 1, struct.pack("<Q", 5))
    assert device.sdo_read(0x7000, 1) == struct.pack("<Q", 5)
    print("an error acknowledged", flush=True)


def watchdog(master):
    """Without frames the watchdogs expire; both devices say so until that is acknowledged."""
    for _ in range(200):
        time.sleep(0.01)
        master.read_state()
        if all(device.state & 0x10 for device in master.slaves):
            break
    assert [(device.state, device.al_status) for device in master.slaves] == [(0x14, 0x001B)] * 2
    for device in master.slaves:
        assert request(device, pysoem.SAFEOP_STATE | pysoem.STATE_ACK) == (pysoem.SAFEOP_STATE, 0)
    print("watchdogs expired and acknowledged", flush=True)


def overlapped(master):
    """Outputs and inputs of a device at the same logical addresses."""
    assert master.config_init() == 2
    assert master.state_check(pysoem.PREOP_STATE, 500_000) == pysoem.PREOP_STATE
    assert master.config_overlap_map() == 32
    assert master.state_check(pysoem.SAFEOP_STATE, 500_000) == pysoem.SAFEOP_STATE
    echo, simple = master.slaves
    for number in range(1, 20):
        echo.output = struct.pack("<Q", number)
        simple.output = struct.pack("<Q", number << 32)
        master.send_overlap_processdata()
        counted = master.receive_processdata(10_000)
        assert counted == master.expected_wkc == 6, (counted, master.expected_wkc)
        # In SAFE-OP the inputs are there, and the outputs stay safe: nothing comes back.
        assert number == 1 or (echo.input, simple.input) == inputs, (echo.input, simple.input)
        inputs = (echo.input, simple.input)
    print("overlapped process data", flush=True)


def boot(device):
    """A file in BOOT, through mailboxes that are configured for it."""
    device.amend_mbx("out", 0x1000, 256)
    device.amend_mbx("in", 0x1100, 256)
    assert request(device, 3) == (3, 0)
    content = bytes(at % 253 for at in range(3000))
    device.foe_write("firmware.bin", 0, content)
    assert device.foe_read("firmware.bin", 0, 4096) == content
    print("a file in BOOT", flush=True)


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


def slaveinfo(device):
    """Lists what SOEM's program slaveinfo does: identity, PDOs by their mapping objects, and each object with its values."""
    print(f"{device.name}: {device.man:#010x} {device.id:#010x} {device.rev:#010x}, state {device.state:#x}")
    assert device.state == pysoem.PREOP_STATE and device.al_status == 0, (device.state, device.al_status)
    if device.name == "SIMPLE":
        return  # has no mailbox
    objects = {item.index: item for item in device.od}
    for assignment, direction in ((0x1C12, "outputs"), (0x1C13, "inputs")):
        bits = 0
        for number in range(1, device.sdo_read(assignment, 0)[0] + 1):
            pdo = struct.unpack("<H", device.sdo_read(assignment, number))[0]
            for entry in range(1, device.sdo_read(pdo, 0)[0] + 1):
                mapping = struct.unpack("<I", device.sdo_read(pdo, entry))[0]
                index, subindex, length = mapping >> 16, mapping >> 8 & 0xFF, mapping & 0xFF
                name = objects[index].entries[subindex].name.decode()
                print(f"  {direction} {index:#06x}:{subindex:02x} {length} bits {name}")
                bits += length
        assert bits == 64, (direction, bits)
    values = 0
    for index, item in sorted(objects.items()):
        assert item.name, hex(index)
        # A variable has one entry; the first entry of others is the highest subindex, which the information service
        # does not count.
        for subindex, entry in enumerate(item.entries if item.object_code != 7 else [item]):
            readable = item.object_code == 7 or entry.obj_access & 0x0007
            if not readable or (item.object_code != 7 and entry.data_type == 0):
                continue
            value = device.sdo_read(index, subindex, 4000)
            length = (entry.bit_length + 7) // 8
            # Strings may be shorter than their room.
            assert len(value) == length or (entry.data_type in (9, 10) and len(value) <= length), (
                hex(index), subindex, value, entry.bit_length)
            print(f"  {index:#06x}:{subindex:02x} {entry.name.decode()}: {value[:16].hex(' ')}")
            values += 1
    # SOEM keeps what a device complains of: emergencies, aborts and broken answers.
    complaints = []
    device.add_emergency_callback(complaints.append)
    # Above 0: a message that nobody asked for.
    assert device.mbx_receive() <= 0 and not complaints, complaints
    print(len(objects), "objects with", values, "values listed without a complaint", flush=True)


def foe(device):
    """A file there and back."""
    content = bytes(at % 251 for at in range(5000))
    device.foe_write("robot.toml", 0, content)
    assert device.foe_read("robot.toml", 0, 8192) == content
    print("file of", len(content), "bytes", flush=True)


main(sys.argv[1])
