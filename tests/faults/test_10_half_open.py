"""Promise 10: a peer whose machine has failed is detected; a busy peer is not disconnected."""

import asyncio
import contextlib
import ctypes
import os
import signal
import socket
import struct
import sys
import time

import pytest

import taskrpc
from taskrpc.core.transport.connection import connection as connections
from taskrpc.core.transport.connection.connection import Connection
from taskrpc.core.transport.limits import keepalive
from tests.core.transport.helpers import Add, Gate, Text, ask, until
from tests.faults.harness import Bug, Lateness, milliseconds

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform != "linux", reason="black holes are made by Linux's filters"),
]

FOUND_WITHIN = {"default": 9.0, "robot": 2.5}
"""Seconds: 8 and 2 without an acknowledgement, and the delay of the kernel's timers."""
STOPPED_FOR = {"default": 10.0, "robot": 5.0}

LARGE = 1_000_000
"""Bytes of a request that exceeds the kernel's buffers while the program does not read."""

COUNTING = """\
import sys
import srvgen, taskrpc
Text = srvgen.load("my_robot_interfaces/srv/RobotTask")

def count(request, response):
    response.message = str(len(request.target))
    return response

async def main():
    async with taskrpc.Node("counting", keepalive=sys.argv[1]) as node:
        node.create_service(Text, "count", count, join=True)
        print("ready", flush=True)
        await node.spin()

taskrpc.run(main())
"""

SO_ATTACH_FILTER = 26
_drop_everything = ctypes.create_string_buffer(struct.pack("HBBI", 0x06, 0, 0, 0))
"""One instruction of the kernel's packet filter: accept no bytes of any packet."""


def black_hole(connection):
    """Let the kernel discard all packets for a socket, including acknowledgements."""
    program = struct.pack("HP", 1, ctypes.addressof(_drop_everything))
    sock = connection.transport.get_extra_info("socket")
    sock.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, program)


def looks_after_no_peer(patch):
    patch(connections, "drop_dead_peers", lambda sock, silence, seconds: None)


def looks_only_while_nothing_is_sent(patch):
    patch(keepalive, "_set_user_timeout", lambda sock, seconds: None)


def is_more_patient_than_it_says(patch):
    drop = keepalive.drop_dead_peers
    patch(
        connections,
        "drop_dead_peers",
        lambda sock, silence, dead: drop(sock, silence, dead + 2),
    )


def takes_the_full_for_dead(patch):
    patch(keepalive.TcpTimeouts, "is_over", lambda self: False)


def waits_for_the_full_for_ever(patch):
    patch(keepalive, "_UNANSWERED_PROBES", 1000)


def cuts_off_who_is_silent(patch):
    def tick(connection, now):
        if connection.transport is not None and connection._watch.silent(now, 1.0):
            connection.abort(taskrpc.ProtocolError("silent"))

    patch(Connection, "tick", tick)


class Trial:
    """Black holes and stopped processes around nodes with one keepalive profile."""

    def __init__(self, counts, profile):
        self.counts, self.profile = counts, profile

    def node(self, name):
        """A node with its own sockets."""
        self.counts["nodes"] += 1
        token = f"{name} {self.counts['nodes']}"
        return taskrpc.Node(name, token=token, keepalive=self.profile)

    async def call_in_flight(self):
        """A call that the server has acknowledged and executes when its machine fails."""
        async with self.node("server") as server, self.node("client") as node:
            server.create_service(Add, f"slow_{self.profile}", Gate())
            client = node.create_client(Add, f"slow_{self.profile}")
            assert await client.wait_for_service(5)
            call = client.call_async(ask(1), timeout=None)
            await asyncio.sleep(0.2)
            await self.found(client._channel._connection, call, "until a caller was told")

    async def call_into_the_hole(self):
        """A call that is sent into the black hole."""
        async with self.node("server") as server, self.node("client") as node:
            server.create_service(Add, f"quick_{self.profile}", Gate())
            client = node.create_client(Add, f"quick_{self.profile}")
            assert await client.wait_for_service(5)
            connection = client._channel._connection
            black_hole(connection)
            call = client.call_async(ask(2), timeout=None)
            await self.found(connection, call, "until a call into the hole was told")

    async def caller_gone(self):
        """A caller whose machine fails: the server executes the call, but its response is lost."""
        gate = Gate()
        async with self.node("server") as server, self.node("client") as node:
            server.create_service(Add, f"other_{self.profile}", gate)
            client = node.create_client(Add, f"other_{self.profile}")
            assert await client.wait_for_service(5)
            call = client.call_async(ask(1), timeout=None)
            await until(lambda: gate.started)
            (serving,) = server._transport._served
            cancelled = asyncio.ensure_future(until(lambda: gate.cancelled, 60))
            await self.found(serving, cancelled, "until a server stopped its work")
            call.cancel()

    async def full_peer_gone(self, programs):
        """A machine fails while its program is stopped and its buffers are full."""
        async with self.counting(programs) as (server, client):
            os.kill(server.pid, signal.SIGSTOP)
            call = client.call_async(Text.Request(target="x" * LARGE), timeout=None)
            await asyncio.sleep(0.5)
            connection = client._channel._connection
            await self.found(connection, call, "until a call to a full peer was told", 2.0)

    async def found(self, connection, awaited, what, more=0.0):
        black_hole(connection)
        self.counts["black holes"] += 1
        began = time.monotonic()
        limit = FOUND_WITHIN[self.profile] + more
        done, _ = await asyncio.wait([awaited], timeout=limit + 3)
        took = time.monotonic() - began
        self.counts["not found"] += not done
        self.late = max(self.late, took - limit) if done else self.late
        self.counts[f"{self.profile}: ms {what}"] = milliseconds(took)
        awaited.cancel()
        await asyncio.gather(awaited, return_exceptions=True)
        connection.abort(taskrpc.ConnectionLost("the test is over"))

    late = float("-inf")
    """Seconds beyond the allowed delay."""

    async def stopped(self, programs):
        """A process that is stopped longer than a dead peer's timeout; its kernel acknowledges."""
        counts = self.counts
        async with self.counting(programs) as (server, client):
            os.kill(server.pid, signal.SIGSTOP)
            counts["processes stopped"] += 1
            sizes = [*range(10), LARGE]
            calls = [client.call_async(Text.Request(target="x" * size)) for size in sizes]
            await asyncio.sleep(STOPPED_FOR[self.profile])
            os.kill(server.pid, signal.SIGCONT)
            for each in await asyncio.gather(*calls, return_exceptions=True):
                lost = isinstance(each, taskrpc.TaskRpcError)
                counts["busy ones cut off"] += lost
                counts["answers of those that were stopped"] += not lost

    @contextlib.asynccontextmanager
    async def counting(self, programs):
        """A program that counts letters, and its only client."""
        server = await programs.start(COUNTING, self.profile, name="counting.py")
        async with taskrpc.Node("looking") as node:
            place = next(each.address for each in await node.graph() if each.pid == server.pid)
        async with taskrpc.Node("client", peers=[place], keepalive=self.profile) as node:
            client = node.create_client(Text, "count", timeout=60)
            assert await client.wait_for_service(10)
            await client.call(Text.Request())
            yield server, client


@pytest.mark.planted(
    Bug(looks_after_no_peer, "not found"),
    Bug(looks_only_while_nothing_is_sent, "not found"),
    Bug(is_more_patient_than_it_says, "found late"),
    Bug(waits_for_the_full_for_ever, "not found"),
    Bug(cuts_off_who_is_silent, "busy ones cut off"),
    Bug(takes_the_full_for_dead, "busy ones cut off"),
)
async def test_silent_peer_is_detected_and_stopped_process_is_waited_for(counts, programs, bug):
    lateness = Lateness()
    profiles = FOUND_WITHIN if bug is None else ["robot"]  # detected earlier
    trials = [Trial(counts, profile) for profile in profiles]
    await asyncio.gather(
        *(each.call_in_flight() for each in trials),
        *(each.call_into_the_hole() for each in trials),
        *(each.caller_gone() for each in trials),
        *(each.full_peer_gone(programs) for each in trials),
        *(each.stopped(programs) for each in trials),
    )
    late = lateness.stop()
    counts["ms the loop was late"] = milliseconds(late)
    counts["found late"] = sum(each.late > late for each in trials)
    counts.check(
        "not found",
        "found late",
        "busy ones cut off",
        happened=("black holes", "processes stopped", "answers of those that were stopped"),
    )
