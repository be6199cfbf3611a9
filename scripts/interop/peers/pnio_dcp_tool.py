"""pnio-dcp as an engineering tool: finds the device, asks, sets and resets its name and address.

usage: pnio_dcp_tool.py OUR-ADDRESS STATION ADDRESS for-now|permanent|stored|reset
"""

import sys

from pnio_dcp import DCP

ours, station, address, part = sys.argv[1:]
dcp = DCP(ours)
dcp.default_timeout = 2


def identify():
    # It lets devices spread their answers over 1.28 s.
    found = dcp.identify_all(timeout=2)
    assert len(found) == 1, f"{len(found)} devices answered Identify"
    return found[0]


def set_both(name, permanent, gateway):
    answer = dcp.set_ip_address(mac, [address, "255.255.255.0", gateway], store_permanent=permanent)
    assert answer, answer.get_message()
    assert dcp.get_ip_address(mac) == address, dcp.get_ip_address(mac)
    answer = dcp.set_name_of_station(mac, name, store_permanent=permanent)
    assert answer, answer.get_message()
    assert dcp.get_name_of_station(mac) == name
    found = identify()
    assert (found.name_of_station, found.IP) == (name, address), found


first = identify()
mac = first.MAC
print(f"identified {first}", flush=True)
if part == "for-now":
    assert first.name_of_station == station, first
    assert dcp.get_name_of_station(mac) == station
    set_both("renamed-robot", permanent=False, gateway="0.0.0.0")
    answer = dcp.blink(mac)
    assert answer, answer.get_message()
    print("address, name and signal are set", flush=True)
elif part == "permanent":
    set_both("stored-robot", permanent=True, gateway=ours)
elif part == "stored":
    assert (first.name_of_station, first.IP) == ("stored-robot", address), first
    print("name and address are those of before", flush=True)
else:
    answer = dcp.reset_to_factory(mac)
    assert answer, answer.get_message()
    found = identify()
    assert (found.name_of_station, found.IP) == (station, "0.0.0.0"), found
    print("neither name nor address is left", flush=True)
