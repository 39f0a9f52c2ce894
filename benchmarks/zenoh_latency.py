"""The latency and throughput of calls over Zenoh, beside plain Zenoh queries.

    .venv/bin/python benchmarks/zenoh_latency.py [--calls N] [--rounds N]

A router and two servers run in processes of their own: a queryable of Zenoh's own library, and a
taskrpc program with `transport="zenoh"`. In each round, all clients call in turn, so that they see
the same load of the machine. The result is the median of each, and the median of the ratios of the
rounds: at most 1.4 times the latency of a plain query, and at least 0.75 of the throughput with 64
calls in flight.

Both sides have the same conditions: a declared querier or publisher, no batching where latency is
measured (`express`), 64 tasks of one event loop, and a hand-off that wakes the loop once for many
responses. The plain server answers in Zenoh's thread, without an event loop. One difference is
inherent: taskrpc puts the calls of one turn of the loop into one datagram, and their responses too,
while each query of Zenoh has a message of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import socket
import statistics
import subprocess
import sys
import time
from typing import Any

import zenoh

import srvgen
import taskrpc
from taskrpc.core.transport.tunnel.handoff import Handoff
from taskrpc.middleware.zenoh.configuration import configuration_of, router_configuration
from taskrpc.middleware.zenoh.session import open_session

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")
KEY, BATCHED_KEY = "benchmark/plain", "benchmark/batched"
REQUEST, RESPONSE = bytes(20), bytes(12)
IN_FLIGHT = 64
LATENCY_GOAL, THROUGHPUT_GOAL = 1.4, 0.75
QUERY = {
    "target": zenoh.QueryTarget.ALL_COMPLETE,
    "consolidation": zenoh.ConsolidationMode.NONE,
}


def serve_router(place: str) -> None:
    """Route until the process is killed."""
    with open_session(router_configuration(place)):
        print("ready", flush=True)
        time.sleep(3600)


def serve_plain(place: str) -> None:
    """Answer queries with Zenoh's library alone."""

    def answering(*, express: bool) -> Any:
        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(query.key_expr, RESPONSE, express=express)

        return zenoh.handlers.Callback(answer, lambda: None, indirect=False)

    with open_session(configuration_of([place])) as session:
        queryables = [
            session.declare_queryable(key, answering(express=express), complete=True)
            for key, express in ((KEY, True), (BATCHED_KEY, False))
        ]
        print("ready", flush=True)
        time.sleep(3600)
        del queryables


async def serve_ours(place: str) -> None:
    """Offer AddTwoInts with taskrpc."""

    def add(request, response):
        response.sum = request.a + request.b
        return response

    async with taskrpc.Node("server", transport="zenoh", peers=[place]) as node:
        node.create_service(ADD, "add", add)
        print("ready", flush=True)
        await node.spin()


class Plain:
    """Calls with Zenoh's library alone: one after the other, and many of them at once."""

    def __init__(self, session: zenoh.Session) -> None:
        self._queriers = {
            key: session.declare_querier(key, express=express, **QUERY)
            for key, express in ((KEY, True), (BATCHED_KEY, False))
        }

    async def latency(self, calls: int) -> float:
        """Return the median of blocking queries in seconds."""
        seconds = []
        for _ in range(calls):
            began = time.perf_counter()
            for reply in self._queriers[KEY].get(payload=REQUEST):
                assert reply.ok is not None
            seconds.append(time.perf_counter() - began)
        return statistics.median(seconds)

    async def throughput(self, calls: int) -> float:
        """Return queries per second with asyncio, 64 in flight: the better of both keys."""
        return max([await self._rate_of(key, calls) for key in self._queriers])

    async def _rate_of(self, key: str, calls: int) -> float:
        querier, loop = self._queriers[key], asyncio.get_running_loop()
        handoff = Handoff(loop)

        async def work(count: int) -> None:
            for _ in range(count):
                done = loop.create_future()
                handler = zenoh.handlers.Callback(
                    lambda reply, done=done: handoff.put(done.set_result, reply),
                    lambda: None,
                    indirect=False,
                )
                querier.get(handler, payload=REQUEST)
                await done

        return await _rate(work, calls)


class Ours:
    """Calls with taskrpc."""

    def __init__(self, client: taskrpc.Client) -> None:
        self._client = client

    async def latency(self, calls: int) -> float:
        """Return the median of calls, one after the other, in seconds."""
        seconds = []
        for _ in range(calls):
            began = time.perf_counter()
            await self._client.call(ADD.Request(a=2, b=3))
            seconds.append(time.perf_counter() - began)
        return statistics.median(seconds)

    async def throughput(self, calls: int) -> float:
        """Return calls per second with 64 in flight."""

        async def work(count: int) -> None:
            for _ in range(count):
                await self._client.call(ADD.Request(a=2, b=3))

        return await _rate(work, calls)


async def _rate(work, calls: int) -> float:
    began = time.perf_counter()
    await asyncio.gather(*[work(calls // IN_FLIGHT) for _ in range(IN_FLIGHT)])
    return calls // IN_FLIGHT * IN_FLIGHT / (time.perf_counter() - began)


async def measured(place: str, calls: int, rounds: int) -> dict[str, float]:
    """Return medians and ratios."""
    latencies, rates = [], []
    async with taskrpc.Node("client", transport="zenoh", peers=[place]) as node:
        client = node.create_client(ADD, "add")
        assert await client.wait_for_service(20), "no server"
        with open_session(configuration_of([place])) as session:
            plain, ours = Plain(session), Ours(client)
            for each in (plain, ours):
                await each.latency(calls)
            for _ in range(rounds):
                latencies.append([await each.latency(calls) for each in (plain, ours)])
                rates.append([await each.throughput(calls * 4) for each in (plain, ours)])
    ratio, share = (
        statistics.median(mine / other for other, mine in pairs) for pairs in (latencies, rates)
    )
    return {
        "plain, µs": round(statistics.median(each[0] for each in latencies) * 1e6, 1),
        "taskrpc, µs": round(statistics.median(each[1] for each in latencies) * 1e6, 1),
        f"latency ratio (goal at most {LATENCY_GOAL})": round(ratio, 2),
        "plain, calls/s": round(statistics.median(each[0] for each in rates)),
        "taskrpc, calls/s": round(statistics.median(each[1] for each in rates)),
        f"throughput ratio (goal at least {THROUGHPUT_GOAL})": round(share, 2),
    }


def main() -> None:
    """Run a server, or start all and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--serve", choices=["router", "plain", "ours"], help=argparse.SUPPRESS)
    parser.add_argument("--place", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve == "router":
        serve_router(options.place)
    elif options.serve == "plain":
        serve_plain(options.place)
    elif options.serve == "ours":
        asyncio.run(serve_ours(options.place))
    else:
        with socket.create_server(("127.0.0.1", 0)) as free:
            place = f"127.0.0.1:{free.getsockname()[1]}"
        servers = []
        try:
            for which in ("router", "plain", "ours"):
                command = [sys.executable, __file__, "--serve", which, "--place", place]
                servers.append(subprocess.Popen(command, stdout=subprocess.PIPE))
                assert servers[-1].stdout is not None
                servers[-1].stdout.readline()
            found = asyncio.run(measured(place, options.calls, options.rounds))
            print(json.dumps(found, indent=2, ensure_ascii=False))
        finally:
            for server in servers:
                server.kill()


if __name__ == "__main__":
    main()
