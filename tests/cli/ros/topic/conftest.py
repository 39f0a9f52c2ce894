"""A program that publishes topics, and the command, for the tests of this folder."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import srvgen
from taskrpc.cli.main import main

String = srvgen.load("std_msgs/msg/String")
Pose = srvgen.load("geometry_msgs/msg/PoseStamped")
TALKER = """
import sys
import srvgen, taskrpc
from taskrpc import QoS
String = srvgen.load("std_msgs/msg/String")
Pose = srvgen.load("geometry_msgs/msg/PoseStamped")
import asyncio
async def main():
    async with taskrpc.Node("talker", namespace="/lab") as node:
        chatter = node.create_publisher(String, "/chatter")
        pose = node.create_publisher(Pose, "/pose", QoS(5, "best_effort"))
        node.create_publisher(String, "/_hidden")
        node.create_subscription(String, "/heard", lambda message: print(message.data, flush=True))
        state = node.create_publisher(String, "/state", QoS(1, durability="transient_local"))
        state.publish(String(data="ready"))
        where = Pose()
        where.pose.position.x = 1.5
        count = 0
        def tick():
            nonlocal count
            count += 1
            chatter.publish(String(data=f"Hello: {count}"))
            pose.publish(where)
        node.create_timer(0.02, tick)
        print("up", flush=True)
        await node.spin()
taskrpc.run(main())
"""


@pytest.fixture(scope="session")
def _runtime(tmp_path_factory):
    return tmp_path_factory.mktemp("runtime")


@pytest.fixture(scope="session")
def _talker(_runtime):
    """One program for all tests of this folder, in a runtime folder of its own."""

    _runtime.chmod(0o700)
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(_runtime)}
    environment.pop("ROS_DOMAIN_ID", None)
    with subprocess.Popen(
        [sys.executable, "-c", TALKER], env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "up\n"
        yield process
        process.terminate()


@pytest.fixture
def talker(_talker, _runtime, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(_runtime))
    return _talker


@pytest.fixture
def run(capsys):
    """Runs `taskrpc topic …` in this process: exit code, stdout, stderr."""

    def _run(*argv):
        code = main(("topic", *argv))
        out, err = capsys.readouterr()
        return code, out, err

    return _run


real_time = pytest.mark.real_time
