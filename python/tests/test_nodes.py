"""Both nodes of skillbench at the ends of a cable; every message is one of the schema."""

import subprocess
import sys
import textwrap

import jsonschema
import pytest

from skillbench_fieldbus import Cable, PlcNode, Refused, RobotNode, bench, control_schema
from skillbench_fieldbus.lines import ProgramLines


def check_messages(node, kind):
    schema = control_schema()
    validator = jsonschema.Draft202012Validator({"$ref": f"#/$defs/{kind}", "$defs": schema["$defs"]})
    for message in node.messages:
        validator.validate(message)
    assert node.messages


def test_the_sequence_runs_and_its_result_comes_back(short):
    with Cable(("192.168.64.1/24", "192.168.64.2/24")) as cable:
        options = ["--application", str(short)]
        with RobotNode("B", cable.ends[1], options=options) as robot, PlcNode("B", cable.ends[0], options=options) as plc:
            robot.wait_up()
            fast = plc.start("cm")
            slow = plc.start("cm", override="50")
            assert fast.motions == slow.motions == 7
            assert slow.seconds > fast.seconds > 0
            with pytest.raises(Refused, match="override"):
                plc.start("cm", override="nothing")
            assert plc.report()
            # The robot has had no instruction, and yet says what happens.
            plc.close()
            assert "Forward_Close" in robot.wait_down()
            check_messages(plc, "plc_message")
            check_messages(robot, "robot_message")


def test_a_node_that_runs_elsewhere_is_controlled_over_tcp(short):
    with Cable() as cable:
        options = ["--application", str(short)]
        with RobotNode("B", cable.ends[1], options=options) as robot:
            start = [*cable.ends[0].prefix, bench(), "__plc-node", "run", "--interface", cable.ends[0].interface, "--setup", "B"]
            with ProgramLines([*start, *options, "--control", "127.0.0.1:7700"]) as plc:
                plc.wait_for(lambda line: "127.0.0.1:7700" in line["text"], "control port")
                program = """
                    from skillbench_fieldbus import PlcNode
                    with PlcNode.connect("127.0.0.1", 7700) as plc:
                        print(plc.start("rc").motions)
                """
                command = [*cable.ends[0].prefix, sys.executable, "-c", textwrap.dedent(program)]
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                assert done.stdout == "7\n", done.stderr
            robot.wait_down()
