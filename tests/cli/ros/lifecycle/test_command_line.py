"""`taskrpc lifecycle` prints what `ros2 lifecycle` prints, for a program written for rclpy."""

import os
import subprocess
import sys

import pytest

from taskrpc.cli.main import main

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

PROGRAM = """
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node


class Lidar(LifecycleNode):
    def on_cleanup(self, state):
        return TransitionCallbackReturn.FAILURE


rclpy.init()
executor = SingleThreadedExecutor()
for node in (Lidar("lidar"), LifecycleNode("_hidden"), Node("plain")):
    executor.add_node(node)
print("up", flush=True)
executor.spin()
"""

UNKNOWN = "Unknown transition requested, available ones are:\n- configure [1]\n- shutdown [5]\n"


@pytest.fixture
def lifecycle(tmp_path, monkeypatch, capsys):
    runtime = tmp_path / "run"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    (tmp_path / "lidar.py").write_text(PROGRAM)
    process = subprocess.Popen(
        [sys.executable, "-m", "taskrpc", "run", "lidar.py"],
        cwd=tmp_path,
        env=dict(os.environ),
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "up\n"

    def lifecycle(*arguments):
        code = main(["lifecycle", *arguments])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    yield lifecycle
    process.kill()
    process.wait()
    process.stdout.close()


def test_nodes_lists_only_lifecycle_nodes_and_hidden_ones_on_request(lifecycle):
    assert lifecycle("nodes") == (0, "/lidar\n", "")
    assert lifecycle("nodes", "-a") == (0, "/_hidden\n/lidar\n", "")
    assert lifecycle("nodes", "-c") == (0, "1\n", "")
    assert lifecycle("nodes", "-a", "-c") == (0, "2\n", "")


def test_a_node_is_followed_through_its_states(lifecycle):
    steps = [
        ("unconfigured [1]", "configure"),
        ("inactive [2]", "3"),
        ("active [3]", "deactivate"),
        ("inactive [2]", "shutdown"),
        ("finalized [4]", ""),
    ]
    for state, transition in steps:
        assert lifecycle("get", "lidar") == (0, f"{state}\n", "")
        if transition:
            assert lifecycle("set", "/lidar", transition) == (0, "Transitioning successful\n", "")
    assert lifecycle("get") == (0, "/lidar: finalized [4]\n", "")
    everything = "/_hidden: unconfigured [1]\n/lidar: finalized [4]\n"
    assert lifecycle("get", "-a", "--timeout", "10") == (0, everything, "")


def test_a_failed_transition_is_said_on_standard_error_and_exits_with_0_as_in_ros2(lifecycle):
    assert lifecycle("set", "/lidar", "configure") == (0, "Transitioning successful\n", "")
    assert lifecycle("set", "/lidar", "cleanup") == (0, "", "Transitioning failed\n")


def test_list_has_the_possible_transitions_or_all_with_start_and_goal(lifecycle):
    code, out, err = lifecycle("list", "lidar")
    assert (code, err) == (0, "")
    assert out == (
        "- configure [1]\n\tStart: unconfigured\n\tGoal: configuring\n"
        "- shutdown [5]\n\tStart: unconfigured\n\tGoal: shuttingdown\n"
    )
    everything = lifecycle("list", "lidar", "-a")[1].splitlines()
    assert everything[:4] == [*out.splitlines()[:3], "- transition_success [10]"]
    assert len(everything) == 3 * 25
    assert everything[-3:] == [
        "- transition_error [62]",
        "\tStart: errorprocessing",
        "\tGoal: finalized",
    ]


def test_wrong_names_exit_with_1_and_a_hint(lifecycle):
    assert lifecycle("set", "/lidar", "noop") == (1, "", UNKNOWN)
    wrong = "Node not found\n  hint: "
    assert lifecycle("get", "/lidor") == (1, "", f"{wrong}did you mean /lidar?\n")
    plain = "/plain runs, but it is not a lifecycle node\n"
    assert lifecycle("list", "plain") == (1, "", wrong + plain)
    hidden = "/_hidden is hidden; add --include-hidden-nodes\n"
    assert lifecycle("set", "/_hidden", "configure") == (1, "", wrong + hidden)
    shown = lifecycle("get", "--include-hidden-nodes", "/_hidden")
    assert shown == (0, "unconfigured [1]\n", "")
