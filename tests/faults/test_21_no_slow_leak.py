"""Promise 21: after very many calls, some with faults, no object or timer is left."""

import asyncio
import collections
import contextlib
import gc
import os
import random

import pytest

import taskrpc
from taskrpc.core.transport.connection.deadline_timer import Deadlines
from taskrpc.core.transport.connection.dialling import Dialler
from taskrpc.core.transport.connection.incoming_call import RemoteCall
from taskrpc.errors import ConnectionLost
from tests.core.transport.helpers import Add, ask
from tests.faults.harness import Bug

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="needs /proc"),
]

CALLERS = 50
FAULTS = 0.01
OWN_TIMERS = 4  # timers for deadlines and ticks at either end may or may not be set
OURS = ("RemoteCall", "OpenCall", "RequestReceived", "ServingConnection", "CallingConnection")


async def work(request, response):
    await asyncio.sleep(0)
    response.sum = request.a
    return response


class Traffic:
    """Callers; some of their calls are cancelled, expire, or lose their connection."""

    def __init__(self, client, chance, counts):
        self.client, self.chance, self.counts = client, chance, counts
        self.policy = taskrpc.RetryPolicy(wait_initial=0.001)

    async def one(self):
        self.counts["calls"] += 1
        fault = self.chance.random() / FAULTS
        call = self.client.call_async(ask(1), timeout=0.0005 if 0.6 < fault < 1 else 30)
        if fault < 0.5:
            await asyncio.sleep(0)
            call.cancel()
            self.counts["cancelled"] += 1
        elif fault < 0.6 and (connection := self.client._channel._connection) is not None:
            connection.abort(ConnectionLost("the harness did it"))
            self.counts["connections lost"] += 1
        try:
            await call
            self.counts["answered"] += 1
        except asyncio.CancelledError:
            pass
        except taskrpc.DeadlineExceeded:
            self.counts["late"] += 1
        except taskrpc.TaskRpcError:
            self.counts["failed"] += 1

    async def run(self, calls):
        async def caller():
            for _ in range(calls // CALLERS):
                await self.one()

        await asyncio.gather(*[caller() for _ in range(CALLERS)])


async def belongings(client):
    """Counts of objects while one connection is open and no call is in flight."""
    for _ in range(100):
        with contextlib.suppress(taskrpc.TaskRpcError):
            await client.call(ask(1))
            break
    await asyncio.sleep(0.3)
    gc.collect()
    names = collections.Counter(type(each).__name__ for each in gc.get_objects())
    timers = [each for each in asyncio.get_running_loop()._scheduled if not each.cancelled()]
    return {
        "tasks": len(asyncio.all_tasks()),
        "descriptors": len(os.listdir("/proc/self/fd")),
        "timers": len(timers),
        **{name: names[name] for name in OURS},
    }


def timers_run_on(patch):
    patch(Deadlines, "close", lambda self: None)


def lost_connections_are_kept(patch):
    kept, ended = [], Dialler.ended
    patch(
        Dialler,
        "ended",
        lambda self, connection: kept.append(connection) or ended(self, connection),
    )


def calls_are_kept(patch):
    kept, fail = [], RemoteCall.fail
    patch(RemoteCall, "fail", lambda self, error: kept.append(self) or fail(self, error))


def descriptors_are_kept(patch):
    kept, ended = [], Dialler.ended

    def hoarding(self, connection):
        kept.append(os.open(os.devnull, os.O_RDONLY))
        ended(self, connection)

    patch(Dialler, "ended", hoarding)


@pytest.mark.planted(
    Bug(timers_run_on, "timers"),
    Bug(lost_connections_are_kept, "CallingConnection"),
    Bug(calls_are_kept, "RemoteCall"),
    Bug(descriptors_are_kept, "descriptors"),
)
async def test_many_calls_with_faults_leave_nothing_behind(counts, seed, large, bug):
    calls = 10**7 if large else 10**5 if bug is None else 10**4
    async with (
        taskrpc.Node("server", token="s") as server,
        taskrpc.Node("client", token="c") as node,
    ):
        server.create_service(Add, "work", work, concurrency=1000)
        client = node.create_client(Add, "work")
        assert await client.wait_for_service(5)
        traffic = Traffic(client, random.Random(seed), counts)
        await traffic.run(1000)
        before = await belongings(client)
        await traffic.run(calls)
        after = await belongings(client)
    for what, count in after.items():
        counts[what] = max(0, count - before[what] - (OWN_TIMERS if what == "timers" else 0))
    counts.check(*after, happened=("cancelled", "late", "connections lost", "answered"))
    counts.require(calls=calls)
