"""`taskrpc param` prints what `ros2 param` prints, for a program written for rclpy."""

import os
import subprocess
import sys

import pytest

from taskrpc.cli.main import main

pytestmark = pytest.mark.real_time

PROGRAM = """
import rclpy.executors
from rclpy.node import Node
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor

rclpy.init()
node = Node("talker")
node.declare_parameter("name", "bob")
node.declare_parameter("speed", 1.5, ParameterDescriptor(description="m/s"))
within = IntegerRange(from_value=0, to_value=10, step=1)
node.declare_parameter("count", 5, ParameterDescriptor(integer_range=[within]))
node.declare_parameter("some.list", [1, 2, 3])
node.declare_parameter("fixed", True, ParameterDescriptor(read_only=True))
hidden = Node("_hidden")
hidden.declare_parameter("name", "hal")
print("up", flush=True)
executor = rclpy.executors.SingleThreadedExecutor()
executor.add_node(node)
executor.add_node(hidden)
executor.spin()
"""


@pytest.fixture(scope="module")
def talker(tmp_path_factory):
    folder = tmp_path_factory.mktemp("talker")
    runtime = folder / "run"
    runtime.mkdir(mode=0o700)
    (folder / "talker.py").write_text(PROGRAM)
    process = subprocess.Popen(
        [sys.executable, "-m", "taskrpc", "run", "talker.py"],
        cwd=folder,
        env={**os.environ, "XDG_RUNTIME_DIR": str(runtime)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "up\n"
    yield runtime
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.fixture
def param(talker, monkeypatch, capsys):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(talker))

    def param(*arguments):
        code = main(["param", *arguments])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return param


def test_list_has_a_nodes_parameters_indented(param):
    names = (
        "  count\n  fixed\n  name\n  some.list\n  speed\n"
        "  start_type_description_service\n  use_sim_time\n"
    )
    assert param("list") == (0, f"/talker:\n{names}", "")
    assert param("list", "/talker") == (0, names, "")
    assert param("list", "talker", "--filter", "^na") == (0, "  name\n", "")
    assert param("list", "/talker", "--param-prefixes", "some", "--param-type") == (
        0,
        "  some.list (type: integer array)\n",
        "",
    )


def test_get_prints_the_type_of_the_value(param):
    assert param("get", "/talker", "name") == (0, "String value is: bob\n", "")
    assert param("get", "/talker", "some.list") == (0, "Integer values are: [1, 2, 3]\n", "")
    assert param("get", "/talker", "count", "--hide-type") == (0, "5\n", "")
    assert param("get", "/talker", "nam") == (
        1,
        "",
        "Parameter not set.\n  hint: did you mean name?\n",
    )


def test_set_prints_the_result_and_the_reason(param):
    assert param("set", "/talker", "speed", "2.5") == (0, "Set parameter successful\n", "")
    assert param("get", "/talker", "speed") == (0, "Double value is: 2.5\n", "")
    code, out, err = param("set", "/talker", "count", "11")
    assert (code, out) == (1, "")
    assert err.startswith("Setting parameter failed: Parameter count out of range.")


def test_set_of_several_prints_one_result_each_or_one_for_all(param):
    code, out, err = param("set", "/talker", "speed", "-3.5", "count", "11", "name", "eve")
    assert code == 1
    assert out == "speed: Set parameter successful\nname: Set parameter successful\n"
    assert err.startswith("count: Setting parameter failed: Parameter count out of range.")
    assert param("get", "/talker", "speed")[1] == "Double value is: -3.5\n"
    code, out, err = param("set", "/talker", "--atomic", "name", "bob", "count", "11")
    assert (code, out) == (1, "")
    assert err.startswith("Setting parameters atomically failed: Parameter count out of range.")
    assert param("get", "/talker", "name")[1] == "String value is: eve\n"
    together = ("set", "/talker", "--atomic", "name", "bob", "speed", "2.5")
    assert param(*together) == (0, "Set parameters atomically successful\n", "")
    code, _, err = param("set", "/talker", "name")
    assert code == 2
    assert err.endswith("name value [name value ...]. Got 1 argument(s).\n")


def test_describe_prints_description_and_constraints(param):
    assert param("describe", "/talker", "count", "speed", "fixed") == (
        0,
        "Parameter name: count\n  Type: integer\n"
        "  Constraints:\n    Min value: 0\n    Max value: 10\n    Step: 1\n"
        "Parameter name: speed\n  Type: double\n  Description: m/s\n  Constraints:\n"
        "Parameter name: fixed\n  Type: boolean\n  Constraints:\n    Read only: true\n",
        "",
    )


def test_dumped_parameters_can_be_loaded(param, tmp_path):
    code, out, _ = param("dump", "/talker")
    assert code == 0
    assert out.startswith("/talker:\n  ros__parameters:\n    count: 5\n    fixed: true\n")
    assert out.endswith("    use_sim_time: false\n\n")
    file = tmp_path / "talker.yaml"
    fixed = ("fixed", "start_type")
    lines = [line for line in out.splitlines(True) if not line.strip().startswith(fixed)]
    file.write_text("".join(lines).replace("name: bob", "name: alice"))
    code, out, err = param("load", "/talker", str(file))
    assert (code, err) == (0, "")
    assert "Set parameter name successful\n" in out
    assert param("get", "/talker", "name")[1] == "String value is: alice\n"
    assert param("set", "/talker", "name", "bob")[0] == 0


def test_delete_fails_if_the_node_refuses(param):
    code, out, err = param("delete", "/talker", "name")
    assert (code, out) == (1, "")
    assert err.startswith("Deleting parameter failed: ")


def test_describe_of_an_unknown_parameter_is_an_error(param):
    assert param("describe", "/talker", "count", "nam") == (
        1,
        "",
        "Unknown parameter 'nam' of /talker\n  hint: did you mean name?\n",
    )


def test_an_expression_matches_from_the_beginning(param):
    assert param("list", "--filter", "ame") == (0, "", "")
    assert param("list", "--filter", "n.me") == (0, "/talker:\n  name\n", "")
    code, _, err = param("list", "--filter", "(")
    assert code == 2
    assert "expected a regular expression, got '('" in err


@pytest.mark.parametrize("arguments", [("list", "/talkr"), ("get", "/talkr", "name")])
def test_unknown_node_is_an_error_with_a_suggestion(param, arguments):
    assert param(*arguments) == (1, "", "Node not found\n  hint: did you mean /talker?\n")


def test_invalid_yaml_file_is_one_line(param, tmp_path):
    file = tmp_path / "talker.yaml"
    file.write_text("$ ros2 param dump /talker\n/talker:\n  ros__parameters:\n")
    code, out, err = param("load", "/talker", str(file))
    assert (code, out) == (1, "")
    assert err.startswith(f"{file} is not valid YAML: mapping values are not allowed here in ")
    assert err.count("\n") == 1


def test_timeout_waits_for_a_node(param):
    code, _, err = param("get", "/nobody", "x", "--timeout", "0.2")
    assert (code, err) == (1, "Node not found\n")


def test_missing_file_is_one_line(param):
    assert param("load", "/talker", "nowhere.yaml") == (
        1,
        "",
        "cannot read nowhere.yaml: No such file or directory\n",
    )


def test_a_hidden_node_is_found_with_the_option_only(param):
    refused = "Node not found\n  hint: /_hidden is hidden; add --include-hidden-nodes\n"
    option = "--include-hidden-nodes"
    assert param("get", "/_hidden", "name") == (1, "", refused)
    assert param("list", "/_hidden") == (1, "", refused)
    assert param("get", "/_hidden", "name", option) == (0, "String value is: hal\n", "")
    assert "  name\n" in param("list", "/_hidden", option)[1]
    assert "/_hidden" not in param("list")[1]
    assert "/_hidden:\n" in param("list", option)[1]
