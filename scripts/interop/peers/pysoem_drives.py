"""SOEM as controller of the example `drives`: objects by SDO, power on, a motion, a quick stop, lost process data, and a reset.

usage: pysoem_drives.py INTERFACE
"""

import struct
import sys
import time

import pysoem

DRIVES = 6

# Seconds between two frames with process data, and the largest number of frames until a drive has followed a command.
CYCLE = 0.001
FRAMES = 500

# Milliseconds without process data until the devices' watchdogs expire. A busy host stalls for less.
WATCHDOG = 1000

# Control words, and the bits of the status word that show a state.
DISABLE, SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP, RESET = 0x00, 0x06, 0x07, 0x0F, 0x02, 0x80
DISABLED, READY, SWITCHED_ON, ENABLED, STOPPED, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08

# Bits 12 and 13 of the status word: the drive follows, and does not follow closely enough.
FOLLOWS, FOLLOWING_ERROR = 0x1000, 0x2000

# Increments in each cycle, and the number of cycles.
STEP, STEPS = 50, 200


class Controller:
    """Process data of all drives."""

    def __init__(self, master):
        self.master = master
        self.control = DISABLE
        self.targets = [0] * DRIVES

    def cycle(self):
        for device, target in zip(self.master.slaves, self.targets):
            device.output = struct.pack("<HibB", self.control, target, 8, 0)
        self.master.send_processdata()
        counted = self.master.receive_processdata(10_000)
        assert counted == self.master.expected_wkc, (counted, self.master.expected_wkc)
        time.sleep(CYCLE)

    def inputs(self):
        """Status word, position, following error, error code, mode and a gap, of each drive."""
        return [struct.unpack("<HiiHbB", bytes(device.input)) for device in self.master.slaves]

    def states(self):
        """The states that the status words show. Bit 5 has a meaning in some of them only."""
        return [
            status & (0x6F if status & 0x6F in (READY, SWITCHED_ON, ENABLED, STOPPED) else 0x4F)
            for status, *_ in self.inputs()
        ]

    def command(self, control, state):
        """Sends a control word until all drives are in a state."""
        self.control = control
        for _ in range(FRAMES):
            self.cycle()
            if self.states() == [state] * DRIVES:
                return
        raise AssertionError((hex(control), hex(state), [hex(status) for status, *_ in self.inputs()]))


def main(interface):
    master = pysoem.Master()
    master.open(interface)
    assert master.config_init() == DRIVES, "six drives were expected"
    assert master.state_check(pysoem.PREOP_STATE, 500_000) == pysoem.PREOP_STATE
    for device in master.slaves:
        startup(device)
    print("objects by SDO", flush=True)
    assert master.config_map() == DRIVES * (8 + 14)
    assert master.state_check(pysoem.SAFEOP_STATE, 500_000) == pysoem.SAFEOP_STATE
    controller = Controller(master)
    to_op(controller)
    power_on(controller)
    move(controller)
    controller.command(QUICK_STOP, STOPPED)
    for _ in range(20):
        controller.cycle()
    assert controller.states() == [STOPPED] * DRIVES, "option 6: the drives stay there"
    controller.command(ENABLE, ENABLED)
    print("quick stop", flush=True)
    silence(controller)
    power_on(controller)
    controller.command(DISABLE, DISABLED)
    master.state = pysoem.INIT_STATE
    master.write_state()
    assert master.state_check(pysoem.INIT_STATE, 500_000) == pysoem.INIT_STATE
    master.close()
    print("done", flush=True)


def startup(device):
    """What masters write and read at startup."""
    assert device.sdo_read(0x1000, 0) == struct.pack("<I", 0x0002_0192), "a servo drive of profile 402"
    assert device.sdo_read(0x6502, 0) == struct.pack("<I", 0x80), "cyclic synchronous position"
    device.sdo_write(0x6060, 0, b"\x08")
    assert device.sdo_read(0x6060, 0) == b"\x08"
    # A quick stop that the drive stays in.
    device.sdo_write(0x605A, 0, struct.pack("<h", 6))
    assert device.sdo_read(0x1001, 0) == b"\x00"
    assert struct.unpack("<H", device.sdo_read(0x6041, 0))[0] & 0x4F == DISABLED
    device.set_watchdog("processdata", WATCHDOG)


def to_op(controller):
    master = controller.master
    controller.control = DISABLE
    controller.cycle()
    master.state = pysoem.OP_STATE
    master.write_state()
    for _ in range(FRAMES):
        controller.cycle()
        if master.state_check(pysoem.OP_STATE, 1_000) == pysoem.OP_STATE:
            return
    raise AssertionError([(hex(device.state), hex(device.al_status)) for device in master.slaves])


def power_on(controller):
    controller.targets = [position for _, position, *_ in controller.inputs()]
    for control, state in ((SHUTDOWN, READY), (SWITCH_ON, SWITCHED_ON), (ENABLE, ENABLED)):
        controller.command(control, state)
    assert [mode for *_, mode, _ in controller.inputs()] == [8] * DRIVES
    print("power on", flush=True)


def move(controller):
    start = list(controller.targets)
    for _ in range(STEPS):
        controller.targets = [target + STEP for target in controller.targets]
        controller.cycle()
    for _ in range(FRAMES):
        controller.cycle()
        if [position for _, position, *_ in controller.inputs()] == controller.targets:
            break
    for (status, position, error, code, *_), begin in zip(controller.inputs(), start):
        assert (position, error, code) == (begin + STEP * STEPS, 0, 0), (position, error, code)
        assert status & (FOLLOWS | FOLLOWING_ERROR) == FOLLOWS, hex(status)
    print("moved", STEP * STEPS, "increments", flush=True)


def silence(controller):
    """Without process data the devices fall to SAFE-OP, and each drive has a fault until it is reset."""
    master = controller.master
    time.sleep(2 * WATCHDOG / 1000)
    master.read_state()
    assert [(device.state, device.al_status) for device in master.slaves] == [(0x14, 0x001B)] * DRIVES
    for device in master.slaves:
        assert device.sdo_read(0x603F, 0) == struct.pack("<H", 0x7500)
        assert device.sdo_read(0x1001, 0) == b"\x11", "an error of the communication"
        device.state = pysoem.SAFEOP_STATE | pysoem.STATE_ACK
        device.write_state()
    assert master.state_check(pysoem.SAFEOP_STATE, 500_000) == pysoem.SAFEOP_STATE
    to_op(controller)
    controller.command(DISABLE, FAULT)
    controller.command(RESET, DISABLED)
    assert all(device.sdo_read(0x1001, 0) == b"\x00" for device in master.slaves)
    print("a fault of each drive, reset", flush=True)


main(sys.argv[1])
