"""Promise 14: peers that do not read, write slowly or flood cost bounded memory."""

import asyncio
import contextlib
import os
import socket
import time

import pytest

import srvgen
import taskrpc
from taskrpc.core.transport.codec import codec_of
from taskrpc.core.transport.connection import connection
from taskrpc.core.transport.connection.server_side import ServingConnection
from taskrpc.core.transport.limits import calls_in_flight
from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import ResponseReceived
from taskrpc.core.wire.frames import NO_DEADLINE, FrameType, pack_frame, pack_header
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.messages import Resolve, decode_resolved
from taskrpc.core.wire.session import Session
from tests.faults.harness import Bug

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs /proc"),
]

MEBI = 1024 * 1024
ALLOWED = 100 * MEBI
CUT_AFTER = 12.0
TOKEN = b"known to both"
SERVING = """\
import asyncio
import srvgen, taskrpc
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
Text = srvgen.load("my_robot_interfaces/srv/RobotTask")

def work(request, response):
    response.sum = request.a
    return response

def big(request, response):
    response.message = "x" * 1024 * 1024
    return response

async def main():
    async with taskrpc.Node("server", token="known to both") as node:
        node.create_service(Add, "work", work)
        node.create_service(Text, "big", big)
        print(node.address, flush=True)
        await node.spin()

asyncio.run(main())
"""
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
Text = srvgen.load("my_robot_interfaces/srv/RobotTask")


def memory(pid):
    """Resident bytes of a process."""
    with open(f"/proc/{pid}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class Peer:
    """A caller with its own socket, which reads and writes only on request."""

    def __init__(self):
        self.sock = socket.socket()
        # Small, so that unread data stays in the server and not in the kernel.
        self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.sock.setblocking(False)
        me = Identity(os.urandom(16), os.urandom(16), TOKEN, name="/slow")
        self.session = Session(me, is_client=True)
        self.loop = asyncio.get_running_loop()

    async def say(self):
        await self.loop.sock_sendall(self.sock, b"".join(self.session.take()))

    async def hear(self):
        if not (data := await self.loop.sock_recv(self.sock, 4096)):
            raise ConnectionResetError
        return list(self.session.feed(data))

    async def connect(self, where):
        """Connect and authenticate; returns the id of the service with the long responses."""
        await self.loop.sock_connect(self.sock, where)
        while self.session.state is ConnectionState.HANDSHAKE:
            await self.say()
            await self.hear()
        self.session.resolve("", Resolve("/big"))
        await self.say()
        while True:
            for event in await self.hear():
                if isinstance(event, ResponseReceived):
                    return decode_resolved(event.body).method

    async def ask_and_never_read(self, where):
        method = await self.connect(where)
        body = codec_of(Text.Request).encode(Text.Request())
        # The kernel's buffers take the first responses.
        for call_id in range(10, 16):
            request = pack_frame(FrameType.REQUEST, 0, method, call_id, NO_DEADLINE, body)
            await self.loop.sock_sendall(self.sock, request)

    async def dribble(self, where, is_over):
        """Send a frame a few bytes at a time; returns whether the server disconnects before."""
        await self.connect(where)
        began = time.monotonic()
        try:
            await self.loop.sock_sendall(
                self.sock, pack_header(FrameType.REQUEST, 0, 1, 9, NO_DEADLINE, 5000)
            )
            while not is_over(time.monotonic() - began):
                await self.loop.sock_sendall(self.sock, b"xx")
                await asyncio.sleep(0.2)
        except OSError:
            return True
        return False


class Siege:
    """Slow peers around a server, its memory, and another client that continues to call."""

    def __init__(self, program, where, counts):
        self.pid, self.where, self.counts = program.pid, where, counts
        self.before = memory(self.pid)
        self.over = False
        self.late = 0.0
        """Seconds for which the server, or this loop, could do nothing else."""

    async def watch(self):
        while not self.over:
            grown = (memory(self.pid) - self.before) // MEBI
            self.counts["MiB grown"] = max(self.counts["MiB grown"], grown)
            await asyncio.sleep(0.05)

    async def neighbour(self):
        place = "{}:{}".format(*self.where)
        async with taskrpc.Node("neighbour", peers=[place], token=TOKEN.decode()) as node:
            client = node.create_client(Add, "work")
            while not self.over:
                self.counts["neighbour calls"] += 1
                began = time.monotonic()
                try:
                    await client.call(Add.Request(a=1))
                except taskrpc.TaskRpcError:
                    self.counts["neighbour troubles"] += 1
                self.late = max(self.late, time.monotonic() - began)
                await asyncio.sleep(0.01)

    def is_late(self, seconds):
        """Whether a peer that has written so slowly for so long should have been disconnected."""
        return seconds > CUT_AFTER + self.late

    async def run(self, readers, dribblers):
        others = [asyncio.ensure_future(each()) for each in (self.watch, self.neighbour)]
        peers = [Peer() for _ in range(readers)]
        for start in range(0, readers, 50):
            some = peers[start : start + 50]
            await asyncio.gather(*[each.ask_and_never_read(self.where) for each in some])
        self.counts["never read"] = readers
        slow = [Peer() for _ in range(dribblers)]
        cut = await asyncio.gather(*[each.dribble(self.where, self.is_late) for each in slow])
        await asyncio.sleep(1)
        self.counts["cut off"] += sum(cut)
        self.counts["not cut off in time"] += dribblers - sum(cut)
        for each in peers + slow:
            each.sock.close()
        # The server discards their responses; no other caller waits for them.
        await asyncio.sleep(1)
        self.over = True
        await asyncio.gather(*others)


def nothing_is_bounded(patch):
    patch(ServingConnection, "pause_writing", lambda self: None)
    patch(ServingConnection, "must_wait", lambda self, call: False)


def nobody_is_cut_off(patch):
    patch(connection._Watch, "stalled", lambda self, now, unread, *, owes: False)


@pytest.mark.planted(
    Bug(nothing_is_bounded, "memory"), Bug(nobody_is_cut_off, "not cut off in time")
)
async def test_a_thousand_slow_peers_cost_little(counts, large, bug, programs):
    resource = pytest.importorskip("resource")
    if resource.getrlimit(resource.RLIMIT_NOFILE)[0] < 1500:
        pytest.skip("needs 1,500 descriptors")
    program = await programs.start(SERVING, ready="")
    async with taskrpc.Node("looking") as node:
        (entry,) = [each for each in await node.graph() if each.nodes == ("/server",)]
    host, _, port = entry.address.rpartition(":")
    siege = Siege(program, (host, int(port)), counts)
    for _ in range(5 if large else 1):
        # Peers that never read are enough to show a bug that keeps memory.
        dribblers = 0 if bug is not None and bug.breaks == "memory" else 10
        await siege.run(1000 if bug is None else 80, dribblers)
        siege.over = False
    counts["memory"] = max(0, counts["MiB grown"] - ALLOWED // MEBI)
    counts.check("memory", "not cut off in time", "neighbour troubles", happened=("cut off",))
    counts.require(never_read=80, neighbour_calls=100, MiB_grown=10)


# Floods

TAKING = """\
import asyncio, sys
import srvgen, taskrpc
from taskrpc.core.transport.limits import calls_in_flight as load
Text = srvgen.load("my_robot_interfaces/srv/RobotTask")
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
load.MAX_BYTES = int(sys.argv[1])

async def take(request, response):
    await asyncio.sleep(3)
    return response

def work(request, response):
    response.sum = request.a
    return response

async def main():
    async with taskrpc.Node("server") as node:
        node.create_service(Text, "take", take, concurrency=10_000)
        node.create_service(Add, "work", work)
        print("ready", flush=True)
        await node.spin()

asyncio.run(main())
"""
ALL = 64 * MEBI
LOOPS, EACH, SIZE = 40, 2, 4 * MEBI


def takes_whatever_comes(patch):
    patch(calls_in_flight.CallsInFlight, "refusal", lambda self, connection: None)


class Loop:
    """A program that creates many nodes, and requests more on each than it can receive."""

    def __init__(self, counts, stack):
        self.counts, self.stack = counts, stack
        self.calls = []

    async def run(self):
        request = Text.Request(target="x" * SIZE)
        for number in range(LOOPS):
            node = taskrpc.Node("loop", token=f"loop {number}")
            await self.stack.enter_async_context(node)
            client = node.create_client(Text, "take", timeout=60)
            assert await client.wait_for_service(10)
            self.calls += [asyncio.ensure_future(self.call(client, request)) for _ in range(EACH)]
            await asyncio.sleep(0.02)
        await asyncio.gather(*self.calls)

    async def call(self, client, request):
        self.counts["large requests"] += 1
        try:
            await client.call(request)
            self.counts["taken"] += 1
        except taskrpc.ServerBusy as error:
            self.counts["refused"] += 1
            self.counts["refused, and perhaps run"] += error.not_executed is not True


@pytest.mark.planted(Bug(takes_whatever_comes, "memory"))
async def test_flood_over_many_connections_gets_only_its_fair_share(counts, programs):
    program = await programs.start(TAKING, str(ALL), name="taking.py")
    before, over = memory(program.pid), False

    async def watch():
        while not over:
            counts["MiB grown"] = max(counts["MiB grown"], (memory(program.pid) - before) // MEBI)
            await asyncio.sleep(0.02)

    async def neighbour(client):
        while not over:
            counts["neighbour calls"] += 1
            counts["neighbour troubles"] += (
                await client.call(Add.Request(a=1), timeout=5)
            ).sum != 1
            await asyncio.sleep(0.01)

    async with contextlib.AsyncExitStack() as stack:
        node = await stack.enter_async_context(taskrpc.Node("neighbour", token="n"))
        client = node.create_client(Add, "work")
        assert await client.wait_for_service(10)
        others = [asyncio.ensure_future(each) for each in (watch(), neighbour(client))]
        await Loop(counts, stack).run()
        over = True
        await asyncio.gather(*others)
    # One caller may hold half; each request is read in pieces, joined, and decoded.
    counts["memory"] = max(0, counts["MiB grown"] - (ALL // 2 + 12 * SIZE) // MEBI)
    counts.check("memory", "refused, and perhaps run", happened=("refused", "taken"))
    counts.require(neighbour_calls=50)
