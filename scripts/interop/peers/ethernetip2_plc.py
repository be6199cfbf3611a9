"""ethernetip2 as class 1 scanner: Forward_Open, the robot's program 1 over the cyclic data, Forward_Close.

usage: ethernetip2_plc.py ADDRESS RPI-IN-MS
"""

import sys
import time

from ethernetip import EtherNetIP

from skill_image import LENGTH, Plc, check

address, rpi = sys.argv[1], int(sys.argv[2])
enip = EtherNetIP(address)
connection = enip.explicit_conn(address)
connection.registerSession()
inputs = enip.registerAssembly(EtherNetIP.ENIP_IO_TYPE_INPUT, LENGTH, 100, connection)
outputs = enip.registerAssembly(EtherNetIP.ENIP_IO_TYPE_OUTPUT, LENGTH, 150, connection)
enip.startIO()
status = connection.sendFwdOpenReq(100, 150, 151, multiplier=4, torpi=rpi, otrpi=rpi)
assert status == 0, f"Forward_Open was refused: {status}"
connection.produce()
print("connected", flush=True)


def exchange(command):
    # It keeps one list entry a bit.
    outputs[:] = [bool(byte >> bit & 1) for byte in command for bit in range(8)]
    time.sleep(rpi / 1000)
    for _ in range(100):
        bits = inputs[:]
        image = bytes(sum(bool(bits[8 * at + bit]) << bit for bit in range(8)) for at in range(LENGTH))
        if int.from_bytes(image[116:120], "little") == check(image, 116):
            break
        # Its receiver unpacks a frame bit by bit, in a thread of its own, and may have done half of it.
        time.sleep(0.001)
    return image


Plc("<").run(exchange)
connection.stopProduce()
assert connection.sendFwdCloseReq(100, 150, 151) == 0, "Forward_Close was refused"
enip.stopIO()
connection.unregisterSession()
print("closed", flush=True)
