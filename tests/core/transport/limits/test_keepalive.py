"""Each end drops a lost machine after the time of its own profile, and no other machine."""

import asyncio
import contextlib
import socket
import struct
import sys

import pytest

import taskrpc
from taskrpc.core.transport.limits.keepalive import _INFO as INFO
from taskrpc.core.transport.limits.keepalive import PROFILES, TcpTimeouts, drop_dead_peers
from taskrpc.core.transport.tcp.tcp_network import listening_socket
from taskrpc.core.wire.frames import FrameType
from taskrpc.testing import FaultyNetwork
from tests.core.transport.helpers import Add, Gate, ask, until


@contextlib.asynccontextmanager
async def apart(server_options, client_options):
    """A server, its callback and a client on machines of their own."""
    gate = Gate()
    with FaultyNetwork(seed=3) as network:
        async with (
            taskrpc.Node("s", transport="memory", listen="server", **server_options) as server,
            taskrpc.Node("c", transport="memory", listen="client", **client_options) as node,
        ):
            server.create_service(Add, "add", gate)
            client = node.create_client(Add, "add", timeout=None)
            assert await client.wait_for_service(60)
            yield network, gate, client


@pytest.mark.parametrize(("profile", "seconds"), [("default", 8.0), ("robot", 2.0)])
async def test_a_call_into_a_hole_is_given_up_when_the_callers_profile_says(profile, seconds):
    async with apart({}, {"keepalive": profile}) as (network, _, client):
        network.partition("client", "server")
        began = asyncio.get_running_loop().time()
        with pytest.raises(taskrpc.OutcomeUnknown):
            await client.call(ask())
        assert asyncio.get_running_loop().time() - began == pytest.approx(seconds)


async def test_a_peer_that_does_not_answer_is_pinged_once_per_silence():
    async with apart({}, {}) as (network, _, client):
        connection = client._channel._connection
        loop, asked = asyncio.get_running_loop(), []
        write = connection.transport.write

        def recorded(data):
            if data[4] == FrameType.PING:
                asked.append(loop.time())
            write(data)

        connection.transport.write = recorded
        network.partition("client", "server")
        began = loop.time()
        await until(lambda: not connection.is_open, 60)
        # The first ping is due after 5 s, and the connection ends 8 s later.
        assert [time - began for time in asked] == pytest.approx([5.0, 10.0], abs=1.01)


@pytest.mark.parametrize(("profile", "seconds"), [("default", 5 + 1 + 8), ("robot", 1 + 1 + 2)])
async def test_a_server_stops_work_for_a_dead_caller_when_its_own_profile_says(profile, seconds):
    """In memory only this framework sends pings, within a second after the silence."""
    async with apart({"keepalive": profile}, {}) as (network, gate, client):
        call = client.call_async(ask())
        await until(lambda: gate.started)
        network.partition("client", "server")
        began = asyncio.get_running_loop().time()
        await until(lambda: gate.cancelled, 60)
        assert asyncio.get_running_loop().time() - began <= seconds + 0.01
        network.heal()
        call.cancel()


async def test_a_busy_peer_is_never_given_up_by_the_quicker_profile():
    async with apart({}, {"keepalive": "robot"}) as (network, gate, client):
        call = client.call_async(ask(1))
        await asyncio.sleep(600)
        gate.opened.set()
        assert (await call).sum == 1
        assert not network.happened["deaths"]


async def test_the_environment_chooses_where_the_program_does_not(monkeypatch):
    monkeypatch.setenv("TASKRPC_KEEPALIVE", "robot")
    for keepalive, profile in ((None, "robot"), ("default", "default")):
        async with taskrpc.Node("n", transport="memory", keepalive=keepalive) as node:
            assert node._transport.keepalive is PROFILES[profile]


@pytest.mark.parametrize(
    ("given", "environment", "where"),
    [("fast", "robot", "keepalive"), (None, "fast", "TASKRPC_KEEPALIVE")],
)
async def test_an_unknown_profile_is_refused_with_its_source(
    given, environment, where, monkeypatch
):
    monkeypatch.setenv("TASKRPC_KEEPALIVE", environment)
    problem = rf"^{where}: expected default or robot, got 'fast'$"
    with pytest.raises(taskrpc.TaskRpcError, match=problem):
        await taskrpc.Node("n", transport="memory", keepalive=given).start()


async def test_nodes_with_different_profiles_have_connections_of_their_own():
    async with (
        taskrpc.Node("a", transport="memory", keepalive="robot") as a,
        taskrpc.Node("b", transport="memory", keepalive="robot") as b,
        taskrpc.Node("c", transport="memory") as c,
    ):
        assert a._transport is b._transport
        assert a._transport is not c._transport


@pytest.mark.real_time
@pytest.mark.skipif(sys.platform != "linux", reason="the options' names and units are Linux's")
@pytest.mark.parametrize("profile", PROFILES)
async def test_both_ends_set_the_kernel_timeouts(profile):
    keepalive = PROFILES[profile]
    with contextlib.closing(listening_socket("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    async with (
        taskrpc.Node("s", listen=place, token="s", keepalive=profile) as server,
        taskrpc.Node("c", token="c", keepalive=profile) as node,
    ):
        server.create_service(Add, "add", Gate())
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(60)
        for end in (client._channel._connection, *server._transport._served):
            option = end.transport.get_extra_info("socket").getsockopt
            assert option(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
            assert option(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == keepalive.silence
            probes = option(socket.IPPROTO_TCP, socket.TCP_KEEPCNT)
            interval = option(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL)
            assert keepalive.silence + probes * interval == keepalive.dead_after
            unacknowledged = option(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
            assert keepalive.dead_after - 0.5 < unacknowledged / 1000 < keepalive.dead_after


@pytest.mark.real_time
async def test_an_idle_connection_keeps_nothing_for_a_full_peer():
    async with taskrpc.Node("s", token="s") as server, taskrpc.Node("c", token="s") as node:
        server.create_service(Add, "add", Gate())
        assert await node.create_client(Add, "add").wait_for_service(5)
        (served,) = server._transport._served

        def is_idle_after_a_look():
            served.tick(asyncio.get_running_loop().time())
            return served._tcp_timeouts is None

        await until(is_idle_after_a_look)


@pytest.mark.real_time
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux takes the full for dead")
async def test_a_peer_with_a_full_buffer_is_kept_until_it_reads():
    loop = asyncio.get_running_loop()
    with contextlib.ExitStack() as stack:
        listening = stack.enter_context(listening_socket("127.0.0.1", 0))
        sender = stack.enter_context(socket.create_connection(listening.getsockname()))
        await asyncio.sleep(0)
        reader = stack.enter_context((await loop.sock_accept(listening))[0])
        sender.setblocking(False)
        drop_dead_peers(sender, *PROFILES["robot"])
        patience = TcpTimeouts(sender, PROFILES["robot"])

        def borne():
            return sender.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)

        usual = borne()
        assert usual > 0
        assert not patience.is_over()
        assert borne() == usual, "all was delivered"
        written = sender.send(b"x" * 1_000_000)
        await until(lambda: patience.is_over() or not borne())
        assert not patience.is_over()
        while written:
            written -= len(await loop.sock_recv(reader, 100_000))
        await until(lambda: patience.is_over() or borne() == usual)


class Ending:
    """A socket that is full and then closed, with the errors of asyncio or uvloop."""

    error = None

    def setsockopt(self, *_):
        if self.error is not None:
            raise self.error

    def getsockopt(self, level, option, size):
        self.setsockopt()
        return struct.pack(INFO, 0, 0, 10, 5000, 0)


@pytest.mark.skipif(sys.platform != "linux", reason="the answer is Linux's")
@pytest.mark.parametrize("error", [OSError(9, "bad file descriptor"), ValueError("negative")])
def test_a_full_connection_that_has_just_ended_is_no_trouble(error):
    sock = Ending()
    patience = TcpTimeouts(sock, PROFILES["robot"])
    assert not patience.is_over()
    sock.error = error
    assert not patience.is_over()
