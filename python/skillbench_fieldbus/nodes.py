"""The PLC node and the robot node, by the messages of their control port (`control.schema.json`).

A node that a test starts takes the same messages by its standard input; one that runs elsewhere takes them over TCP.
"""

import dataclasses
import importlib.resources
import json

from .lines import Ended, ProgramLines, SocketLines
from .program import bench

#: Version of the protocol that this package speaks.
PROTOCOL = 1


def control_schema():
    """Returns the JSON schema of all messages."""
    text = importlib.resources.files(__package__).joinpath("control.schema.json").read_text(encoding="utf-8")
    return json.loads(text)


@dataclasses.dataclass(frozen=True)
class Execution:
    """One execution of the sequence: its time at the PLC, and the whole message `finished`."""

    execution_type: str
    seconds: float
    motions: int
    message: dict


class _Node:
    """What both nodes understand. `Lines` of a program or of a connection stand before it."""

    @staticmethod
    def _refusal(message):
        if not isinstance(message, dict):
            return None
        refused = message.get("refused") or _event(message, "refused")
        return refused.get("reason") if isinstance(refused, dict) else refused

    def wait_up(self, patience=None):
        """Waits until both nodes exchange images."""
        self.wait_for(lambda it: it == "link_up" or isinstance(it, dict) and "link_up" in it, "connection of the nodes", patience)

    def wait_down(self, patience=None):
        """Waits until the connection ends, and returns the reason."""
        message = self.wait_for(lambda it: isinstance(it, dict) and "link_down" in it, "end of the connection", patience)
        return message["link_down"]["reason"]

    def report(self, patience=None):
        """Returns the counters of cycles and frames."""
        self.send(json.dumps("report"))
        return self.wait_for(lambda it: isinstance(it, dict) and "report" in it, "report", patience)["report"]

    def check_protocol(self):
        hello = self.wait_for(lambda it: isinstance(it, dict) and "hello" in it, "greeting of the node")["hello"]
        if hello["protocol"] != PROTOCOL:
            raise ValueError(f"the node speaks protocol {hello['protocol']}, this package {PROTOCOL}; use the wheel of its version")
        self.hello = hello


def _event(message, name):
    node = message.get("node") if isinstance(message, dict) else None
    return node.get(name) if isinstance(node, dict) else None


class _Plc(_Node):
    """What a PLC understands besides."""

    _is_ready = False

    def _wait_ready(self, patience):
        if not self._is_ready:
            self.wait_for(lambda it: isinstance(it, dict) and it.get("node") == "ready", "readiness of the robot", patience)
            self._is_ready = True

    def start(self, execution_type, override=None, patience=None):
        """Executes the sequence once as `rc`, `sm` or `cm`, and returns the result.

        `override` is a schedule such as `"80,0@2s,100@3s"`.
        """
        self._wait_ready(patience)
        start = {"execution_type": execution_type}
        if override is not None:
            start["override"] = override
        self.send(json.dumps({"node": {"start": start}}))
        ended = self.wait_for(
            lambda it: _event(it, "finished") is not None or _event(it, "failed") is not None, f"end of {execution_type}", patience
        )
        # The robot is ready again after each execution, and says so.
        self._is_ready = False
        failed = _event(ended, "failed")
        if failed is not None:
            raise RuntimeError(f"{execution_type} failed: {failed['reason']}")
        finished = _event(ended, "finished")
        return Execution(execution_type, finished["execution_time_ns"] / 1e9, finished["motions"], finished)

    def set_override(self, percent):
        """Sets the override in percent."""
        self.send(json.dumps({"node": {"set_override": {"percent": percent}}}))

    def abort(self):
        """Aborts the execution."""
        self.send(json.dumps({"node": "abort"}))


class _StartedNode(ProgramLines):
    """A node that is started at the end of a cable."""

    _VERB = ""

    def __init__(self, setup, end, *, options=()):
        command = [*end.prefix, bench(), self._VERB, "run", "--json", "--interface", end.interface, "--setup", str(setup)]
        super().__init__([*command, *options])
        self.check_protocol()

    def _end(self):
        try:
            self.send(json.dumps("stop"))
        except Ended:
            pass


class PlcNode(_Plc, _StartedNode):
    """The PLC node of a setup: `with PlcNode("A", cable.ends[0]) as plc: plc.start("cm").seconds`."""

    _VERB = "__plc-node"

    @staticmethod
    def connect(host, port, token=None):
        """Connects to a PLC node that runs with `--control HOST:PORT`."""
        return _RemotePlc(host, port, token)


class RobotNode(_Node, _StartedNode):
    """The robot node of a setup."""

    _VERB = "__robot-node"


class _RemotePlc(_Plc, SocketLines):
    def __init__(self, host, port, token):
        super().__init__(host, port)
        if token is not None:
            self.send(json.dumps({"token": token}))
        self.check_protocol()
