"""profinet-py as IO-Controller: gives the device its address, connects, runs the robot's program, releases.

usage: profinet_py_plc.py INTERFACE STATION ADDRESS
"""

import sys
import time

from profinet import ProfinetDevice, dcp, util
from profinet.rpc import IOCRSetup, IOSlot

from skill_image import Plc

interface, station, address = sys.argv[1:]
CYCLE = 0.016

with_raw = util.ethernet_socket(interface)
mac = util.get_mac(interface)
device = ProfinetDevice.discover(station, interface, timeout=2)
assert dcp.set_ip(with_raw, mac, device.mac, address, "255.255.255.0", "0.0.0.0"), "no answer to DCP Set"
device = ProfinetDevice.discover(station, interface, timeout=2)
assert device.ip == address, f"the device has the address {device.ip}"
print(f"found {device.name} at {device.ip}", flush=True)

# Its Connect has neither a device access point nor consumer status, and asks for the old RT class 1.
slot = IOSlot(slot=1, subslot=1, input_length=256, output_length=256, module_ident=0x100, submodule_ident=0x101)
cyclic = device.start_cyclic(IOCRSetup(slots=[slot], reduction_ratio=16, watchdog_factor=20, data_hold_factor=20))
print("connected", flush=True)


def exchange(command):
    cyclic.set_output_data(1, 1, command)
    time.sleep(CYCLE)
    return cyclic.get_input_data(1, 1)


Plc(">").run(exchange)
order = bytes(device._rpc.read_im0(slot=0, subslot=1).order_id).decode().rstrip()
assert order == "skillbench-robot", f"I&M0 names the order {order!r}"
cyclic.stop()
device._release_ar(device._rpc)
print("released", flush=True)
