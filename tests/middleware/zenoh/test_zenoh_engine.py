"""Programs over Zenoh: presence, interruptions, garbage; the contract suite tests the calls."""

from __future__ import annotations

import asyncio
import logging
import socket
import subprocess
import sys

import pytest

import taskrpc
from taskrpc.core.security.tls import Tls
from taskrpc.core.transport.tunnel.tunnel_network import TunnelNetwork
from taskrpc.middleware.zenoh import keys
from tests.core.transport.helpers import Add, Gate, add, ask, outcome, until
from tests.middleware.zenoh.helpers import open_router

pytestmark = pytest.mark.real_time


def program(name, place, **options):
    return taskrpc.Node(name, transport="zenoh", peers=[place], listen=name, **options)


def free_place():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"127.0.0.1:{free.getsockname()[1]}"


async def test_programs_that_are_there_are_known_when_a_node_has_started(zenoh_router):
    async with program("server", zenoh_router) as server:
        server.create_service(Add, "add", add)
        await asyncio.sleep(0)
        async with program("client", zenoh_router) as client:
            assert (await client.create_client(Add, "add").call(ask(1, 2))).sum == 3
            with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers /nobody"):
                await client.create_client(Add, "nobody").call(ask())


async def test_a_program_is_no_foreign_node_of_another(zenoh_router):
    async with program("server", zenoh_router) as server, program("client", zenoh_router) as client:
        server.create_service(Add, "add", add)
        assert await client.create_client(Add, "add").wait_for_service(10)
        entries = await client.graph()
        assert sorted(name for entry in entries for name in entry.nodes) == ["/client", "/server"]


async def test_domains_are_apart(zenoh_router, monkeypatch):
    async with program("server", zenoh_router) as server:
        server.create_service(Add, "add", add)
        await asyncio.sleep(0)
        monkeypatch.setenv("ROS_DOMAIN_ID", "7")
        async with program("client", zenoh_router) as client:
            with pytest.raises(taskrpc.ServiceUnavailable):
                await client.create_client(Add, "add").call(ask())


async def test_calls_fail_when_the_router_is_gone_and_work_again_when_it_is_back(caplog):
    place = free_place()
    router, gate = open_router(place), Gate()
    try:
        async with program("server", place) as server, program("client", place) as client:
            server.create_service(Add, "add", add)
            server.create_service(Add, "gate", gate)
            holding = client.create_client(Add, "gate")
            assert await holding.wait_for_service(20)
            held = holding.call_async(ask(), timeout=None)
            await until(lambda: gate.started)
            router.close()
            assert isinstance(await outcome(held), taskrpc.OutcomeUnknown)
            calling = client.create_client(Add, "add")
            await until(lambda: not calling.service_is_ready())
            with pytest.raises(taskrpc.ServiceUnavailable):
                await calling.call(ask())
            await until(lambda: "Zenoh is interrupted: the connection to the" in caplog.text)
            router = open_router(place)
            assert await calling.wait_for_service(20)
            assert (await calling.call(ask(1, 2))).sum == 3
    finally:
        router.close()


async def test_programs_are_found_again_if_the_router_was_there_all_the_time(zenoh_router):
    async with program("server", zenoh_router) as server, program("client", zenoh_router) as client:
        server.create_service(Add, "add", add)
        calling = client.create_client(Add, "add")
        assert await calling.wait_for_service(20)
        network = client._transport.network
        network._engine._interrupt()
        assert not network.locate("/add")
        await until(lambda: network.locate("/add"))
        assert await calling.wait_for_service(20)
        assert (await calling.call(ask(1, 2))).sum == 3


async def test_a_node_without_a_router_does_not_start():
    with pytest.raises(taskrpc.TaskRpcError, match="no Zenoh router answers"):
        async with program("client", "127.0.0.1:9"):
            pass


def test_certificates_are_refused_with_what_to_do_instead():
    async def start():
        async with program("client", "127.0.0.1:9", tls=Tls(ca="ca.pem")):
            pass

    with pytest.raises(taskrpc.TaskRpcError, match="takes no certificates with tls="):
        asyncio.run(start())


async def test_garbage_on_the_keys_of_programs_does_no_harm(node, foreign, caplog):
    node.create_service(Add, "add", add)
    await asyncio.sleep(0)
    session, place = foreign.session, node._transport.network._engine.address
    for data in (b"", b"garbage", bytes(100), b"\x11" + bytes(40)):
        session.put(keys.inbox_key(0, place), data)
        session.put(keys.entry_key(0, "abc"), data)
        session.put(keys.entry_key(0, "ABC"), data)
    for key in (keys.alive_key(0, "NO-PLACE"), keys.alive_key(0, "abc"), "@ros2_lv/0/what/is/this"):
        foreign.declared.append(session.liveliness().declare_token(key))
    await until(lambda: "ignored the program at abc" in caplog.text)
    assert "was not handled" not in caplog.text
    assert (await node.create_client(Add, "add").call(ask(1, 2))).sum == 3


async def test_nothing_is_sent_to_a_place_with_wildcards(node, foreign):
    got = []
    foreign.declared.append(
        foreign.session.declare_subscriber("taskrpc/0/inbox/*", lambda sample: got.append(1))
    )
    await asyncio.sleep(0.05)
    engine = node._transport.network._engine
    for place in ("*", "**", "../0/inbox/abc", ""):
        engine.send(place, b"datagram")
    engine.send("abc", b"datagram")
    await until(lambda: got)
    assert got == [1]


async def test_a_program_with_a_token_has_no_native_services(zenoh_router, foreign):
    async with program("server", zenoh_router, token="secret") as server:
        server.create_service(Add, "add", add)
        async with program("client", zenoh_router, token="secret") as client:
            assert (await client.create_client(Add, "add").call(ask(1, 2))).sum == 3
        assert foreign.ask("/add", Add, b"") == []


def test_taskrpc_loads_zenoh_only_for_a_node_that_uses_it():
    code = "import sys, taskrpc; taskrpc.Node('a'); sys.exit('zenoh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


async def test_the_log_tells_when_a_router_is_back(caplog):
    from taskrpc.core.transport.settings import Settings
    from taskrpc.middleware.zenoh.configuration import configuration_of
    from taskrpc.middleware.zenoh.zenoh_engine import ZenohEngine

    caplog.set_level(logging.WARNING)
    network = TunnelNetwork(ZenohEngine(0, configuration_of([])), Settings(domain=0))
    network.interrupted("for a test")
    network.resumed()
    assert "Zenoh works again" in caplog.text
    network.close()
