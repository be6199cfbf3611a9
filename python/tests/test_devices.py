"""Devices of files, emulated at one end of a cable and driven from the other."""

import os
import subprocess
import sys

import pytest

from skillbench_fieldbus import Cable, DrivenDevice, EmulatedDevice, Ended, Interface, Refused

PROFINET = "GSDML-V2.35-made-up-io-20260101.xml"
MODULES = ["--module", "1=M_8DI", "--module", "2=M_2AO"]


def test_an_adapter_gets_outputs_and_sends_inputs(fieldbus_cable, files):
    controller_end, device_end = fieldbus_cable.ends
    with EmulatedDevice(files / "made-up-adapter.eds", device_end) as device:
        assert device.bus == "EtherNet/IP"
        with DrivenDevice(files / "made-up-adapter.eds", controller_end, at="192.168.64.2") as controller:
            device.wait_up()
            controller.wait_up()
            controller.set("Outputs", "01020304")
            assert device.wait_for_outputs(lambda data: data == b"\1\2\3\4") == b"\1\2\3\4"
            device.set("101", 0x0201, "uint16")
            shown = controller.wait_for_input("Inputs", lambda value: value.startswith("0102"))
            assert shown == "0102000000000000"
        assert device.wait_down()


def test_an_io_device_that_falls_silent_is_lost_and_connected_again(files):
    with Cable(("192.168.64.1/24", None)) as cable:
        controller_end, device_end = cable.ends
        with EmulatedDevice(files / PROFINET, device_end, options=[*MODULES, "--station-name", "made-up-io"]) as device:
            options = ["--address", "192.168.64.2", *MODULES]
            with DrivenDevice(files / PROFINET, controller_end, at="made-up-io", options=options) as controller:
                controller.wait_up()
                device.wait_up()
                device.fault("silent", seconds=1.0)
                assert controller.wait_down()
                controller.wait_up()


def test_a_terminal_on_ethercat_answers_and_a_cut_cable_takes_it_away(files):
    file, choice = files / "made-up-terminal.xml", ["--device-name", "MU1002"]
    with Cable((None, None)) as cable:
        controller_end, device_end = cable.ends
        with EmulatedDevice(file, device_end, options=choice) as device:
            with DrivenDevice(file, controller_end, options=choice) as controller:
                controller.wait_up()
                assert controller.read("Filter") == 0x1234
                controller.write("Filter", 7)
                assert controller.read("Filter") == 7
                controller.set("Output", 258)
                device.wait_for_outputs(lambda data: data == b"\2\1")
                cable.set_cut(True)
                assert controller.wait_down()


def test_what_is_refused_says_why(fieldbus_cable, files):
    end = fieldbus_cable.ends[1]
    with pytest.raises(Ended, match="choose one"):
        EmulatedDevice(files / "made-up-terminal.xml", end)
    with EmulatedDevice(files / "made-up-adapter.eds", end) as device:
        device.set("999", 1, "uint8")
        with pytest.raises(Refused, match="999"):
            device.wait_up()


def test_the_cable_is_gone_after_the_test():
    with Cable() as cable:
        holders = [holder.pid for holder in cable._holders]
    for pid in holders:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_an_interface_that_is_not_there_is_named(fieldbus_end):
    assert fieldbus_end.interface == "fieldbus0"
    with pytest.raises(FileNotFoundError, match="nowhere9"):
        Interface("nowhere9")


INTERFACE_TEST = """
from skillbench_fieldbus import EmulatedDevice

def test_device(fieldbus_end):
    assert fieldbus_end.prefix == ()
    with EmulatedDevice({file!r}, fieldbus_end) as device:
        assert device.bus == "EtherNet/IP"
"""


def test_an_interface_of_this_machine_takes_the_place_of_a_cable(fieldbus_cable, files, tmp_path):
    (tmp_path / "test_interface.py").write_text(INTERFACE_TEST.format(file=str(files / "made-up-adapter.eds")), encoding="utf-8")
    end = fieldbus_cable.ends[1]
    pytest_here = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--fieldbus-interface", end.interface]
    done = subprocess.run([*end.prefix, *pytest_here, str(tmp_path / "test_interface.py")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
