"""`taskrpc bridge ros`: its options, and the running command over a transport in memory."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from importlib.util import find_spec

import pytest

import srvgen
import taskrpc
from taskrpc.cli import main
from taskrpc.cli.network.bridge import robot as gateway
from taskrpc.cli.shared import remote
from taskrpc.core.transport import shared_endpoint
from taskrpc.core.transport.shared_endpoint import Registration


@pytest.mark.parametrize(
    ("options", "status", "problem"),
    [
        ([], 2, "expected --allow NAME or --allow-topic NAME"),
        (["--allow", ""], 2, "argument --allow: expected a name such as /arm/open"),
        (["--allow", "/arm/*,/door"], 2, "'/arm/*', got '/arm/*,/door'"),
        (["--allow-topic", ""], 2, "argument --allow-topic: expected a name such as /arm/open"),
        (["--allow", "*", "--rate", "0"], 2, "argument --rate: expected a number above 0"),
        (["--allow", "*", "--in-flight", "0"], 2, "argument --in-flight: expected"),
        (["--allow", "*", "--transport", "pigeon"], 1, "transport: expected "),
        (["--allow", "*", "--token-file", "missing"], 1, "--token-file missing: "),
    ],
)
def test_mistake_in_the_options_of_the_robots_gateway_gives_one_message(
    options, status, problem, capsys
):
    assert main.main(["bridge", "ros", *options]) == status
    assert problem in capsys.readouterr().err


@pytest.mark.skipif(find_spec("rclpy") is not None, reason="a real rclpy is installed")
def test_gateway_without_ros_says_how_to_get_it(capsys):
    assert main.main(["bridge", "ros", "--allow", "*"]) == 1
    assert "needs the real rclpy of ROS 2" in capsys.readouterr().err


@pytest.mark.real_time
async def test_gateway_offers_the_services_of_the_robot_until_it_is_stopped(monkeypatch, capsys):
    memory = Registration("taskrpc.testing.memory_engine:open_network")
    monkeypatch.setitem(shared_endpoint.TRANSPORTS, "ros", memory)
    trigger = srvgen.load("std_srvs/srv/Trigger")
    stopped = asyncio.get_running_loop().create_future()

    @contextlib.asynccontextmanager
    async def stop_requested():
        yield stopped

    monkeypatch.setattr("taskrpc.program.stop_requested", stop_requested)
    options = main.parser_of("bridge").parse_args(
        ["bridge", "ros", "--allow", "/open", "--allow", "/shut", "--allow", "/dor"]
    )
    begun, ended = asyncio.Event(), asyncio.Event()

    async def shut(_, response):
        begun.set()
        await ended.wait()
        response.message = "shut"
        return response

    async with taskrpc.Node("robot", transport="ros", listen="robot") as robot:
        robot.create_service(trigger, "/open", lambda _, response: response)
        robot.create_service(trigger, "/shut", shut)
        serving = asyncio.create_task(gateway.serve(options, remote.remote_of(options)))
        async with taskrpc.Node("laptop") as laptop:
            client = laptop.create_client(trigger, "/open")
            assert await client.wait_for_service(20)
            assert await client.call(trigger.Request())
            health = laptop.create_client(trigger, "/taskrpc_gateway/health")
            found = await health.call(trigger.Request())
            calling = asyncio.create_task(
                laptop.create_client(trigger, "/shut").call(trigger.Request())
            )
            await begun.wait()
            stopped.set_result(signal.SIGTERM)
            printed = ""
            while "waiting for calls: 1 in flight, at most 10 s" not in printed:
                await asyncio.sleep(0.01)
                printed += capsys.readouterr().err
            ended.set()
            assert (await calling).message == "shut"
            assert await serving == signal.SIGTERM
    assert (
        "the robot has nothing yet that '/dor' allows; see what it has: `taskrpc service" in printed
    )
    assert "that '/open' allows" not in printed
    assert (found.success, found.message) == (True, "2 services of the robot")
    assert "taskrpc bridge ready: 2 services and 0 topics of the robot at 127.0.0.1:" in printed
