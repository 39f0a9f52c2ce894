"""Specific to TCP: addresses, tokens, domains, invalid clients, descriptors."""

import asyncio
import contextlib
import gc
import os
import socket
import sys
import warnings

import pytest

import srvgen
import taskrpc
from taskrpc.core.transport.tcp.tcp_network import TcpNetwork, split_address
from tests.core.transport.helpers import Add, Gate, Text, add, ask, outcome, until

String = srvgen.load("std_msgs/msg/String")
LATCHED = taskrpc.QoS(durability="transient_local")

pytestmark = pytest.mark.real_time


def host_and_port(node):
    host, _, port = node.address.rpartition(":")
    return host, int(port)


@contextlib.asynccontextmanager
async def offering(callback=add, **options):
    async with taskrpc.Node("server", **options) as node:
        node.create_service(Add, "add", callback)
        yield node


@contextlib.contextmanager
def silent():
    """An address at which the kernel accepts connections but no program responds."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield "{}:{}".format(*listening.getsockname())


# Addresses


async def test_a_client_finds_its_server_with_nothing_configured():
    async with offering(token="other endpoint"), taskrpc.Node("client") as node:
        assert (await node.create_client(Add, "add").call(ask(1, 2))).sum == 3


async def test_the_address_is_a_free_port_of_this_machine():
    async with taskrpc.Node("idle") as idle, offering(token="s") as node:
        assert idle.address == ""
        assert node.address.startswith("127.0.0.1:")
        assert host_and_port(node)[1] > 0


async def test_domains_do_not_see_each_other(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    async with offering() as server:
        monkeypatch.setenv("ROS_DOMAIN_ID", "8")
        async with taskrpc.Node("client") as node:
            with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers"):
                await node.create_client(Add, "add").call(ask())
        async with taskrpc.Node("client", peers=[server.address], token="x") as node:
            with pytest.raises(taskrpc.TaskRpcError, match="in domain 7, the client in domain 8"):
                await node.create_client(Add, "add").call(ask())
        monkeypatch.setenv("ROS_DOMAIN_ID", "7")
        async with taskrpc.Node("client") as node:
            assert (await node.create_client(Add, "add").call(ask(1))).sum == 1


async def test_peers_of_this_user_need_no_token(monkeypatch):
    async with offering(token="an unknown token") as server:
        async with taskrpc.Node("client", peers=[server.address]) as node:
            assert (await node.create_client(Add, "add").call(ask(1))).sum == 1
        port = host_and_port(server)[1]
        monkeypatch.setenv("TASKRPC_PEERS", f"127.0.0.1:1; localhost:{port}")
        async with taskrpc.Node("client") as node:
            client = node.create_client(Add, "add")
            assert await client.wait_for_service(60)
            assert (await client.call(ask(1))).sum == 1


async def test_peers_replace_the_registry():
    async with offering(), taskrpc.Node("client", peers=["127.0.0.1:1"]) as node:
        with pytest.raises(taskrpc.ServiceUnavailable, match=r"could not be reached: 127.0.0.1:1"):
            await node.create_client(Add, "add").call(ask())


async def test_the_first_peer_that_has_the_service_answers(caplog):
    async with (
        offering(token="one") as one,
        taskrpc.Node("two", token="two") as two,
    ):
        two.create_service(Add, "multiply", add)
        peers = ["127.0.0.1:1", one.address, two.address]
        async with taskrpc.Node("client", peers=peers) as node:
            assert await node.create_client(Add, "multiply").wait_for_service(60)
            with pytest.raises(taskrpc.ServiceUnavailable, match="subtract"):
                await node.create_client(Add, "subtract").call(ask())
            entries = await node.graph()
            assert {name for each in entries for name in each.nodes} == {
                "/server", "/two", "/client"
            }  # fmt: skip
    assert "127.0.0.1:1: " in caplog.text


async def test_a_peer_that_starts_late_is_asked_again(unused_tcp_port):
    place = f"127.0.0.1:{unused_tcp_port}"
    async with taskrpc.Node("client", peers=[place]) as node:
        client = node.create_client(Add, "add")
        waiting = asyncio.create_task(client.wait_for_service(None))
        await asyncio.sleep(0.15)
        async with taskrpc.Node("server", listen=place) as server:
            await asyncio.sleep(0.1)  # reached, but without the service
            server.create_service(Add, "add", add)
            async with asyncio.timeout(60):
                assert await waiting


# A server of the same user that restarts: each of its programs has another random secret


def before_dialling(node, action):
    """Do something between a client's look at the registry and its dialling, once."""
    network = node._transport.network
    dial = network.dial

    async def dial_after(address, factory):
        network.dial = dial
        await action()
        return await dial(address, factory)

    network.dial = dial_after


async def seen_by_call(node):
    return (await node.create_client(Add, "add").call(ask(1))).sum == 1


async def seen_by_listing(node):
    # The entry of a program that was asked has no pid; the others are of this process.
    return any("/server" in entry.nodes for entry in await node.graph() if not entry.pid)


async def seen_by_definition(node):
    return (await node._transport.definition("/add"))[0] == "example_interfaces/srv/AddTwoInts"


@pytest.mark.parametrize("seen", [seen_by_call, seen_by_listing, seen_by_definition])
async def test_a_server_that_starts_while_a_client_dials_needs_no_token(unused_tcp_port, seen):
    place = f"127.0.0.1:{unused_tcp_port}"
    async with taskrpc.Node("client", peers=[place]) as node, contextlib.AsyncExitStack() as stack:
        before_dialling(
            node, lambda: stack.enter_async_context(offering(listen=place, token="new"))
        )
        assert await seen(node)


@pytest.mark.parametrize(
    ("with_peers", "seen"),
    [
        (True, seen_by_call),
        (True, seen_by_listing),
        (True, seen_by_definition),
        (False, seen_by_call),
        (False, seen_by_definition),
    ],
)
async def test_a_server_that_restarts_while_a_client_dials_is_reached(
    unused_tcp_port, with_peers, seen
):
    place = f"127.0.0.1:{unused_tcp_port}"
    async with contextlib.AsyncExitStack() as stack:
        first = await stack.enter_async_context(contextlib.AsyncExitStack())
        await first.enter_async_context(offering(listen=place, token="old"))

        async def restart():
            await first.aclose()
            await stack.enter_async_context(offering(listen=place, token="new"))

        peers = [place] if with_peers else None
        async with taskrpc.Node("client", peers=peers) as node:
            before_dialling(node, restart)
            assert await seen(node)


async def test_a_subscription_follows_a_server_that_starts_while_it_dials(unused_tcp_port, caplog):
    place = f"127.0.0.1:{unused_tcp_port}"
    async with contextlib.AsyncExitStack() as stack:
        node = await stack.enter_async_context(taskrpc.Node("client", peers=[place]))

        async def start():
            server = await stack.enter_async_context(offering(listen=place, token="new"))
            server.create_publisher(String, "news", LATCHED).publish(String(data="x"))

        before_dialling(node, start)
        heard = asyncio.Event()
        node.create_subscription(String, "news", lambda _: heard.set(), LATCHED)
        async with asyncio.timeout(60):
            await heard.wait()
    assert "secret" not in caplog.text


async def test_a_server_that_is_gone_while_another_program_answers_is_not_available(
    monkeypatch, tmp_path, unused_tcp_port
):
    place = f"127.0.0.1:{unused_tcp_port}"
    async with contextlib.AsyncExitStack() as stack:
        first = await stack.enter_async_context(contextlib.AsyncExitStack())
        await first.enter_async_context(offering(listen=place, token="old"))

        async def replace():
            await first.aclose()
            with monkeypatch.context() as patched:
                patched.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # like that of another user
                await stack.enter_async_context(offering(listen=place, token="new"))

        async with taskrpc.Node("client", peers=[place]) as node:
            before_dialling(node, replace)
            with pytest.raises(taskrpc.ServiceUnavailable, match="has ended"):
                await node.create_client(Add, "add").call(ask())


@pytest.mark.parametrize("variable", [True, False])
async def test_a_token_opens_a_server_that_is_in_no_registry(monkeypatch, tmp_path, variable):
    async with offering(token="right") as server:
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # like that of another user
        if variable:
            monkeypatch.setenv("TASKRPC_TOKEN", "right")
        token = None if variable else "right"
        async with taskrpc.Node("client", peers=[server.address], token=token) as node:
            assert (await node.create_client(Add, "add").call(ask(1))).sum == 1


@pytest.mark.parametrize(
    ("token", "said"), [(None, "its secret is needed"), ("wrong", "not this server's")]
)
async def test_a_caller_without_the_token_is_refused(monkeypatch, tmp_path, token, said, caplog):
    gate = Gate()
    async with offering(gate, token="right") as server:
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        async with taskrpc.Node("client", peers=[server.address], token=token) as node:
            client = node.create_client(Add, "add")
            with pytest.raises(taskrpc.AuthenticationFailed, match=said) as caught:
                await client.call(ask())
            assert caught.value.not_executed
            assert not await client.wait_for_service(0.1)
    assert not gate.started
    assert "right" not in caplog.text


@pytest.mark.parametrize(
    "place", ["", "7450", "host:", ":7450", "host:x", "host:70000", "host:-1", "a b"]
)
def test_a_wrong_address_is_shown(place):
    with pytest.raises(taskrpc.TaskRpcError, match=r"expected HOST:PORT such as .*, got"):
        split_address(place)


def test_addresses_are_read():
    assert split_address("robot.local:7450") == ("robot.local", 7450)
    assert split_address("[::1]:7450") == ("::1", 7450)


# Listening


async def test_a_port_in_use_is_one_sentence(unused_tcp_port):
    place = f"127.0.0.1:{unused_tcp_port}"
    async with offering(listen=place), taskrpc.Node("second", listen=place, token="x") as second:
        with pytest.raises(taskrpc.CannotListen, match=f"cannot listen at {place}: A") as told:
            second.create_service(Add, "other", add)
        assert str(told.value).endswith(": Address already in use")
        assert "`taskrpc ps`" in told.value.__notes__[0]
        assert second.address == ""


async def test_a_restarted_server_gets_its_port_back_at_once(unused_tcp_port):
    place = f"127.0.0.1:{unused_tcp_port}"
    async with taskrpc.Node("client") as node:
        client = node.create_client(Add, "add")
        for _ in range(3):
            async with offering(listen=place):
                assert (await client.call(ask(1))).sum == 1
            await until(lambda: not client.service_is_ready())


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.0.1", "[::]", "robot.local"])
async def test_other_than_this_machines_addresses_are_refused_without_tls_and_token(host):
    async with taskrpc.Node("open", listen=f"{host}:0", token="t") as node:
        with pytest.raises(taskrpc.CannotListen, match=r"a certificate .* and one of: a token"):
            node.create_service(Add, "add", add)


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::1]"])
async def test_this_machines_addresses_are_allowed(host):
    if host == "[::1]" and not socket.has_ipv6:
        pytest.skip("this machine has no IPv6")
    try:
        async with offering(listen=f"{host}:0"), taskrpc.Node("client") as node:
            assert (await node.create_client(Add, "add").call(ask(1))).sum == 1
    except taskrpc.CannotListen as error:
        pytest.skip(str(error))


# Invalid clients


async def talk(node, *pieces, wait=5.0):
    """Send bytes to a node's port; return the bytes that it sends until it closes."""
    reader, writer = await asyncio.open_connection(*host_and_port(node))
    for piece in pieces:
        writer.write(piece)
        await asyncio.sleep(0.01)
    try:
        return await asyncio.wait_for(reader.read(), wait)
    except ConnectionError:
        return b""
    finally:
        writer.close()


@pytest.mark.parametrize(
    "pieces",
    [
        [b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"],
        [b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"],
        [b"T", b"R", b"P", b"X"],
        [os.urandom(100_000)],
        [b"TRPC" + b"\xff" * 64],
        [b"TRPC" + (12 + 5000).to_bytes(4, "little") + b"\x01" + bytes(11)],
        [b"TRPC" + (12).to_bytes(4, "little") + b"\x07" + bytes(11)],
        [b"TRPC" + (14).to_bytes(4, "little") + b"\x01" + bytes(11) + b"\xc1\xc1"],
    ],
    ids=["http", "tls", "almost", "noise", "length", "too long", "request first", "bad hello"],
)
async def test_an_invalid_client_is_disconnected_with_one_log_line(pieces, caplog):
    async with offering() as server, taskrpc.Node("client", token="c") as node:
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(60)
        await talk(server, *pieces)
        assert (await client.call(ask(1))).sum == 1
        assert len(server._transport._served) == 1
    assert len(caplog.records) == 1
    assert caplog.records[0].message.startswith("closed the connection from 127.0.0.1:")
    assert caplog.records[0].exc_info is None


async def test_a_connection_without_data_is_not_logged(caplog):
    async with offering() as server:
        for _ in range(5):
            socket.create_connection(host_and_port(server)).close()
        await asyncio.sleep(0.05)
        await until(lambda: not server._transport._served)
    assert caplog.records == []


async def test_a_late_handshake_is_closed(monkeypatch, caplog):
    monkeypatch.setattr("taskrpc.core.transport.connection.connection.HANDSHAKE_TIMEOUT", 0.1)
    async with offering() as server:
        assert await talk(server, b"TRPC") == b""
    assert "no handshake within 0.1 s" in caplog.text


async def test_a_server_that_accepts_and_says_nothing_is_given_up(monkeypatch):
    monkeypatch.setattr("taskrpc.core.transport.connection.connection.HANDSHAKE_TIMEOUT", 0.1)
    with silent() as place:
        async with taskrpc.Node("client", peers=[place]) as node:
            with pytest.raises(taskrpc.ServiceUnavailable, match="no handshake within"):
                await node.create_client(Add, "add").call(ask())


async def test_a_call_does_not_wait_longer_for_a_connection_than_its_deadline(monkeypatch):
    monkeypatch.setattr("taskrpc.core.transport.connection.connection.HANDSHAKE_TIMEOUT", 300)
    with silent() as place:
        async with taskrpc.Node("client", peers=[place]) as node:
            client = node.create_client(Add, "add")
            async with asyncio.timeout(60):
                error = await outcome(client.call(ask(), timeout=0.1))
            assert isinstance(error, taskrpc.ServiceUnavailable)


# Closing


async def test_destroying_a_node_ends_its_pending_connection(caplog):
    with silent() as place:
        async with taskrpc.Node("client", peers=[place]) as node:
            calls = [asyncio.create_task(node.create_client(Add, "add").call(ask()))]
            calls += [node.create_client(Add, "add").call_async(ask()) for _ in range(5)]
            calls.append(asyncio.create_task(node.create_client(Add, "x").wait_for_service(None)))
            await asyncio.sleep(0.05)
        results = await asyncio.gather(*calls, return_exceptions=True)
    assert all(isinstance(each, taskrpc.TaskRpcError) for each in results[:-1])
    assert results[-1] is False
    gc.collect()
    assert [each for each in caplog.records if each.name == "asyncio"] == []


def descriptors():
    """Return the open descriptors; without a list of them, only Python's warnings show leaks."""
    return set(os.listdir("/proc/self/fd")) if sys.platform == "linux" else set()


async def test_nodes_leave_no_descriptor_behind():
    gc.collect()
    before = descriptors()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for n in range(5):
            gate = Gate()
            async with (
                offering(gate, token=f"{n}") as server,
                taskrpc.Node("client", token="c") as node,
            ):
                client = node.create_client(Add, "add")
                call = client.call_async(ask())
                await until(lambda gate=gate: gate.started)
                reader, writer = await asyncio.open_connection(*host_and_port(server))
            assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
            await reader.read()
            writer.close()
        await asyncio.sleep(0.01)
        gc.collect()
    assert descriptors() - before == set()
    assert [str(each.message) for each in caught] == []


async def test_a_caller_that_ignores_the_farewell_does_not_hold_a_node_up():
    async with offering() as server:
        reader, writer = await asyncio.open_connection(*host_and_port(server))
        await until(lambda: server._transport._served)
        began = asyncio.get_running_loop().time()
    assert asyncio.get_running_loop().time() - began < 1.9
    assert await reader.read() == b""
    writer.close()


async def test_answers_to_a_caller_that_has_just_gone_are_not_logged_one_by_one(caplog):
    """asyncio logs a line for each attempt; a thousand callers would fill a disk or a pipe."""
    opened, started = asyncio.Event(), []

    async def big(request, response):
        started.append(request)
        await opened.wait()
        response.message = "x" * (1 << 20)
        return response

    async with offering() as server:
        server.create_service(Text, "big", big, concurrency=20)
        async with taskrpc.Node("client", peers=[server.address]) as node:
            client = node.create_client(Text, "big")
            calls = [client.call_async(Text.Request()) for _ in range(20)]
            await until(lambda: len(started) == 20)
            transport = client._channel._connection.transport
            transport.get_extra_info("socket").shutdown(socket.SHUT_RDWR)
            opened.set()  # before the server notices the end
            await asyncio.gather(*map(outcome, calls))
            await until(lambda: not server._transport._served)
    assert "socket.send() raised" not in caplog.text


def test_loops_that_have_ended_are_not_kept_alive():
    import weakref

    async def main():
        async with offering(), taskrpc.Node("client", token="c") as node:
            await node.create_client(Add, "add").call(ask())
        return weakref.ref(asyncio.get_running_loop())

    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        loop = runner.run(main())
    del runner
    gc.collect()
    assert loop() is None


async def test_one_look_at_the_registry_serves_all_waiting_clients(monkeypatch):
    network = TcpNetwork(domain=0)
    looks = 0
    signature = network._registry.signature

    def counted():
        nonlocal looks
        looks += 1
        return signature()

    monkeypatch.setattr(network._registry, "signature", counted)
    for _ in range(1000):
        network.mark()
    assert looks < 50
    network.close()


async def test_a_peer_with_an_unknown_secret_is_not_called(monkeypatch, tmp_path):
    """Any program could listen there, and would get the request."""
    async with taskrpc.Node("server", token="") as server:
        server.create_service(Add, "add", add)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        async with taskrpc.Node("far", peers=[server.address]) as node:
            with pytest.raises(taskrpc.AuthenticationFailed, match="its secret is needed"):
                await node.create_client(Add, "add").call(ask())


async def test_another_machine_is_not_called_without_tls():
    async with taskrpc.Node("far", peers=["192.0.2.1:7450"], token="secret") as node:
        with pytest.raises(taskrpc.AuthenticationFailed, match="calls there need TLS"):
            await node.create_client(Add, "add").call(ask())


async def test_a_peer_that_no_host_can_be_is_named():
    name = "x" * 70
    async with taskrpc.Node(
        "far", peers=[f"{name}.example:7450"], token="secret", tls=taskrpc.Tls()
    ) as node:
        with pytest.raises(taskrpc.ServiceUnavailable, match="not a valid host name"):
            await node.create_client(Add, "add").call(ask())


async def test_tokens_are_in_no_repr():
    async with taskrpc.Node("server", token="canary") as node:
        node.create_service(Add, "add", add)
        entries = await node.graph()
        assert entries[0].token
        assert entries[0].token not in repr(entries)
        assert "canary" not in repr(node._transport.network.locate("/add"))


async def test_neither_end_holds_small_writes_back():
    """With Nagle's algorithm on, a second write in a row waits for an acknowledgement: 40 ms."""
    async with offering() as server, taskrpc.Node("client") as node:
        client = node.create_client(Add, "add")
        assert (await client.call(ask(1))).sum == 1
        for end in (client._channel._connection, *server._transport._served):
            sock = end.transport.get_extra_info("socket")
            assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
