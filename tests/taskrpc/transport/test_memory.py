"""Connections in memory behave like sockets: order, backpressure, closing; visible in one loop."""

import asyncio
import random

import pytest

import taskrpc
from taskrpc.transport.memory import HIGH_WATER, join
from tests.taskrpc.transport.helpers import Add, add, ask


class Recorder(asyncio.BufferedProtocol):
    def __init__(self, room=1000):
        self.buffer = bytearray(room)
        self.received = b""
        self.log = []

    def connection_made(self, transport):
        self.transport = transport

    def get_buffer(self, sizehint):
        return memoryview(self.buffer)

    def buffer_updated(self, nbytes):
        self.received += self.buffer[:nbytes]

    def pause_writing(self):
        self.log.append("pause")

    def resume_writing(self):
        self.log.append("resume")

    def connection_lost(self, exc):
        self.log.append("lost")


def joined(room=1000):
    one, other = Recorder(room), Recorder(room)
    join(one, other, "here")
    return one, other


async def turns(count=10):
    for _ in range(count):
        await asyncio.sleep(0)


async def test_bytes_arrive_in_order_in_later_turns():
    chance = random.Random(1)
    one, other = joined(room=7)
    data = chance.randbytes(5000)
    rest = data
    while rest:
        count = chance.randrange(1, 100)
        one.transport.write(rest[:count])
        rest = rest[count:]
    assert other.received == b""
    await turns()
    assert other.received == data


async def test_a_writer_is_paused_while_the_reader_pauses():
    one, other = joined()
    other.transport.pause_reading()
    one.transport.write(bytes(HIGH_WATER + 1))
    assert one.log == ["pause"]
    assert one.transport.get_write_buffer_size() == HIGH_WATER + 1
    await turns()
    assert other.received == b""
    other.transport.resume_reading()
    await turns()
    assert one.log == ["pause", "resume"]
    assert len(other.received) == HIGH_WATER + 1


async def test_bytes_written_before_close_are_read():
    one, other = joined()
    one.transport.write(b"last words")
    one.transport.close()
    one.transport.write(b"too late")
    await turns()
    assert other.received == b"last words"
    assert one.log == other.log == ["lost"]


async def test_abort_drops_unread_bytes():
    one, other = joined()
    one.transport.write(b"gone")
    one.transport.abort()
    await turns()
    assert other.received == b""
    assert one.log == other.log == ["lost"]


async def test_closing_both_ends_loses_each_once():
    one, other = joined()
    one.transport.close()
    other.transport.close()
    await turns()
    assert one.log == other.log == ["lost"]


async def test_a_paused_reader_sees_the_end_after_all_bytes():
    one, other = joined()
    other.transport.pause_reading()
    one.transport.write(b"data")
    one.transport.close()
    await turns()
    assert other.log == []
    other.transport.resume_reading()
    await turns()
    assert (other.received, other.log) == (b"data", ["lost"])


async def test_domains_do_not_see_each_other(monkeypatch):
    async with taskrpc.Node("server", transport="memory") as server:
        server.create_service(Add, "add", add)
        monkeypatch.setenv("ROS_DOMAIN_ID", "1")
        async with taskrpc.Node("client", transport="memory") as node:
            assert not await node.create_client(Add, "add").wait_for_service(1)


def test_loops_do_not_see_each_other():
    async def offers(then):
        async with taskrpc.Node("server", transport="memory") as server:
            server.create_service(Add, "add", add)
            return await asyncio.to_thread(then)

    def looks():
        async def main():
            async with taskrpc.Node("client", transport="memory") as node:
                return await node.create_client(Add, "add").wait_for_service(0.05)

        return asyncio.run(main())

    assert asyncio.run(offers(looks)) is False


async def test_hours_of_calls_leave_nothing_behind():
    async with taskrpc.Node("node", transport="memory") as node:
        node.create_service(Add, "add", add)
        client = node.create_client(Add, "add")
        for n in range(4):
            assert (await client.call(ask(n))).sum == n
            await asyncio.sleep(3600)
        assert len(node._transport._served) == 1


async def test_accounts_hold_in_memory_as_they_do_on_sockets():
    ana = taskrpc.Account("ana", "anas-secret-anas")
    gone = taskrpc.Account("gone", "gones-secret-gone", revoked=True)
    async with (
        taskrpc.Node(
            "server", transport="memory", listen="s", accounts=taskrpc.Accounts([ana, gone])
        ) as server,
        taskrpc.Node("ana", transport="memory", listen="a", token=ana.token) as hers,
        taskrpc.Node("gone", transport="memory", listen="g", token=gone.token) as theirs,
        taskrpc.Node("any", transport="memory", listen="x") as mine,
    ):
        server.create_service(Add, "add", add)
        server.create_service(Add, "steer", add, role=taskrpc.Role.OPERATE)
        assert (await hers.create_client(Add, "add").call(ask(1, 2))).sum == 3
        with pytest.raises(taskrpc.PermissionDenied, match="the account ana has submit"):
            await hers.create_client(Add, "steer").call(ask())
        with pytest.raises(taskrpc.AuthenticationFailed, match="the token"):
            await theirs.create_client(Add, "add").call(ask())
        assert (await mine.create_client(Add, "steer").call(ask(1, 2))).sum == 3
