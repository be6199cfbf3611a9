"""pnio-dcp as an engineering tool: finds the device, asks and sets its name and address.

usage: pnio_dcp_tool.py OUR-ADDRESS STATION ADDRESS
"""

import sys

from pnio_dcp import DCP

ours, station, address = sys.argv[1:]
dcp = DCP(ours)
dcp.default_timeout = 2
# It lets devices spread their answers over 1.28 s.
found = dcp.identify_all(timeout=2)
assert len(found) == 1, f"{len(found)} devices answered Identify"
mac = found[0].MAC
assert found[0].name_of_station == station, found[0]
print(f"identified {found[0]}", flush=True)
assert dcp.get_name_of_station(mac) == station

answer = dcp.set_ip_address(mac, [address, "255.255.255.0", "0.0.0.0"], store_permanent=False)
assert answer, answer.get_message()
assert dcp.get_ip_address(mac) == address, dcp.get_ip_address(mac)

answer = dcp.set_name_of_station(mac, "renamed-robot", store_permanent=False)
assert answer, answer.get_message()
assert dcp.get_name_of_station(mac) == "renamed-robot"
(found,) = dcp.identify_all(timeout=2)
assert (found.name_of_station, found.IP) == ("renamed-robot", address), found

answer = dcp.blink(mac)
assert answer, answer.get_message()
print("address, name and signal are set", flush=True)
