"""Promise 10: a peer whose machine is gone is found; one that is only busy is not cut off."""

import asyncio
import ctypes
import os
import signal
import socket
import struct
import sys
import time

import pytest

import taskrpc
from taskrpc import platform
from taskrpc.transport.connection import DEAD_AFTER, Connection
from tests.faults.harness import Bug, Lateness, milliseconds
from tests.taskrpc.transport.helpers import Add, Gate, ask

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform != "linux", reason="black holes are made by Linux's filters"),
]

FOUND_WITHIN = DEAD_AFTER
TICK = 1.0
"""Seconds: connections are looked after about once a second, and so are the kernel's timers."""
STOPPED_FOR = 10.0

SO_ATTACH_FILTER = 26
_drop_everything = ctypes.create_string_buffer(struct.pack("HBBI", 0x06, 0, 0, 0))
"""One instruction of the kernel's packet filter: accept no byte of any packet."""


def black_hole(sock):
    """The kernel throws away all that arrives for a socket, acknowledgements as well."""
    program = struct.pack("HP", 1, ctypes.addressof(_drop_everything))
    sock.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, program)


def looks_after_no_peer(patch):
    patch(platform, "drop_dead_peers", lambda sock, silence, seconds: None)


def cuts_off_who_is_silent(patch):
    def tick(connection, now):
        if connection.transport is not None and connection._watch.silent(now):
            connection.abort(taskrpc.ProtocolError("silent"))

    patch(Connection, "tick", tick)


@pytest.mark.planted(
    Bug(looks_after_no_peer, "not found"), Bug(cuts_off_who_is_silent, "busy ones cut off")
)
async def test_a_peer_in_a_black_hole_is_found_and_a_stopped_process_is_waited_for(
    counts, programs
):
    lateness = Lateness()
    await asyncio.gather(_in_flight(counts), _idle(counts), _stopped(counts, programs))
    counts["ms the loop was late"] = milliseconds(lateness.stop())
    counts.check(
        "not found",
        "found late",
        "busy ones cut off",
        happened=("black holes", "processes stopped", "answers of those that were stopped"),
    )


async def _in_flight(counts):
    """A call that the server has acknowledged and works on when its machine goes."""
    async with (
        taskrpc.Node("server", token="s") as server,
        taskrpc.Node("client", token="c") as node,
    ):
        server.create_service(Add, "slow", Gate())
        client = node.create_client(Add, "slow")
        assert await client.wait_for_service(5)
        call = client.call_async(ask(1), timeout=None)
        await asyncio.sleep(0.2)
        await _found(counts, client, call, "ms until a call in flight was told")


async def _idle(counts):
    """A call that is sent into the black hole."""
    async with (
        taskrpc.Node("server", token="s2") as server,
        taskrpc.Node("client", token="c2") as node,
    ):
        server.create_service(Add, "quick", Gate())
        client = node.create_client(Add, "quick")
        assert await client.wait_for_service(5)
        await _found(counts, client, None, "ms until a call into the hole was told")


async def _found(counts, client, call, what):
    connection = client._channel._connection
    black_hole(connection.transport.get_extra_info("socket"))
    counts["black holes"] += 1
    began = time.monotonic()
    call = call or client.call_async(ask(2), timeout=None)
    done, _ = await asyncio.wait([call], timeout=FOUND_WITHIN + 3 * TICK)
    took = time.monotonic() - began
    counts["not found"] += not done
    counts["found late"] += bool(done) and took > FOUND_WITHIN + 2 * TICK
    counts[what] = milliseconds(took)
    call.cancel()
    await asyncio.gather(call, return_exceptions=True)
    connection.abort(taskrpc.ConnectionLost("the test is over"))


async def _stopped(counts, programs):
    """A process that does nothing for longer than a dead one is given; its kernel answers."""
    server = await programs.start()
    async with taskrpc.Node("client", token="c3") as node:
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(10)
        calls = [client.call_async(ask(n, 1), timeout=60) for n in range(10)]
        await asyncio.gather(*calls)
        os.kill(server.pid, signal.SIGSTOP)
        counts["processes stopped"] += 1
        calls = [client.call_async(ask(n, 1), timeout=60) for n in range(10)]
        await asyncio.sleep(STOPPED_FOR)
        os.kill(server.pid, signal.SIGCONT)
        for each in await asyncio.gather(*calls, return_exceptions=True):
            lost = isinstance(each, taskrpc.TaskRpcError)
            counts["busy ones cut off"] += lost
            counts["answers of those that were stopped"] += not lost
