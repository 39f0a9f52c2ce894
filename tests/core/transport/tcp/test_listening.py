"""A caller gets a place or a reason; unauthenticated callers take no place of others."""

import asyncio
import contextlib
import itertools
import os
import socket

import pytest

import taskrpc
from taskrpc.core.transport.limits import admission
from taskrpc.core.transport.limits.log_throttling import LINES, PERIOD, LimitedLog, ThrottledLog
from taskrpc.core.transport.tcp import listening
from taskrpc.core.transport.tcp.listening import Listener
from taskrpc.core.transport.tcp.tcp_network import listening_socket
from tests.core.transport.helpers import Add, ask, outcome, until
from tests.core.transport.tcp.test_tcp_network import host_and_port, offering

pytestmark = pytest.mark.real_time


async def strangers(server, count):
    return [await asyncio.open_connection(*host_and_port(server)) for _ in range(count)]


async def ends(connections):
    """Return the indexes of the connections that have ended."""
    found = []
    for place, (reader, _) in enumerate(connections):
        with contextlib.suppress(TimeoutError, ConnectionError):
            async with asyncio.timeout(0.02):
                await reader.read()
        if reader.at_eof() or reader.exception() is not None:
            found.append(place)
    return found


async def close(connections):
    for _, writer in connections:
        writer.close()


async def test_only_the_oldest_unauthenticated_connections_are_closed(monkeypatch, caplog):
    monkeypatch.setattr(admission, "MAX_UNAUTHENTICATED", 4)
    async with offering() as server, taskrpc.Node("client", token="c") as node:
        client = node.create_client(Add, "add")
        assert (await client.call(ask(1))).sum == 1
        connections = await strangers(server, 7)
        await until(lambda: len(server._transport._served) == 5)
        assert await ends(connections) == [0, 1, 2]
        assert (await client.call(ask(2))).sum == 2
        async with taskrpc.Node("late", token="d") as late:
            assert (await late.create_client(Add, "add").call(ask(3))).sum == 3
        await close(connections)
    assert [each.message.split(";")[0] for each in caplog.records] == [
        "more than 4 connections without a proof"
    ]


async def test_one_machines_strangers_take_no_places_of_another_machines(monkeypatch, caplog):
    monkeypatch.setattr(admission, "MAX_UNAUTHENTICATED", 4)
    machines = itertools.chain(["192.0.2.8"], itertools.repeat("192.0.2.7"))
    monkeypatch.setattr(admission, "host_of", lambda peer: next(machines))
    async with offering() as server:
        connections = await strangers(server, 7)
        await until(lambda: len(server._transport._served) == 4)
        assert await ends(connections) == [1, 2, 3]
        await close(connections)


class Began(asyncio.Protocol):
    """Records the ports of the connections that began, in order."""

    def __init__(self, ports):
        self._ports = ports

    def connection_made(self, transport):
        self._ports.append(transport.get_extra_info("peername")[1])
        transport.close()


@contextlib.asynccontextmanager
async def flooded(monkeypatch, machine, flood=40):
    """Ports of a flood's connections, then of one from another machine, and those that begin.

    All are in the kernel's queue before the listener has its first turn.
    """
    monkeypatch.setattr(listening, "MAX_WAITING", 8)
    monkeypatch.setattr(listening, "ACCEPTS_A_TURN", flood + 1)
    sock = listening_socket("127.0.0.1", 0)
    began, callers = [], [socket.create_connection(sock.getsockname()) for _ in range(flood + 1)]
    ports = [each.getsockname()[1] for each in callers]
    hosts = dict.fromkeys(ports, machine) | {ports[-1]: "192.0.2.8"}
    monkeypatch.setattr(listening, "host_of", lambda peer: hosts[peer[1]])
    listener = Listener(sock, lambda: Began(began))
    try:
        yield ports, began
    finally:
        await listener.close()
        for each in callers:
            each.close()


async def test_a_flood_of_connections_from_one_machine_keeps_no_other_waiting(monkeypatch, caplog):
    async with flooded(monkeypatch, "192.0.2.7") as (ports, began):
        await until(lambda: len(began) == 8)
    assert began[1] == ports[-1]
    assert set(began) - {ports[-1]} == set(ports[-8:-1])
    assert caplog.messages == ["more than 8 connections wait; the oldest of 192.0.2.7 was closed"]


async def test_connections_from_this_machine_wait_and_are_not_closed(monkeypatch):
    async with flooded(monkeypatch, "") as (ports, began):
        await until(lambda: len(began) == len(ports))
    assert sorted(began) == sorted(ports)


async def test_a_full_server_says_so_and_takes_callers_again_once_there_is_room(
    monkeypatch, caplog
):
    monkeypatch.setattr(admission, "MAX_CONNECTIONS", 1)
    async with offering() as server, taskrpc.Node("late", token="d") as late:
        wanting = late.create_client(Add, "add", timeout=5)
        async with taskrpc.Node("first", token="c") as first:
            assert (await first.create_client(Add, "add").call(ask(1))).sum == 1
            error = await outcome(wanting.call(ask()))
            assert error.not_executed
            assert "the server has 1 connections, as many as it can" in str(error)
        await until(lambda: not server._transport._served)
        assert (await wanting.call(ask(2))).sum == 2
    assert caplog.text.count("as many as it can") == 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows counts handles otherwise")
async def test_without_descriptors_one_line_is_logged_and_the_server_recovers(caplog):
    import resource

    async with offering() as server, taskrpc.Node("client", token="c") as node:
        client = node.create_client(Add, "add")
        assert (await client.call(ask(1))).sum == 1
        callers = [socket.socket() for _ in range(20)]
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (callers[-1].fileno() + 4, hard))
        try:
            for each in callers:
                each.settimeout(2)
                each.connect(host_and_port(server))
            await asyncio.sleep(0.3)
            assert (await client.call(ask(2))).sum == 2
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        closed = sum(each.recv(1) == b"" for each in callers if _is_readable(each))
        assert closed >= 10
        await until(lambda: server._transport.network._listener._reserve is not None)
        async with taskrpc.Node("late", token="d") as late:
            assert (await late.create_client(Add, "add").call(ask(3))).sum == 3
        for each in callers:
            each.close()
    assert len(caplog.records) == 1
    assert "no descriptors are left for connections" in caplog.text
    assert "; closed " in caplog.text


def _is_readable(sock):
    sock.setblocking(False)
    try:
        sock.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return False
    except ConnectionError:
        return False
    return True


async def test_connections_that_are_never_made_do_not_keep_the_others_out(
    monkeypatch, caplog, tmp_path
):
    """During a TLS handshake there is no protocol object yet: the listener itself must count."""
    import trustme

    monkeypatch.setattr(listening, "MAX_ARRIVING", 3)
    authority = trustme.CA()
    path = tmp_path / "cert.pem"
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(path)
    async with offering(tls=taskrpc.Tls(cert=path, key=path), token="t") as server:
        connections = await strangers(server, 5)
        await asyncio.sleep(0.05)
        assert await ends(connections) == [0, 1]
        async with taskrpc.Node("here") as here:
            assert (await here.create_client(Add, "add").call(ask(1))).sum == 1
        await close(connections)
    assert caplog.text.count("connections are being established") == 1


@pytest.mark.parametrize("error", [RuntimeError("no"), OSError("neither")])
async def test_a_connection_that_cannot_be_taken_is_closed_and_the_next_one_is_taken(error, caplog):
    sock = socket.create_server(("127.0.0.1", 0))
    sock.setblocking(False)
    made = [error]

    def factory():
        if made:
            raise made.pop()
        return asyncio.Protocol()

    listener = Listener(sock, factory)
    first, second = [await asyncio.open_connection(*sock.getsockname()) for _ in range(2)]
    async with asyncio.timeout(60):
        assert await first[0].read() == b""
    second[1].write(b"x")
    await second[1].drain()
    assert not second[0].at_eof()
    await close((first, second))
    await listener.close()
    assert ("failed:" in caplog.text) is isinstance(error, RuntimeError)


async def test_a_closed_listener_leaves_nothing(recwarn):
    sock = socket.create_server(("127.0.0.1", 0))
    sock.setblocking(False)
    listener = Listener(sock, asyncio.BufferedProtocol)
    before = asyncio.all_tasks() - {listener._accepting}
    place = sock.getsockname()
    callers = [socket.create_connection(place) for _ in range(5)]
    await asyncio.sleep(0)
    await listener.close()
    assert asyncio.all_tasks() == before
    with pytest.raises(ConnectionError):
        socket.create_connection(place)
    for each in callers:
        each.close()
    assert not recwarn.list


def test_lines_that_were_left_out_are_counted_in_the_next_one(caplog):
    import logging

    seldom = ThrottledLog(logging.getLogger("test"))
    for second in (0, 1, PERIOD - 1, PERIOD, PERIOD + 1):
        seldom.warning(100 + second, "trouble with %s", second)
    assert [each.message for each in caplog.records] == [
        "trouble with 0",
        "trouble with 10.0 (and 2 times more before)",
    ]


def test_a_flood_of_strangers_fills_no_log(caplog):
    import logging

    few = LimitedLog(logging.getLogger("test"))
    for number in range(10_000):
        few.warning(number / 1000, "stranger %d", number)
    few.warning(PERIOD, "stranger %d", 10_000)
    assert [each.message for each in caplog.records] == [
        *[f"stranger {number}" for number in range(LINES)],
        f"… more such lines within {PERIOD:g} s are only counted",
        f"{10_000 - LINES} more such lines were left out",
        "stranger 10000",
    ]


async def test_each_invalid_client_is_logged_up_to_a_limit(caplog):
    async with offering() as server:
        for _ in range(LINES + 20):
            _, writer = await asyncio.open_connection(*host_and_port(server))
            writer.write(b"GET / HTTP/1.1\r\n\r\n")
            writer.close()
        await until(lambda: server.status().accepted.opened == LINES + 20)
        await until(lambda: server.status().accepted.open == 0)
    assert caplog.text.count("does not speak taskrpc") == LINES
    assert caplog.text.count("are only counted") == 1
