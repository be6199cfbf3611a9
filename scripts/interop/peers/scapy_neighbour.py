"""Scapy's LLDP layer in strict mode as the neighbour of the IO-Device: reads its announcements, and announces itself.

usage: scapy_neighbour.py INTERFACE STATION ADDRESS
"""

import sys
import threading

from scapy.arch import get_if_hwaddr
from scapy.config import conf
from scapy.contrib import lldp
from scapy.layers.l2 import Ether
from scapy.packet import Raw
from scapy.sendrecv import AsyncSniffer, sendp, sniff

interface, station, address = sys.argv[1:]
mac = get_if_hwaddr(interface)
conf.contribs["LLDP"].strict_mode_enable()
ALIAS = b"port-003.scapy-plc"


def announcement():
    """Waits for an announcement of the station and parses it strictly: order, numbers and lengths of its TLVs."""
    frames = sniff(iface=interface, filter="ether proto 0x88cc and inbound", count=1, timeout=12)
    assert frames, "no announcement within 12 s"
    # Dissected once more by itself: in strict mode a fault raises an exception here.
    frame = Ether(bytes(frames[0]))
    assert frame.dst == "01:80:c2:00:00:0e", frame.dst
    return frame


def alias_answered():
    """Sends an Identify request for the station beside our port; returns whether it answers."""
    block = b"\x02\x06" + len(ALIAS).to_bytes(2, "big") + ALIAS
    # The data length is the last field of the head: FrameID 2, service 2, Xid 4, delay 2, length 2.
    pdu = b"\xfe\xfe\x05\x00\x00\x00\x00\x2a\x00\x01" + len(block).to_bytes(2, "big") + block
    started = threading.Event()
    seen = AsyncSniffer(iface=interface, filter="ether proto 0x8892 and inbound", started_callback=started.set)
    seen.start()
    started.wait(5)
    sendp(Ether(src=mac, dst="01:0e:cf:00:00:00", type=0x8892) / Raw(pdu.ljust(46, b"\0")), iface=interface, verbose=False)
    seen.join(timeout=2)
    answers = [bytes(frame) for frame in seen.stop() or []]
    return any(frame[14:18] == b"\xfe\xff\x05\x01" and ALIAS in frame for frame in answers)


frame = announcement()
chassis, port = frame[lldp.LLDPDUChassisID], frame[lldp.LLDPDUPortID]
assert (chassis.subtype, chassis.id) == (7, station.encode()), frame.show(dump=True)
assert (port.subtype, port.id) == (7, b"port-001"), frame.show(dump=True)
assert frame[lldp.LLDPDUTimeToLive].ttl == 20
assert frame[lldp.LLDPDUSystemName].system_name == station.encode()
managed = frame[lldp.LLDPDUManagementAddress].management_address
assert managed == bytes(map(int, address.split("."))), managed
organizations = []
layer = frame.getlayer(lldp.LLDPDU)
while isinstance(layer, lldp.LLDPDU):
    if isinstance(layer, lldp.LLDPDUGenericOrganisationSpecific):
        organizations.append((layer.org_code, layer.subtype))
    layer = layer.payload
assert organizations == [(0x000ECF, 1), (0x000ECF, 2), (0x000ECF, 5), (0x00120F, 1)], organizations
assert isinstance(frame.lastlayer(), lldp.LLDPDUEndOfLLDPDU) or bytes(frame.lastlayer()).strip(b"\0") == b""
print("the announcement is read in strict mode", flush=True)

assert not alias_answered(), "the station answers by a neighbour that it has not got"
ours = (
    Ether(src=mac, dst="01:80:c2:00:00:0e", type=0x88CC)
    / lldp.LLDPDUChassisID(subtype=7, id=b"scapy-plc")
    / lldp.LLDPDUPortID(subtype=7, id=b"port-003")
    / lldp.LLDPDUTimeToLive(ttl=20)
    / lldp.LLDPDUSystemDescription(description=b"scapy")
    / lldp.LLDPDUEndOfLLDPDU()
)
sendp(ours, iface=interface, verbose=False)
assert alias_answered(), "the station does not answer by the name of its neighbour's port"
print("the station is found by its neighbour's port", flush=True)

ours[lldp.LLDPDUTimeToLive].ttl = 0
sendp(ours, iface=interface, verbose=False)
assert not alias_answered(), "the station still has a neighbour that has gone"
print("the neighbour has gone", flush=True)
