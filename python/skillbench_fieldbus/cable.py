"""Where programs run: at both ends of a cable between network namespaces, or at an interface of this machine."""

import dataclasses
import os
import subprocess

#: Programs of Linux that make the namespaces.
_ENTER = ["nsenter", "--preserve-credentials", "--net", "--mount"]


@dataclasses.dataclass(frozen=True)
class End:
    """An interface, and the words in front of a command that runs there.

    `prefix` lets a program of yours run there too: `subprocess.run([*end.prefix, "my-controller", end.interface])`.
    """

    interface: str
    address: str | None
    enter: tuple[str, ...] = ()

    @property
    def prefix(self):
        """Words that run a command there, in the working directory of now."""
        if not self.enter:
            return ()
        # A process that enters a mount namespace is at its root.
        return (*self.enter, "sh", "-c", 'cd "$0" && exec "$@"', os.getcwd())


class Interface:
    """An interface of this machine: a test of a real device or controller. The caller has the permissions for it."""

    def __init__(self, name):
        if not os.path.exists(f"/sys/class/net/{name}"):
            raise FileNotFoundError(f"there is no interface {name}; `ip link` lists them")
        self.end = End(name, None)


class Cable:
    """Two network namespaces and a cable between their interfaces `fieldbus0` and `fieldbus1`.

    The ends have the addresses 192.168.64.1 and 192.168.64.2, if `addresses` are not others; None leaves an end without one. It needs no
    privilege where ordinary users may make user namespaces. The cable is gone when it is closed.
    """

    def __init__(self, addresses=("192.168.64.1/24", "192.168.64.2/24")):
        self._holders = []
        try:
            first, enters = self._first()
            user = [*_ENTER, "--target", str(first.pid), *enters]
            second = self._hold([*user, "unshare", "--net", "--mount"])
            prefixes = [tuple(user), (*_ENTER, "--target", str(second.pid), *(["--user"] if enters else []))]
            self._run(prefixes[0], f"ip link add fieldbus0 type veth peer name fieldbus1 netns {second.pid}")
            self.ends = []
            for number, (prefix, address) in enumerate(zip(prefixes, addresses)):
                if address is not None:
                    self._run(prefix, f"ip address add {address} dev fieldbus{number}")
                for interface in ("lo", f"fieldbus{number}"):
                    self._run(prefix, f"ip link set {interface} up")
                self.ends.append(End(f"fieldbus{number}", address and address.split("/")[0], prefix))
        except BaseException:
            self.close()
            raise

    def _first(self):
        """Makes the first namespace, in a user namespace where that is allowed, and returns how to enter it."""
        try:
            return self._hold(["unshare", "--user", "--map-root-user", "--net", "--mount"]), ["--user"]
        except PermissionError:
            if os.geteuid() != 0:
                raise
        return self._hold(["unshare", "--net", "--mount"]), []

    def _hold(self, command):
        """Keeps namespaces as long as this process lives, and returns the process that holds them."""
        script = "mount -t sysfs sysfs /sys && echo there && exec cat"
        holder = subprocess.Popen(
            [*command, "sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        if holder.stdout.readline() != "there\n":
            reason = holder.stderr.read().strip()
            holder.kill()
            holder.communicate()
            raise PermissionError(f"cannot make a network namespace: {reason}; allow user namespaces, or run the test as root")
        self._holders.append(holder)
        return holder

    @staticmethod
    def _run(prefix, command):
        done = subprocess.run([*prefix, *command.split()], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise OSError(f"{command}: {done.stderr.strip()}")

    def set_cut(self, is_cut):
        """Cuts the cable: both ends lose their link. Or plugs it in again."""
        self._run(self.ends[0].prefix, f"ip link set {self.ends[0].interface} {'down' if is_cut else 'up'}")

    def close(self):
        """Removes both namespaces, and the cable with them."""
        for holder in reversed(self._holders):
            holder.kill()
            holder.communicate()
        self._holders = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
