"""The rosbridge clients of other projects: roslib in Node, roslibpy, and the tools of ros-mcp."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.markdown import read_page
from tests.javascript.packages import node_for, node_modules

FOLDER = Path(__file__).parent
GUIDE = Path(__file__).parents[2] / "docs" / "how-to" / "use-rosbridge.md"
LIMIT = 120.0
"""Seconds that a client may take; most of them are its imports."""
TALKER = """\
import sys

import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.declare_parameter("speed", 0.5)
        self.publisher = self.create_publisher(String, "talk", 10)


rclpy.init()
talker = Talker()
print("talker is ready", file=sys.stderr, flush=True)
try:
    rclpy.spin(talker)
except rclpy.executors.ExternalShutdownException:
    pass
"""
HANG = """\
import asyncio
import sys

import srvgen
import taskrpc


async def hang(request, response):
    print("called", file=sys.stderr, flush=True)
    await asyncio.sleep(600)


async def main():
    async with taskrpc.Node("hang") as node:
        node.create_service(srvgen.load("std_srvs/srv/Trigger"), "/hang", hang)
        print("hang is ready", file=sys.stderr, flush=True)
        await node.spin()


taskrpc.run(main())
"""

GATEWAYS = ["bridge", "server"]
"""`taskrpc bridge rosbridge`, and `taskrpc-server --web`."""


def started(command, ready):
    """Start a command of taskrpc; return it, and the rest of the line with the text `ready`."""
    process = subprocess.Popen([sys.executable, "-m", *command], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if ready in line:
            return process, line.partition(ready)[2].strip()
    pytest.fail(f"{command} has ended with {process.wait()}")


@pytest.fixture(scope="module")
def ports(tmp_path_factory):
    """The ports of both gateways, beside a task server and a ROS program with a parameter.

    `runtime` is the folder in which their programs find each other.
    """
    folder = tmp_path_factory.mktemp("rosbridge")
    (folder / "talker.py").write_text(TALKER, encoding="utf-8")
    processes = []
    with pytest.MonkeyPatch.context() as patch:
        for name in ("runtime", "state"):
            (folder / name).mkdir(mode=0o700)
        patch.setenv("XDG_RUNTIME_DIR", str(folder / "runtime"))
        patch.setenv("XDG_STATE_HOME", str(folder / "state"))
        try:
            options = ["--db", ":memory:", "--speed", "100", "--web", "127.0.0.1:0"]
            command = ["taskrpc.cli.robot.server.command_line", *options]
            server, url = started(command, "/metrics at http")
            processes.append(server)
            bridge = ["taskrpc", "bridge", "rosbridge", "--listen", "127.0.0.1:0"]
            process, place = started(bridge, "rosbridge at ws")
            processes.append(process)
            talker, _ = started(["taskrpc", "run", str(folder / "talker.py")], "talker is ready")
            processes.append(talker)
            yield {
                "server": url.rpartition(":")[2],
                "bridge": place.rpartition(":")[2],
                "runtime": str(folder / "runtime"),
            }
        finally:
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait(30)
                if process.stderr is not None:
                    process.stderr.close()


def output_of(*command):
    """Run a client and return the JSON in the last line of its output."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, cwd=FOLDER)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.strip().splitlines()[-1])


def check_names(found):
    """Check what a client found out about the network."""
    assert found["topicType"] == "geometry_msgs/msg/PoseStamped"
    assert found["topicsForType"] == ["/robot_task/pose"]
    assert {"/robot_task", "/rosapi/topics", "/talker/get_parameters"} <= set(found["services"])
    assert found["serviceType"] == "my_robot_interfaces/srv/RobotTask"
    assert found["servicesForType"] == ["/robot_task"]
    assert {"/task_server", "/talker", "/rosbridge_websocket"} <= set(found["nodes"])
    assert "/robot_task/list" in found["nodeServices"]
    assert "/talker:speed" in found["params"]
    assert found["request"]["typedefs"][0]["fieldnames"] == ["task_type", "target", "priority"]


def check_services(found):
    """Check the calls of a client, and the calls of its own service."""
    assert found["submitted"]["success"] is True
    assert found["submitted"]["message"].startswith("Task queued: move")
    assert "ServiceUnavailable: no server offers /nothing" in found["unknown"]
    assert found["sum"] == {"sum": 5}
    assert "the service failed" in found["failed"]
    assert "ServiceUnavailable" in found["gone"]


def check_actions(found):
    """Check the goals that roslib has sent, and those of its own action."""
    state, result, reports = found["goal"]
    assert (state, result["state"]) == ("done", "SUCCEEDED")
    assert reports > 0
    assert found["badGoal"][1].endswith("FieldError: priority: expected int32, got 'high' (str)")
    assert found["counted"] == ["done", {"sequence": [0, 1, 5]}, 1]
    assert "Action was aborted: GoalAborted: the goal failed" in found["failedGoal"][1]
    assert 'Action was canceled: {"sequence":[0]}' in found["cancelledGoal"][1]
    assert "no server offers /count_in_js" in found["goneAction"][1]


@pytest.mark.parametrize("gateway", GATEWAYS)
@pytest.mark.parametrize("package", ["roslib", "roslib-1"])
def test_roslib_in_node(ports, package, gateway):
    node, modules = node_for(package), node_modules()
    url = f"ws://127.0.0.1:{ports[gateway]}"
    found = output_of(node, str(FOLDER / "roslib_client.mjs"), str(modules), package, url)
    check_names(found)
    check_services(found)
    assert "/robot_task/pose" in found["topics"]["topics"]
    assert found["invalid"].startswith("FieldError: priority: expected int32")
    assert found["actions"] == ["/robot_task/execute"]
    if package == "roslib":
        check_actions(found)
    assert found["decoded"]["position"] == {"x": "float64", "y": "float64", "z": "float64"}
    assert found["chatter"] == ["one", "two", "Zürich ☃"]
    assert found["pose"]["header"]["frame_id"] == "map"
    assert found["parameter"] == 2


def test_script_of_the_guide_gives_the_output_that_the_guide_shows(ports, tmp_path):
    node = node_for("roslib")
    os.symlink(node_modules(), tmp_path / "node_modules")
    blocks = {block.file or block.text.split()[1]: block for block in read_page(GUIDE).blocks}
    script = tmp_path / "robot.mjs"
    script.write_text(blocks["robot.mjs"].text, encoding="utf-8")
    shown = blocks["node"].text.splitlines()[1:]
    place = {**os.environ, "XDG_RUNTIME_DIR": ports["runtime"]}
    speed = [sys.executable, "-m", "taskrpc", "param", "set", "/talker", "speed", "0.5"]
    subprocess.run(speed, check=True, env=place, timeout=LIMIT)  # other tests may have changed it
    command = [node, str(script), f"ws://127.0.0.1:{ports['bridge']}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert [process.stdout.readline().rstrip() for _ in shown] == shown
            call = [sys.executable, "-m", "taskrpc.cli.call", "/add_in_js", "a=2", "b=3"]
            done = subprocess.run(call, capture_output=True, text=True, timeout=LIMIT, env=place)
            assert "sum=5" in done.stdout, done.stderr
        finally:
            process.kill()


@pytest.mark.parametrize("transport", ["twisted", "asyncio"])
def test_roslibpy(ports, transport):
    script = str(FOLDER / "roslibpy_client.py")
    found = output_of(sys.executable, script, ports["bridge"], transport)
    check_names(found)
    check_services(found)
    assert "/robot_task/pose" in found["topics"]
    assert abs(found["late"]) < 30
    state, result, reports = found["goal"]
    assert (state, result["state"]) == ("SUCCEEDED", "SUCCEEDED")
    assert reports > 0
    assert found["badGoal"][:1] == found["noAction"][:1] == ["UNKNOWN"]
    assert found["badGoal"][1].startswith("FieldError: priority: expected int32")
    assert found["noAction"][1].startswith("ServiceUnavailable: no server offers /nothing")
    assert found["definition"]["typedefs"][0]["fieldnames"] == ["position", "orientation"]
    assert found["chatter"] == ["one", "two", "Zürich ☃"]
    assert found["parameter"] == 2


@pytest.mark.parametrize("transport", ["twisted", "asyncio"])
def test_roslibpy_gets_an_error_for_its_call_when_the_gateway_ends(
    tmp_path, transport, monkeypatch
):
    (tmp_path / "runtime").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    (tmp_path / "hang.py").write_text(HANG, encoding="utf-8")
    server, _ = started(["taskrpc", "run", str(tmp_path / "hang.py")], "hang is ready")
    command = ["taskrpc", "bridge", "rosbridge", "--listen", "127.0.0.1:0"]
    with server:
        gateway, place = started(command, "rosbridge at ws")
        with gateway:
            script = str(FOLDER / "roslibpy_ending.py")
            client = [sys.executable, script, place.rpartition(":")[2], transport, "/hang"]
            with subprocess.Popen(client, stdout=subprocess.PIPE, text=True) as calling:
                try:
                    assert server.stderr.readline() == "called\n"
                    gateway.terminate()
                    printed, _ = calling.communicate(timeout=LIMIT)
                finally:
                    for process in (calling, gateway, server):
                        process.kill()
    assert "OutcomeUnknown: the gateway ends; the call may have run" in printed


def test_tools_of_ros_mcp(ports, ros_mcp_python):
    found = output_of(ros_mcp_python, str(FOLDER / "ros_mcp_client.py"), ports["bridge"])
    assert "warning" not in found["connected"]
    assert "/robot_task/pose" in found["topics"]["topics"]
    assert found["topic"]["type"] == "geometry_msgs/msg/PoseStamped"
    assert found["topic"]["publishers"] == ["/task_server"]
    assert "/robot_task" in found["services"]["services"]
    assert found["service"]["type"] == "my_robot_interfaces/srv/RobotTask"
    assert "/task_server" in found["nodes"]["nodes"]
    assert "/robot_task" in found["node"]["services"]
    assert "geometry_msgs/Pose" in found["message"]["structure"]
    assert found["submitted"]["success"] is True
    assert found["submitted"]["result"]["message"].startswith("Task queued: move")
    assert found["unknown"]["success"] is False
    assert "no server offers /nothing" in found["unknown"]["error"]
    assert found["pose"]["msg"]["header"]["frame_id"] == "map"
    assert found["published"]["success"] is True
    assert "/talker:speed" in found["parameters"]["parameters"]
    assert found["set"]["successful"] is True
    assert found["parameter"]["value"] == "2.0"
    assert found["has"]["exists"] is True
