"""Callbacks and waiting that several transport tests need."""

from __future__ import annotations

import asyncio

import srvgen
import taskrpc

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
Text = srvgen.load("my_robot_interfaces/srv/RobotTask")


def add(request, response):
    response.sum = request.a + request.b
    return response


def ask(a=0, b=0):
    return Add.Request(a=a, b=b)


class Gate:
    """An async callback that waits until the test opens it, and records how it ended."""

    def __init__(self):
        self.opened = asyncio.Event()
        self.started = []
        self.cancelled = []
        self.answered = []

    async def __call__(self, request, response):
        self.started.append(request.a)
        try:
            await self.opened.wait()
        except asyncio.CancelledError:
            self.cancelled.append(request.a)
            raise
        self.answered.append(request.a)
        response.sum = request.a
        return response


PATIENCE = 60
"""Seconds that `until` and `until_seen` wait."""


async def until(condition, seconds=PATIENCE):
    """Return once `condition()` is true; fail if it never is."""
    async with asyncio.timeout(seconds):
        while not condition():
            await asyncio.sleep(0.002)


async def until_seen(node, condition):
    """Return once `condition(entries)` is true for the graph that the node sees."""
    async with asyncio.timeout(PATIENCE):
        while not condition(await node.graph()):
            await asyncio.sleep(0.002)


async def outcome(awaitable):
    """Return the response, or the error without raising it."""
    try:
        return await awaitable
    except taskrpc.TaskRpcError as error:
        return error


FAST = taskrpc.RetryPolicy(wait_initial=0.001, wait_jitter=0)


async def served(net, callback=add, name="add", srv_type=Add, **options):
    """A server and its client, each with its own endpoint."""
    server = await net.node("server")
    server.create_service(srv_type, name, callback, **options)
    client = await net.client(srv_type, name)
    assert await client.wait_for_service(60)
    return server, client
