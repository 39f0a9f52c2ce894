"""taskrpc on the real rclpy, with plain ROS programs as peers; `tests/interop/test_ros.py` runs it.

Each test has a ROS domain of its own.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

import srvgen
import taskrpc
from taskrpc.errors import (
    DeadlineExceeded,
    OutcomeUnknown,
    PermissionDenied,
    ServerBusy,
    ServiceUnavailable,
    TypeMismatch,
)
from tests.ros_domains import own_domains

pytestmark = [pytest.mark.real_time, pytest.mark.filterwarnings("ignore::DeprecationWarning")]

ROOT = Path(__file__).parents[3]
PEER = Path(__file__).parent / "peer.py"
Trigger = srvgen.load("std_srvs/srv/Trigger")
SetBool = srvgen.load("std_srvs/srv/SetBool")
String = srvgen.load("std_msgs/msg/String")
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
Fibonacci = srvgen.load("test_msgs/action/Fibonacci")


@pytest.fixture(autouse=True)
def _own_domain(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(next(own_domains())))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


@pytest.fixture
def start():
    """Return a function that starts a program; all are killed in the end."""
    with contextlib.ExitStack() as stack:

        def started(*command, until="", domain=None):
            environment = dict(os.environ, PYTHONUNBUFFERED="1")
            if domain is not None:
                environment["ROS_DOMAIN_ID"] = str(domain)
            process = subprocess.Popen(
                [sys.executable, *map(str, command)],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                env=environment,
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            seen = []
            while until:
                line = process.stdout.readline()
                seen.append(line)
                assert line, "".join(seen)
                if until in line:
                    break
            return process

        yield started


@pytest.fixture
def peer(start):
    """Return a function that starts a plain ROS program, and waits until it is ready."""
    return lambda *arguments, **options: start(PEER, *arguments, until="ready", **options)


async def output(*arguments):
    """Run a plain ROS program to its end; return what it printed."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, str(PEER), *arguments, stdout=asyncio.subprocess.PIPE
    )
    printed, _ = await process.communicate()
    return printed.decode().splitlines()


async def node(stack, name="ours", **options):
    return await stack.enter_async_context(taskrpc.Node(name, transport="ros", **options))


@pytest.fixture
async def stack():
    async with contextlib.AsyncExitStack() as stack:
        yield stack


def hello(_, response):
    response.success, response.message = True, "hello from taskrpc"
    return response


async def test_ros_client_calls_our_service(stack):
    ours = await node(stack)
    ours.create_service(Trigger, "/hello", hello)
    assert "True hello from taskrpc" in await output("call", "/hello", "1")


async def test_ros_client_gets_the_fields_of_its_request_back(stack):
    ours = await node(stack)

    def invert(request, response):
        response.success, response.message = not request.data, "äöü 漢"
        return response

    ours.create_service(SetBool, "/invert", invert)
    lines = await output("invert", "/invert")
    assert "success=False, message='äöü 漢'" in lines[0]
    assert "success=True" in lines[1]


async def test_our_service_runs_several_requests_of_ros_at_a_time(stack):
    ours = await node(stack)

    async def slow(_, response):
        await asyncio.sleep(0.5)
        return hello(_, response)

    ours.create_service(Trigger, "/hello", slow, concurrency=8)
    *responses, seconds = await output("call", "/hello", "8")
    assert responses == ["True hello from taskrpc"] * 8
    assert float(seconds.split()[1]) < 8 * 0.5


async def test_error_of_our_callback_reaches_ros_as_success_false(stack):
    ours = await node(stack)

    def refuse(_, response):
        raise taskrpc.HandlerError("NOT_FOUND", "no such door")

    ours.create_service(Trigger, "/door", refuse)
    assert "False no such door" in await output("call", "/door", "1")


async def test_we_call_a_service_of_ros(stack, peer):
    peer("serve")
    ours = await node(stack)
    client = ours.create_client(Trigger, "/ros_hello")
    assert await client.wait_for_service(10)
    response = await client.call(Trigger.Request())
    assert (response.success, response.message) == (True, "hello from ROS")
    inverted = ours.create_client(SetBool, "/ros_invert")
    results = await asyncio.gather(
        *(inverted.call(SetBool.Request(data=bool(i % 2)), timeout=20) for i in range(50))
    )
    assert [each.success for each in results] == [not i % 2 for i in range(50)]


async def test_call_to_ros_ends_at_its_deadline(stack, peer):
    peer("serve")
    ours = await node(stack)
    client = ours.create_client(Trigger, "/ros_slow")
    assert await client.wait_for_service(10)
    with pytest.raises(DeadlineExceeded):
        await client.call(Trigger.Request(), timeout=0.5)
    task = asyncio.create_task(client.call(Trigger.Request()))
    await asyncio.sleep(0.1)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    response = await ours.create_client(Trigger, "/ros_hello").call(Trigger.Request(), timeout=20)
    assert response.success


async def test_call_ends_when_the_ros_server_leaves(stack, peer):
    peer("serve")
    ours = await node(stack)
    client = ours.create_client(Trigger, "/ros_leave")
    assert await client.wait_for_service(10)
    began = time.monotonic()
    with pytest.raises(OutcomeUnknown):
        await client.call(Trigger.Request(), timeout=20)
    assert time.monotonic() - began < 15
    with pytest.raises(ServiceUnavailable):
        await client.call(Trigger.Request())


async def test_other_definition_of_a_ros_service_gives_both_hashes(stack, peer):
    peer("serve")
    ours = await node(stack)
    other = srvgen.define("std_srvs/srv/Trigger", "int32 door\n---\nbool success\n")
    right = ours.create_client(Trigger, "/ros_hello")
    assert await right.wait_for_service(10)
    client = ours.create_client(other, "/ros_hello")
    with pytest.raises(TypeMismatch) as caught:
        await client.call(other.Request())
    assert other._HASH[:15] in str(caught.value)
    assert Trigger._HASH[:15] in str(caught.value)


async def test_service_with_another_definition_is_not_offered_to_ros(stack, caplog):
    ours = await node(stack)
    other = srvgen.define("std_srvs/srv/Trigger", "int32 door\n---\nbool success\n")
    ours.create_service(other, "/door", lambda _, response: response)
    assert "ROS programs cannot call /door" in caplog.text
    assert other._HASH in caplog.text
    assert Trigger._HASH in caplog.text


async def test_package_that_ros_has_not_built_works_between_taskrpc_programs(stack, caplog):
    server, client = await node(stack), await node(stack, "other", listen="127.0.0.1:0")

    def add(request, response):
        response.sum = request.a + request.b
        return response

    server.create_service(AddTwoInts, "/add", add)
    assert "ROS has not built the package example_interfaces" in caplog.text
    assert "install it: apt install ros-" in caplog.text
    adding = client.create_client(AddTwoInts, "/add")
    assert await adding.wait_for_service(10)
    assert (await adding.call(AddTwoInts.Request(a=1, b=2))).sum == 3


async def test_call_made_at_once_waits_until_dds_finds_the_server(stack, peer, monkeypatch):
    monkeypatch.setattr("taskrpc.middleware.ros.ros_engine.SETTLE", 0.0)
    monkeypatch.setattr("taskrpc.middleware.ros.ros_engine.SETTLE_ALONE", 0.0)
    peer("serve")
    client = (await node(stack)).create_client(Trigger, "/ros_hello")
    assert not client.service_is_ready()
    assert (await client.call(Trigger.Request())).message == "hello from ROS"


async def test_topics_flow_both_ways(stack, peer):
    peer("talk", "/from_ros", "volatile")
    ours = await node(stack)
    got = asyncio.Queue()
    ours.create_subscription(String, "/from_ros", got.put_nowait)
    async with asyncio.timeout(10):
        assert (await got.get()).data.startswith("number")
    publisher = ours.create_publisher(String, "/from_us")
    listening = asyncio.create_task(output("listen", "/from_us", "3"))
    while publisher.get_subscription_count() == 0:
        await asyncio.sleep(0.05)
    for text in ("one", "two", "drei ä"):
        publisher.publish(String(data=text))
    async with asyncio.timeout(10):
        assert (await listening)[1:] == ["one", "two", "drei ä"]


async def test_latched_message_of_ros_arrives_later(stack, peer):
    peer("talk", "/map", "latched")
    ours = await node(stack)
    got = asyncio.Queue()
    ours.create_subscription(
        String, "/map", got.put_nowait, taskrpc.QoS(durability="transient_local")
    )
    async with asyncio.timeout(10):
        assert (await got.get()).data == "first"


async def test_mismatching_quality_of_service_is_reported(stack, peer):
    peer("talk", "/from_ros", "volatile")
    ours = await node(stack)
    reported = asyncio.Queue()
    qos = taskrpc.QoS(durability="transient_local")
    ours.create_subscription(
        String, "/from_ros", lambda _: None, qos, on_mismatch=reported.put_nowait
    )
    async with asyncio.timeout(10):
        assert await reported.get() == "DURABILITY"


async def test_each_side_sees_the_graph_of_the_other(stack, peer):
    peer("serve")
    ours = await node(stack, "arm", namespace="/robot")
    ours.create_service(Trigger, "hello", hello)
    ours.create_publisher(String, "/status")
    client = ours.create_client(Trigger, "/ros_hello")
    assert await client.wait_for_service(10)
    entries = [each for each in await ours.graph() if each.nodes == ("/ros_serve",)]
    services = {each.name: each for each in entries[0].services}
    assert services["/ros_hello"].type_name == "std_srvs/srv/Trigger"
    assert services["/ros_hello"].type_hash == Trigger._HASH
    lines = await output("graph", "arm", "ros_serve")
    assert "service /robot/hello std_srvs/srv/Trigger" in lines
    assert "topic /status std_msgs/msg/String" in lines
    # The hidden node of our program comes first.
    assert lines[0].split()[2:] == ["arm", "ros_graph", "ros_serve"]


async def test_programs_of_two_domains_do_not_see_each_other(stack, peer, monkeypatch):
    own = int(os.environ["ROS_DOMAIN_ID"])
    peer("serve", domain=own)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(next(own_domains())))
    there = await node(stack)
    assert not await there.create_client(Trigger, "/ros_hello").wait_for_service(2)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own))
    here = await node(stack, "here")
    assert await here.create_client(Trigger, "/ros_hello").wait_for_service(10)


async def test_killed_taskrpc_program_is_gone_after_some_seconds(stack, start, tmp_path):
    script = tmp_path / "server.py"
    script.write_text(
        "import asyncio, srvgen, taskrpc\n"
        "Trigger = srvgen.load('std_srvs/srv/Trigger')\n"
        "async def main():\n"
        "    async with taskrpc.Node('server', transport='ros') as node:\n"
        "        async def slow(request, response):\n"
        "            await asyncio.sleep(60)\n"
        "        node.create_service(Trigger, '/slow', slow)\n"
        "        print('ready')\n"
        "        await node.spin()\n"
        "asyncio.run(main())\n"
    )
    process = start(script, until="ready")
    ours = await node(stack)
    client = ours.create_client(Trigger, "/slow")
    assert await client.wait_for_service(10)
    calling = asyncio.create_task(client.call(Trigger.Request(), timeout=30))
    await asyncio.sleep(0.5)
    process.send_signal(signal.SIGKILL)
    killed = time.monotonic()
    with pytest.raises(OutcomeUnknown):
        await calling
    assert time.monotonic() - killed < 15  # 4 s on an idle machine; DDS itself needs 20 s


async def test_task_server_on_ros(stack, start, tmp_path):
    command = "from taskrpc.cli.robot.server.command_line import main; raise SystemExit(main())"
    start("-c", command, "--transport", "ros", "--db", ":memory:", until="taskrpc-server ready")
    assert any(line.startswith("True") for line in await output("call", "/robot_task/health", "1"))
    calling = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        "from taskrpc.cli.call import main; raise SystemExit(main())",
        "--transport",
        "ros",
        "/robot_task",
        "task_type=move",
        "target=warehouse",
        "priority=8",
        "--json",
        stdout=asyncio.subprocess.PIPE,
    )
    printed, _ = await calling.communicate()
    assert json.loads(printed)["message"] == "Task queued: move"


def program_of(name):
    """Return a program of the how-to page."""
    page = (ROOT / "docs" / "how-to" / "run-on-a-ros-2-robot.md").read_text(encoding="utf-8")
    return re.search(rf"^`{name}`\n.*?^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)[1]


async def test_programs_of_the_page_work(start, tmp_path):
    for name in ("door.py", "visitor.py"):
        (tmp_path / name).write_text(program_of(name))
    start(tmp_path / "door.py", until="ready")
    assert "True std_srvs.srv.SetBool_Response(success=True, message='open')" in await output(
        "invert", "/door"
    )
    visitor = await asyncio.to_thread(
        subprocess.run,
        [sys.executable, tmp_path / "visitor.py"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (visitor.stdout, visitor.stderr) == ("open\n", "")


async def test_laptop_calls_the_robot_through_the_gateway(start, peer, monkeypatch):
    peer("serve")
    gateway = start(
        "-m", "taskrpc", "bridge", "ros", "--allow", "/ros_*", "--allow-topic", "/chat",
        until="ready",
    )  # fmt: skip
    assert gateway.poll() is None
    async with taskrpc.Node("laptop") as laptop:
        client = laptop.create_client(Trigger, "/ros_hello")
        assert await client.wait_for_service(10)
        assert (await client.call(Trigger.Request())).message == "hello from ROS"
        assert not laptop.create_client(Trigger, "/ros_serve/get_parameters").service_is_ready()
        peer("talk", "/chat", "volatile")
        got = asyncio.Queue()
        laptop.create_subscription(String, "/chat", got.put_nowait)
        async with asyncio.timeout(15):
            assert (await got.get()).data.startswith("number")


async def test_reliable_laptop_gets_the_messages_of_all_publishers(start, peer):
    for quality in ("volatile", "best_effort"):
        peer("talk", "/chat", quality)
    start("-m", "taskrpc", "bridge", "ros", "--allow-topic", "/chat", until="ready")
    async with taskrpc.Node("laptop") as laptop:
        got = asyncio.Queue()
        laptop.create_subscription(String, "/chat", got.put_nowait)
        found = set()
        async with asyncio.timeout(20):
            while found < {"number", "best_effort"}:
                found.add((await got.get()).data.split()[0])


async def test_class_calls_the_robot_through_a_gateway_with_tls_and_accounts(
    start, peer, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "names.txt").write_text("ada\ngrace\n")
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        place = f"127.0.0.1:{reserved.getsockname()[1]}"
    classroom = [sys.executable, "-m", "taskrpc", "classroom", "--address", "127.0.0.1"]
    students = ["--students", str(tmp_path / "names.txt")]
    subprocess.run([*classroom, *students], check=True, timeout=60, capture_output=True)
    folder = tmp_path / "taskrpc" / "classroom"
    accounts = json.loads((folder / "accounts.json").read_text())
    accounts["accounts"]["grace"]["role"] = "observe"
    (folder / "accounts.json").write_text(json.dumps(accounts))
    bridge = ["-m", "taskrpc", "bridge", "ros", "--listen", place, "--timeout", "2", "--rate", "5"]
    bridge += ["--tls-cert", folder / "server.pem", "--tls-key", folder / "server.key"]
    bridge += ["--accounts", folder / "accounts.json"]
    for name in ("/ros_hello", "/ros_slow", "/ros_leave"):
        bridge += ["--allow", name]
    peer("serve")

    async def laptop(stack, account):
        return await stack.enter_async_context(
            taskrpc.Node(
                account,
                peers=[place],
                tls=taskrpc.Tls(ca=folder / "ca.pem"),
                token=f"{account}.{accounts['accounts'][account]['secret']}",
            )
        )

    gateway = start(*bridge, until="ready")
    async with contextlib.AsyncExitStack() as stack:
        ada, grace = await laptop(stack, "ada"), await laptop(stack, "grace")
        hello = ada.create_client(Trigger, "/ros_hello")
        assert await hello.wait_for_service(20)
        assert (await hello.call(Trigger.Request())).message == "hello from ROS"
        with pytest.raises(ServiceUnavailable):
            await ada.create_client(SetBool, "/ros_invert").call(SetBool.Request())
        with pytest.raises(PermissionDenied, match="the account grace has observe"):
            await grace.create_client(Trigger, "/ros_hello").call(Trigger.Request())
        calls = [hello.call(Trigger.Request()) for _ in range(9)]
        ended = await asyncio.gather(*calls, return_exceptions=True)
        refused = [each for each in ended if isinstance(each, ServerBusy)]
        assert "at most 5 calls per second of one account" in str(refused[0])
        await asyncio.sleep(1)
        with pytest.raises(DeadlineExceeded, match="2 s, which is the gateway's --timeout"):
            await ada.create_client(Trigger, "/ros_slow").call(Trigger.Request())
        gateway.kill()
        gateway.wait()
        while hello.service_is_ready():
            await asyncio.sleep(0.05)
        bridge[bridge.index("--timeout") + 1] = "20"  # the first call may wait for DDS's discovery
        start(*bridge, until="ready")
        assert await hello.wait_for_service(20)
        assert (await hello.call(Trigger.Request(), timeout=20)).message == "hello from ROS"
        with pytest.raises(OutcomeUnknown):
            await ada.create_client(Trigger, "/ros_leave").call(Trigger.Request(), timeout=20)


def test_taskrpc_run_explains_that_its_rclpy_is_not_the_real_one(tmp_path):
    script = tmp_path / "node.py"
    script.write_text(
        "import asyncio, taskrpc\n"
        "async def main():\n"
        "    async with taskrpc.Node('x', transport='ros'): pass\n"
        "asyncio.run(main())\n"
    )
    ended = subprocess.run(
        [sys.executable, "-m", "taskrpc", "run", script], capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 1
    assert "here rclpy is taskrpc's own; start the program with python" in ended.stderr
    assert "Traceback" not in ended.stderr


UNCLOSED = """
import asyncio, time, taskrpc

class Late:
    def __del__(self):
        time.sleep(1.5)  # rclpy returns from its wait while Python ends

late, nodes = Late(), []

async def main():
    node = taskrpc.Node("unclosed", transport="ros")
    nodes.append(await node.__aenter__())

asyncio.run(main())
print("over")
"""


def test_program_that_does_not_close_its_node_ends_without_a_crash(tmp_path):
    script = tmp_path / "unclosed.py"
    script.write_text(UNCLOSED)
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stdout) == (0, "over\n"), ended.stderr


# Actions


async def fibonacci(goal):
    """Do what `peer.py serve_action` does."""
    sequence = [0, 1]
    for _ in range(goal.request.order):
        if goal.is_cancel_requested:
            return goal.canceled(Fibonacci.Result(sequence=sequence))
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback(Fibonacci.Feedback(sequence=sequence))
        await asyncio.sleep(0.1)
    if goal.request.order == 1:
        raise taskrpc.HandlerError("NOT_FOUND", "no such number")
    return Fibonacci.Result(sequence=sequence)


async def test_ros_client_sends_goals_to_our_action(stack):
    ours = await node(stack)
    accepts = {"goal": lambda goal: goal.order > 0}
    ours.create_action_server(Fibonacci, "/fibonacci", fibonacci, **accepts)
    lines = await output("act", "3")
    assert lines == ["status 4 sequence 0 1 1 2 3", "feedback 3 4 5"]
    assert await output("act", "0") == ["rejected"]
    assert (await output("act", "1"))[0] == "status 6 sequence"
    canceling, status, _ = await output("act", "100", "cancel")
    assert canceling == "canceling 1"
    assert status.startswith("status 5 sequence 0 1 1")


async def test_we_send_goals_to_an_action_of_ros(stack, peer):
    peer("serve_action")
    ours = await node(stack)
    client = ours.create_action_client(Fibonacci, "/fibonacci")
    assert await client.wait_for_server(10)
    handle = await client.send_goal(Fibonacci.Goal(order=3))
    assert [len(each.sequence) async for each in handle.feedback] == [3, 4, 5]
    assert list((await handle.result()).sequence) == [0, 1, 1, 2, 3]
    with pytest.raises(taskrpc.GoalRejected):
        await client.send_goal(Fibonacci.Goal(order=0))
    handle = await client.send_goal(Fibonacci.Goal(order=1))
    with pytest.raises(taskrpc.GoalAborted) as aborted:
        await handle.result(timeout=10)
    assert list(aborted.value.result.sequence) == [0, 1, 1]
    handle = await client.send_goal(Fibonacci.Goal(order=100))
    await anext(handle.feedback)
    assert await handle.cancel()
    with pytest.raises(taskrpc.GoalCanceled):
        await handle.result(timeout=10)


async def test_goals_of_a_ros_server_that_is_killed_fail(stack, peer):
    process = peer("serve_action")
    ours = await node(stack)
    client = ours.create_action_client(Fibonacci, "/fibonacci")
    assert await client.wait_for_server(10)
    handle = await client.send_goal(Fibonacci.Goal(order=500))
    await anext(handle.feedback)
    process.kill()  # after SIGTERM, rclpy sometimes executes the goal to its end
    with pytest.raises(OutcomeUnknown):
        await handle.result(timeout=60)  # DDS notices the death after 20 s
