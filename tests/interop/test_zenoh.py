"""Programs of zenoh-ros2-sdk and pyzeros exchange calls and messages with taskrpc over Zenoh."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import srvgen
import taskrpc
from taskrpc.core.system.file_locks import locked

pytest.importorskip("zenoh_ros2_sdk")
pytest.importorskip("pyzeros")

from tests.core.transport.helpers import until

pytestmark = pytest.mark.real_time

SetBool = srvgen.load("std_srvs/srv/SetBool")
String = srvgen.load("std_msgs/msg/String")
PROGRAMS = {"the SDK": "zenoh_sdk_program.py", "pyzeros": "pyzeros_program.py"}


@pytest.fixture(params=PROGRAMS)
def other(request):
    """The name of the implementation that is not taskrpc."""
    return request.param


@pytest.fixture
async def node(zenoh_router):
    async with taskrpc.Node("here", transport="zenoh", peers=[zenoh_router]) as node:
        yield node


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """The working folder of the programs, with the compiled code of pyzeros.

    The compiler needs ten seconds, and minutes on a busy machine. So it runs once for all processes
    of pytest, before the time limit of a test begins, and does not optimise.
    """
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "zenoh"
    folder.mkdir(exist_ok=True)
    program = Path(__file__).parent / PROGRAMS["pyzeros"]
    with locked(folder / "compiling.lock"):
        ended = subprocess.run(
            [sys.executable, str(program), "compile"],
            cwd=folder,
            env={**os.environ, "CFLAGS": "-O0"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=900,
        )
    assert ended.returncode == 0, ended.stdout
    return folder


@pytest.fixture
async def run(zenoh_router, folder):
    """Starts a program of another implementation; returns its process."""
    port = zenoh_router.rpartition(":")[2]
    async with contextlib.AsyncExitStack() as stack:

        async def start(other, action, name):
            file = Path(__file__).parent / PROGRAMS[other]
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, str(file), port, action, name),
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.DEVNULL,
                cwd=folder,
            )

            async def end():
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()

            stack.push_async_callback(end)
            return process

        yield start


async def said(process):
    """The next line that a program prints as JSON."""
    while line := await process.stdout.readline():
        with contextlib.suppress(ValueError):
            return json.loads(line)
    raise AssertionError("the program has ended")


async def known(node, service):
    """Wait until the graph shows a service, of whatever type."""
    while not any(entry.offers(service) for entry in await node.graph()):
        await asyncio.sleep(0.02)


async def answers(client):
    """Call until the server answers: others see its token before they can reach it."""
    assert await client.wait_for_service(None)
    while True:
        try:
            return await client.call(SetBool.Request())
        except taskrpc.OutcomeUnknown:
            await asyncio.sleep(0.02)


async def test_a_taskrpc_client_calls_their_server(node, run, other):
    server = await run(other, "serve", "/foreign/set_bool")
    assert await said(server) == "ready"
    client = node.create_client(SetBool, "/foreign/set_bool")
    await answers(client)
    for flag in (True, False):
        response = await client.call(SetBool.Request(data=flag))
        assert response == SetBool.Response(success=flag, message=f"from {other}")
    many = [client.call_async(SetBool.Request(data=True)) for _ in range(50)]
    assert all(each.success for each in await asyncio.gather(*many))


async def test_their_client_calls_a_taskrpc_server(node, run, other):
    def answer(request, response):
        response.success, response.message = request.data, "from taskrpc"
        return response

    node.create_service(SetBool, "/set_bool", answer)
    client = await run(other, "call", "/set_bool")
    assert await said(client) == [True, "from taskrpc"]


async def test_calls_fail_at_once_when_their_server_ends(node, run, other):
    server = await run(other, "serve", "/foreign/set_bool")
    assert await said(server) == "ready"
    client = node.create_client(SetBool, "/foreign/set_bool")
    await answers(client)
    server.kill()
    await until(lambda: not client.service_is_ready())
    with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers /foreign/set_bool"):
        await client.call(SetBool.Request())


async def test_another_definition_is_refused_with_both_hashes(node, run, other):
    assert await said(await run(other, "serve", "/foreign/set_bool")) == "ready"
    changed = srvgen.define("std_srvs/srv/SetBool", "uint8 data\n---\nbool success\nstring message")
    client = node.create_client(changed, "/foreign/set_bool")
    await known(node, "/foreign/set_bool")
    with pytest.raises(taskrpc.TypeMismatch) as caught:
        await client.call(changed.Request())
    assert SetBool._HASH[:15] in str(caught.value)
    assert changed._HASH[:15] in str(caught.value)


async def test_a_taskrpc_subscription_gets_their_messages(node, run, other):
    got = []
    subscription = node.create_subscription(String, "/foreign/text", got.append)
    assert await said(await run(other, "publish", "/foreign/text")) == "ready"
    await until(lambda: len(got) >= 3)
    assert got[0] == String(data=f"from {other}")
    assert subscription.get_publisher_count() == 1


async def test_their_subscription_gets_messages_of_taskrpc(node, run, other):
    publisher = node.create_publisher(String, "/text")
    listener = await run(other, "listen", "/text")
    assert await said(listener) == "ready"
    await until(publisher.get_subscription_count)
    said_it = asyncio.create_task(said(listener))
    while not said_it.done():  # the SDK announces a subscription before it has it
        publisher.publish(String(data="from taskrpc"))
        await asyncio.wait({said_it}, timeout=0.2)
    assert await said_it == "from taskrpc"


async def test_their_nodes_services_and_topics_are_in_the_graph(node, run, other):
    await said(await run(other, "serve", "/foreign/set_bool"))
    await said(await run(other, "publish", "/foreign/text"))

    found, services, publishers = [], [], []
    # Each program shows its node before its service or publisher.
    while not (services and publishers):
        await asyncio.sleep(0.05)
        found = [each for each in await node.graph() if not each.address and not each.pid]
        services = [each for entry in found for each in entry.services]
        publishers = [each for entry in found for each in entry.publishers]
    assert [(each.name, each.type_name, each.type_hash) for each in services] == [
        ("/foreign/set_bool", "std_srvs/srv/SetBool", SetBool._HASH)
    ]
    assert [(each.name, each.type_name, each.type_hash) for each in publishers] == [
        ("/foreign/text", "std_msgs/msg/String", String._HASH)
    ]
    assert all(entry.nodes for entry in found)


async def test_the_sdk_discovers_services_and_topics_of_taskrpc(node, run):
    node.create_service(SetBool, "/set_bool", lambda request, response: response)
    node.create_publisher(String, "/text")
    found = await said(await run("the SDK", "discover", "-"))
    assert found["services"]["/set_bool"] == ["std_srvs/srv/SetBool"]
    assert found["topics"]["/text"] == ["std_msgs/msg/String"]
