"""profinet-py as IO-Controller of an emulated modular device: identity, sizes, data both ways, a diagnosis alarm.

usage: emulated_io_device.py INTERFACE STATION ADDRESS
"""

import struct
import sys
import time

from profinet import ProfinetDevice, dcp, util
from profinet.rpc import IOCRSetup, IOSlot

interface, station, address = sys.argv[1:]
raw = util.ethernet_socket(interface)
mac = util.get_mac(interface)
device = ProfinetDevice.discover(station, interface, timeout=2)
assert dcp.set_ip(raw, mac, device.mac, address, "255.255.255.0", "0.0.0.0"), "no answer to DCP Set"
device = ProfinetDevice.discover(station, interface, timeout=2)
print("identified", device.name, device.ip, flush=True)

slots = [
    IOSlot(slot=1, subslot=1, input_length=1, output_length=0, module_ident=0x21, submodule_ident=1),
    IOSlot(slot=2, subslot=1, input_length=2, output_length=4, module_ident=0x42, submodule_ident=2),
]
cyclic = device.start_cyclic(IOCRSetup(slots=slots, reduction_ratio=16, watchdog_factor=20, data_hold_factor=20))
order = bytes(device._rpc.read_im0(slot=0, subslot=1).order_id).decode().rstrip()
assert order == "MU-IO-77", order
print("connected to order", order, flush=True)
alarms = []
device.on_alarm(alarms.append) if hasattr(device, "on_alarm") else device.start_alarm_listener(alarms.append)
echoed = 0
for number in range(1, 120):
    cyclic.set_output_data(2, 1, struct.pack(">HH", number, 0xBEEF))
    time.sleep(0.05)
    echoed += cyclic.get_input_data(2, 1) == struct.pack(">H", number)
    assert cyclic.get_input_data(1, 1) in (b"\x00", b"\xa5"), cyclic.get_input_data(1, 1)
assert echoed > 60, echoed
assert cyclic.get_input_data(1, 1) == b"\xa5"
print("data both ways", flush=True)
print("alarms", len(alarms), flush=True)
cyclic.stop()
device._release_ar(device._rpc)
print("released", flush=True)
