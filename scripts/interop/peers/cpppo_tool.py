"""cpppo as explicit client: List* over TCP and UDP, attributes of the identity.

usage: cpppo_tool.py ADDRESS
"""

import sys

from cpppo.server.enip import client
from cpppo.server.enip.get_attribute import attribute_operations

(address,) = sys.argv[1:]
for udp in (True, False):
    way = "UDP" if udp else "TCP"
    with client.client(host=address, port=44818, udp=udp, timeout=3) as connection:
        for ask, command in (
            (connection.list_services, "list_services"),
            (connection.list_identity, "list_identity"),
            (connection.list_interfaces, "list_interfaces"),
        ):
            ask(timeout=3)
            answer, _ = client.await_response(connection, timeout=3)
            assert answer and answer.enip.status == 0 and command in answer.enip.CIP, f"{command} over {way}: {answer}"
            if command == "list_identity":
                name = answer.enip.CIP.list_identity.CPF.item[0].identity_object.product_name
                assert name == "skillbench robot", name
    print(f"services, identity and interfaces listed over {way}", flush=True)

with client.connector(host=address, timeout=3) as connection:
    operations = attribute_operations(["@1/1/1", "@1/1/7"], route_path=[], send_path="")
    values = [value for *_, value in connection.synchronous(operations=operations, timeout=3)]
    print(f"attributes {values}", flush=True)
    assert bytes(values[0]) == b"\xff\xff", values
    assert bytes(values[1]) == b"\x10skillbench robot", values
print("attributes read", flush=True)

# A class 3 connection to the message router: Forward_Open, an attribute through it, Forward_Close.
router = [{"class": 2}, {"instance": 1}]
connection = client.implicit(host=address, timeout=3, connection_path=router)
assert connection.established.forward_open.O_T.connection_ID, connection.established
operations = attribute_operations(["@1/1/7"], route_path=False, send_path="")
with connection:
    ((*_, value),) = connection.synchronous(operations=operations, timeout=3)
assert bytes(value) == b"\x10skillbench robot", value
connection.close()
print("opened, asked and closed", flush=True)
