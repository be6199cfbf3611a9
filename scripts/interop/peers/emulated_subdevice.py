"""pysoem (SOEM) as MainDevice of an emulated terminal: identity, object, sizes, data both ways, an emergency.

usage: emulated_subdevice.py INTERFACE NAME
"""

import struct
import sys
import time

import pysoem

interface, name = sys.argv[1:]
master = pysoem.Master()
master.open(interface)
assert master.config_init() == 1, "one device was expected"
(device,) = master.slaves
assert device.name == name, device.name
print("identified", device.name, hex(device.man), hex(device.id), hex(device.rev), flush=True)
has_mailbox = name == "MU1002"
if has_mailbox:
    assert device.sdo_read(0x8000, 0) == b"\x34\x12", device.sdo_read(0x8000, 0)
    device.sdo_write(0x8000, 0, b"\x01\x00")
    assert device.sdo_read(0x8000, 0) == b"\x01\x00"
    print("object read and written", flush=True)
emergencies = []
device.add_emergency_callback(emergencies.append)


def exchange():
    master.send_processdata()
    return master.receive_processdata(20_000)


master.config_map()
print("sizes", len(device.output), len(device.input), flush=True)
assert master.state_check(pysoem.SAFEOP_STATE, 500_000) == pysoem.SAFEOP_STATE
master.state = pysoem.OP_STATE
master.write_state()
for _ in range(200):
    exchange()
    if master.state_check(pysoem.OP_STATE, 2_000) == pysoem.OP_STATE:
        break
assert master.state_check(pysoem.OP_STATE, 500_000) == pysoem.OP_STATE, hex(device.al_status)
print("OP", flush=True)
echoed = counted = 0
for number in range(600):
    device.output = struct.pack("<h", number) if has_mailbox else bytes([number & 0x0F])
    for _ in range(5):
        counted += exchange() > 0
        time.sleep(0.001)
    if has_mailbox:
        echoed += struct.unpack("<h", device.input[2:4])[0] == number
        if number % 20 == 0:
            device.mbx_receive() if hasattr(device, "mbx_receive") else device.sdo_read(0x8000, 0)
assert not has_mailbox or echoed > 400, echoed
# A loaded host may answer a frame later than SOEM waits.
assert counted > 2_700, counted
print("data both ways", flush=True)
print("emergencies", *[hex(emergency.error_code) for emergency in emergencies], flush=True)
master.state = pysoem.INIT_STATE
master.write_state()
print("done", flush=True)
