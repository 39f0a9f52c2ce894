"""Promise 13: garbage ends one connection with one log line, and no other client notices."""

import asyncio
import collections
import contextlib
import logging
import os
import random
import re
import time
from typing import get_args

import pytest

import srvgen
import taskrpc
from taskrpc.core.transport import endpoint
from taskrpc.core.transport.connection.server_side import ServingConnection
from taskrpc.core.wire import messages
from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import Closed, Event
from taskrpc.core.wire.frames import HEADER, NO_DEADLINE, FrameType, Splitter
from taskrpc.core.wire.handshake import Identity, Peer
from taskrpc.core.wire.messages import DEFAULT_LIMITS, Auth, Hello, HelloAck, Resolve, encode
from taskrpc.core.wire.session import Session
from taskrpc.errors import TaskRpcError
from tests.faults.attacker import Line, questions
from tests.faults.harness import Bug
from tests.faults.test_22_attacker import any_proof_accepted

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs /proc"),
]

DRIFT = 64 * 1024 * 1024
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
HANG = 5.0  # seconds for a few kilobytes
DOCUMENTED = get_args(Event)
TOKEN = b"known to both"
CLIENT, SERVER = (Identity(name * 16, name * 16, TOKEN) for name in (b"C", b"S"))


def memory(pid="self"):
    """Resident bytes of a process."""
    with open(f"/proc/{pid}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def drift(before, pid="self"):
    """Bytes beyond the allowed growth since the memory was `before`."""
    return max(0, memory(pid) - before - DRIFT)


# What is sent

HELLO = encode(Hello(1, 1, b"C" * 16, b"c" * 16, 0, "/caller"))
BODIES = [
    b"", b"\x92\x01\x02", encode(Resolve("/work")), encode(Resolve("")), HELLO,
    encode(HelloAck(1, b"S" * 16, b"s" * 16, DEFAULT_LIMITS)), encode(Auth(bytes(32))),
    b"\x92\xcf" + b"\xff" * 8 + b"\x01", b"\x91" * 2000, b"\x91\xa1\xff", b"\xdd\xff\xff\xff\xff",
]  # fmt: skip
KINDS = 8
TYPES = [*range(max(FrameType) + 2), 0x7F, 0x80, 0xFF]
LENGTHS = [0, 1, 11, 12, 0xFFFFFFFF, 0x7FFFFFFF, DEFAULT_LIMITS.body + 13]


class Mutator:
    """Frames of a peer, each with no, one or several mistakes."""

    def __init__(self, seed):
        self.chance = random.Random(seed)
        self.kinds = collections.Counter()
        self.call_id = 0

    def frame(self):
        chance = self.chance.random
        self.call_id += 1
        kind = int(chance() * KINDS)
        type_ = 7 if chance() < 0.4 else TYPES[int(chance() * len(TYPES))]
        body = BODIES[int(chance() * len(BODIES))]
        header = [len(body) + 12, type_, 0, int(chance() * 3), self.call_id, NO_DEADLINE]
        self.kinds[kind] += 1
        if kind == 1:
            header[0] = LENGTHS[int(chance() * len(LENGTHS))]
        elif kind == 2:
            header[2] = int(chance() * 256)
        elif kind == 3:
            header[4] = int(chance() * 2**32) if chance() < 0.5 else self.call_id // 2
        elif kind == 4:
            header[5] = int(chance() * 2**32)
        data = bytearray(HEADER.pack(*header) + body)
        if kind == 5:
            data[int(chance() * len(data))] = int(chance() * 256)
        elif kind == 6:
            del data[int(chance() * len(data)) :]
        elif kind == 7:
            data += self.chance.randbytes(int(chance() * 20))
        return bytes(data)

    def stream(self, count):
        return (self.frame() for _ in range(count))


# Against the session itself


def opened(*, is_client):
    """A session after its handshake, created in a tenth of a handshake's time."""
    end = Session(CLIENT if is_client else SERVER, is_client=is_client)
    end._magic_seen = True
    end._open(Peer(b"P" * 16, "/peer", DEFAULT_LIMITS))
    if is_client:
        for ticket in range(20):
            end.request(ticket, 1, b"", 1000)
    return end


def greeted(*, is_client):
    end = Session(CLIENT if is_client else SERVER, is_client=is_client)
    if not is_client:
        list(end.feed(b"TRPC"))
    return end


def lies_about_length(frame):
    length = int.from_bytes(frame[:4], "little")
    return len(frame) >= HEADER.size and not 12 <= length <= DEFAULT_LIMITS.body + 12


def hear(end, frame, counts):
    """Feed one frame, and count violations."""
    clean = end.state is ConnectionState.OPEN and not end.mid_frame
    counts["frames"] += 1
    try:
        events = list(end.feed(frame))
    except Exception:
        logging.exception("a mutated frame: %r", frame)
        counts["crashes"] += 1
        return
    ends = [place for place, each in enumerate(events, 1) if type(each) is Closed]
    counts["undocumented"] += not all(isinstance(each, DOCUMENTED) for each in events)
    counts["not the last word"] += bool(ends) and ends != [len(events)]
    reasons = [events[place - 1].error for place in ends]
    counts["no reason"] += not all(isinstance(each, TaskRpcError) for each in reasons)
    if clean and lies_about_length(frame):
        counts["lies"] += 1
        counts["believed"] += end.state is not ConnectionState.CLOSED
    if end.state is ConnectionState.CLOSED:
        counts["closed"] += 1
        counts["heard after the end"] += bool(list(end.feed(frame)))


def bombard(frames, seed, counts):
    """Feed mutated frames to sessions until this many were accepted."""
    mutator = Mutator(seed)
    while counts["frames"] < frames:
        make = greeted if mutator.chance.random() < 0.05 else opened
        end = make(is_client=mutator.chance.random() < 0.3)
        mutator.call_id = 0
        began = time.monotonic()
        for frame in mutator.stream(20):
            hear(end, frame, counts)
            if end.state is ConnectionState.CLOSED:
                break
        counts["hangs"] += time.monotonic() - began > HANG
    assert len(mutator.kinds) == KINDS


def lengths_are_believed(patch):
    patch(Splitter, "_bad_length", lambda self, length: None)


def errors_get_out(patch):
    patch(messages, "decode_resolve", messages.msgspec.msgpack.Decoder(Resolve).decode)


def the_end_is_overheard(patch):
    patch(Session, "_closed", lambda self, error: Closed(error))


def what_is_closed_is_kept(patch):
    hoard, closed = [], Session._closed

    def hoarding(self, error):
        hoard.append(bytes(10_000))
        return closed(self, error)

    patch(Session, "_closed", hoarding)


@pytest.mark.planted(
    Bug(lengths_are_believed, "believed"),
    Bug(errors_get_out, "crashes"),
    Bug(the_end_is_overheard, "believed"),
    Bug(what_is_closed_is_kept, "drifted"),
)
def test_mutated_frames_raise_nothing_and_leave_nothing(counts, seed, large, bug):
    frames = 10**9 if large else 150_000 if bug is None else 50_000
    bombard(10_000, seed, collections.Counter())
    before = memory()
    bombard(frames, seed + 1, counts)
    counts["drifted"] = drift(before)
    broken = ("crashes", "undocumented", "not the last word", "no reason", "believed", "hangs")
    counts.check(*broken, "heard after the end", "drifted", happened=("closed", "lies"))


# Against a server that listens

SERVING = """\
import asyncio, logging, sys
import srvgen, taskrpc
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
logging.basicConfig(filename=sys.argv[1], level="INFO")

def work(request, response):
    response.sum = request.a
    return response

async def main():
    async with taskrpc.Node("server", token="known to both") as node:
        node.create_service(Add, "work", work)
        print(node.address, flush=True)
        await node.spin()

taskrpc.run(main())
"""

Add = srvgen.load("example_interfaces/srv/AddTwoInts")

NEIGHBOUR = """\
import asyncio, sys, time
import srvgen, taskrpc
Add = srvgen.load("example_interfaces/srv/AddTwoInts")

async def p99(client, seconds):
    took, ends = [], time.perf_counter() + seconds
    while (began := time.perf_counter()) < ends:
        await client.call(Add.Request(a=1), timeout=5)
        took.append(time.perf_counter() - began)
        await asyncio.sleep(0.002)
    return sorted(took)[int(0.99 * len(took))]

async def main():
    async with taskrpc.Node("measuring", peers=[sys.argv[1]], token="known to both") as node:
        client = node.create_client(Add, "work")
        await client.wait_for_service(5)
        await p99(client, 0.5)
        print("ready", flush=True)
        while line := await asyncio.to_thread(sys.stdin.readline):
            print(await p99(client, float(line)), flush=True)

asyncio.run(main())
"""
"""Reads for how many seconds to call, and prints the slowest hundredth of the call times."""


async def shake_hands(reader, writer):
    """Authenticate as a caller."""
    me = Identity(os.urandom(16), os.urandom(16), TOKEN, name="/hostile")
    session = Session(me, is_client=True)
    while session.state is ConnectionState.HANDSHAKE:
        writer.write(b"".join(session.take()))
        if not (data := await reader.read(65_536)):
            raise ConnectionResetError("closed in the handshake")
        list(session.feed(data))


class Attack:
    """Connections that send garbage, and another client that continues to call."""

    def __init__(self, program, place, counts, seed):
        host, _, port = place.rpartition(":")
        self.program, self.place, self.where = program, place, (host, int(port))
        self.counts = counts
        self.mutator = Mutator(seed)
        self.ports = collections.Counter()
        """How many connections there were from each; the system gives a port more than once."""
        self.over = False

    async def one(self, number):
        reader, writer = await asyncio.open_connection(*self.where)
        self.ports[writer.get_extra_info("sockname")[1]] += 1
        try:
            async with asyncio.timeout(HANG):
                if number % 10:
                    await shake_hands(reader, writer)
                elif number % 20:
                    await self.pretend(reader, writer)
                frames = list(self.mutator.stream(50))
                self.counts["frames"] += len(frames)
                writer.write(b"".join(frames))
                writer.write_eof()
                await reader.read()
        except TimeoutError:
            self.counts["hangs"] += 1
        except OSError:
            pass  # closed while this side still wrote
        finally:
            writer.close()

    async def pretend(self, reader, writer):
        """Request work although the server has refused the proof."""
        line = Line(reader, writer, b"")
        with contextlib.suppress(EOFError):
            await line.hello()
        line.auth(line.proof("guess"))
        line.send(questions("/work", ("/none", "", "")))
        heard = await line.listen()
        self.counts["refused a proof"] += bool(heard.refusals)
        self.counts["served without a proof"] += heard.let_in

    async def neighbour(self):
        async with taskrpc.Node("neighbour", peers=[self.place], token=TOKEN.decode()) as node:
            client = node.create_client(Add, "work")
            while not self.over:
                self.counts["neighbour calls"] += 1
                with contextlib.suppress(taskrpc.TaskRpcError):
                    answer = await client.call(Add.Request(a=self.counts["neighbour calls"]))
                    self.counts["neighbour answers"] += answer.sum == self.counts["neighbour calls"]
                await asyncio.sleep(0.002)

    async def run(self, connections):
        calling = asyncio.ensure_future(self.neighbour())
        for start in range(0, connections, 20):
            if start == 200:
                before = memory(self.program.pid)
            await asyncio.gather(*[self.one(start + number) for number in range(20)])
        self.over = True
        await calling
        self.counts["neighbour troubles"] = (
            self.counts["neighbour calls"] - self.counts["neighbour answers"]
        )
        self.counts["drifted"] = drift(before, self.program.pid)
        self.counts["crashes"] += self.program.poll() is not None

    def read(self, log):
        text = log.read_text()
        told = collections.Counter(map(int, re.findall(r"127\.0\.0\.1:(\d+)", text)))
        self.counts["ended with a line"] = (told & self.ports).total()
        self.counts["lines too many"] = sum(
            count for port, count in (told - self.ports).items() if self.ports[port]
        )
        self.counts["crashes"] += text.count("Traceback")


def a_line_too_many(patch):
    refuse = ServingConnection._refuse

    def talkative(self, error):
        refuse(self, error)
        refuse(self, error)

    patch(ServingConnection, "_refuse", talkative)


def one_ends_all(patch):
    def refuse(self, error):
        for each in list(self.server._served):
            each.abort(error)

    patch(ServingConnection, "_refuse", refuse)


def connections_are_kept(patch):
    kept, ended = [], endpoint.Endpoint.connection_ended

    def hoarding(self, connection):
        kept.append(bytearray(400_000))
        ended(self, connection)

    patch(endpoint.Endpoint, "connection_ended", hoarding)


@pytest.mark.planted(
    Bug(a_line_too_many, "lines too many"),
    Bug(one_ends_all, "neighbour troubles"),
    Bug(connections_are_kept, "drifted"),
    Bug(any_proof_accepted, "served without a proof"),
)
async def test_hostile_connection_ends_with_one_log_line_and_others_continue(
    counts, seed, large, bug, programs, tmp_path
):
    log = tmp_path / "log"
    program = await programs.start(SERVING, str(log), ready="")
    place = next(entry.address for entry in await entries() if entry.nodes == ("/server",))
    attack = Attack(program, place, counts, seed)
    await attack.run(100_000 if large else 1000 if bug is None else 600)
    attack.read(log)
    broken = ("crashes", "hangs", "drifted", "lines too many", "neighbour troubles")
    happened = ("ended with a line", "refused a proof") if bug is None else ()
    counts.check(*broken, "served without a proof", happened=happened)
    counts.require(neighbour_calls=20, frames=20_000)


def thinks_long_about_each_offence(patch):
    refuse = ServingConnection._refuse

    def slow(self, error):
        time.sleep(0.02)
        refuse(self, error)

    patch(ServingConnection, "_refuse", slow)


@contextlib.contextmanager
def cores_apart(*pids):
    """Put these processes on one core, and this one on another."""
    before = os.sched_getaffinity(0)
    ours, theirs, *_ = before
    for pid in pids:
        os.sched_setaffinity(pid, {theirs})
    os.sched_setaffinity(0, {ours})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@pytest.mark.skipif(CORES < 2, reason="needs two processor cores")
@pytest.mark.planted(Bug(thinks_long_about_each_offence, "neighbour slowed"))
async def test_other_clients_get_their_responses_hardly_later(
    counts, seed, large, programs, tmp_path
):
    server = await programs.start(SERVING, str(tmp_path / "log"), ready="")
    place = next(entry.address for entry in await entries() if entry.nodes == ("/server",))
    neighbour = await programs.start(NEIGHBOUR, place, name="neighbour.py")

    async def slowest(seconds):
        neighbour.stdin.write(f"{seconds}\n")
        neighbour.stdin.flush()
        return float(await asyncio.to_thread(neighbour.stdout.readline))

    attack = Attack(server, place, counts, seed)
    with cores_apart(server.pid, neighbour.pid):
        alone = await slowest(10 if large else 2)
        measured = asyncio.ensure_future(slowest(60 if large else 4))
        while not measured.done():
            await asyncio.gather(*[attack.one(number) for number in range(20)])
    counts["alone: p99 in us"], counts["under attack: p99 in us"] = (
        round(each * 1_000_000) for each in (alone, await measured)
    )
    # At most twice as long; on a busy machine only an unmistakable delay counts.
    allowed = 2 * alone + 0.001 if large else 5 * alone + 0.01
    counts["neighbour slowed"] = await measured > allowed
    counts.check("neighbour slowed", "hangs", happened=("frames",))


async def entries():
    async with taskrpc.Node("looking") as node:
        return await node.graph()
