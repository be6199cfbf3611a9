"""Devices by the files of their makers: emulated, and driven."""

from .lines import ProgramLines
from .program import bench


class EmulatedDevice(ProgramLines):
    """The device of a GSDML, EDS or ESI at the end of a cable (`bench emulate`).

    `options` are those of the command that choose from the file, such as `["--module", "1=M_8DI"]`; `script` is a file with
    inputs and faults over time. `inputs` and `outputs` list its places.
    """

    def __init__(self, file, end, *, options=(), script=None):
        command = [*end.prefix, bench(), "emulate", str(file), "--interface", end.interface, "--json", *options]
        if script is not None:
            command += ["--script", str(script)]
        self._output = None
        super().__init__(command)
        started = self.wait_for(lambda it: "started" in it, "start of the device")["started"]
        self.bus, self.inputs, self.outputs = started["bus"], started["inputs"], started["outputs"]

    def _notice(self, message):
        if isinstance(message, dict) and "outputs" in message:
            self._output = message["outputs"]

    def set(self, place, value, type, **at):
        """Sets an input from now on: `device.set("100", 5, "uint16", byte=2)`."""
        self.send({"set": {"place": place, "type": type, "value": value, **at}})

    def fault(self, kind, seconds=None, **details):
        """Begins a fault, such as `silent`, and waits until it has begun. Without `seconds` it stays."""
        fault = {"kind": kind, **details}
        if seconds is not None:
            fault["seconds"] = seconds
        self.send({"fault": fault})
        self.wait_for(lambda it: it.get("fault", {}).get("begins") is True, f"fault {kind}")

    def wait_up(self, patience=None):
        """Waits until a controller exchanges data with the device."""
        self.wait_for(_is_up, "connection of a controller", patience)

    def wait_down(self, patience=None):
        """Waits until the connection ends, and returns the reason."""
        return self.wait_for(_is_down, "end of the connection", patience).get("reason", "")

    def wait_for_outputs(self, accept, patience=None):
        """Returns the outputs as bytes once a controller set those that are accepted."""
        if self._output is not None and self._output["is_valid"] and accept(bytes.fromhex(self._output["bytes"])):
            return bytes.fromhex(self._output["bytes"])
        message = self.wait_for(
            lambda it: it.get("outputs", {}).get("is_valid") and accept(bytes.fromhex(it["outputs"]["bytes"])), "outputs", patience
        )
        return bytes.fromhex(message["outputs"]["bytes"])


class DrivenDevice(ProgramLines):
    """The controller of a device, by its file (`bench io`).

    `at` is its station name, address or position; `options` are further ones of the command. `values` has the newest value of
    each input by its name.
    """

    def __init__(self, file, end, *, at=None, run=True, options=()):
        command = [*end.prefix, bench(), "io", "--interface", end.interface, "--json", "--device", str(file)]
        command += ["--at", str(at)] if at is not None else []
        command += [*options, *(["--run"] if run else [])]
        self.values = {}
        super().__init__(command)
        started = self.wait_for(lambda it: "started" in it, "start of the controller")["started"]
        self.bus, self.inputs = started["bus"], started["inputs"]
        self.outputs, self.parameters = started["outputs"], started["parameters"]

    def _notice(self, message):
        if isinstance(message, dict) and isinstance(message.get("inputs"), dict):
            self.values.update(message["inputs"])

    def wait_up(self, patience=None):
        """Waits until data are exchanged."""
        self.wait_for(_is_up, "connection to the device", patience)

    def wait_down(self, patience=None):
        """Waits until the connection ends, and returns the reason."""
        return self.wait_for(_is_down, "end of the connection", patience).get("reason", "")

    def run(self):
        """Lets the outputs count."""
        self.send("run")
        self.wait_for(lambda it: it.get("running") is True, "run of the outputs")

    def stop(self):
        """Sends zeros that the device ignores."""
        self.send("stop")
        self.wait_for(lambda it: it.get("running") is False, "stop of the outputs")

    def set(self, name, value):
        """Sets an output by its name."""
        self.send(f"set {name}={value}")

    def read(self, name, patience=None):
        """Reads a parameter by its name."""
        self.send(f"read {name}")
        return self._answer(False, name, patience)

    def write(self, name, value, patience=None):
        """Writes a parameter by its name."""
        self.send(f"write {name}={value}")
        self._answer(True, name, patience)

    def _answer(self, is_write, name, patience):
        answer = self.wait_for(
            lambda it: it.get("parameter", {}).get("is_write") is is_write, f"answer about {name}", patience
        )["parameter"]
        if answer["error"] is not None:
            raise OSError(f"{answer['name']}: {answer['error']}")
        return answer["value"]

    def wait_for_input(self, name, accept, patience=None):
        """Returns the value of an input once it is accepted."""
        if name in self.values and accept(self.values[name]):
            return self.values[name]
        has_it = lambda it: isinstance(it.get("inputs"), dict) and name in it["inputs"] and accept(it["inputs"][name])  # noqa: E731
        return self.wait_for(has_it, f"input {name}", patience)["inputs"][name]


def _is_up(message):
    return isinstance(message, dict) and message.get("up") is True


def _is_down(message):
    return isinstance(message, dict) and message.get("up") is False
