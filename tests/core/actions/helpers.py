"""An action, and nodes for it, in virtual time."""

from __future__ import annotations

import asyncio
import contextlib

import srvgen
import taskrpc

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")


def order(number):
    return Fibonacci.Goal(order=number)


def result(*numbers):
    return Fibonacci.Result(sequence=numbers)


def feedback(*numbers):
    return Fibonacci.Feedback(sequence=numbers)


async def echo(goal):
    """Return the order of the goal."""
    return result(goal.request.order)


async def wait_for_cancel(goal):
    await goal.wait_for_cancel()
    return goal.canceled(result(goal.request.order))


class Sleeper:
    """Sleeps for as many seconds as the order says; records which goals began."""

    def __init__(self):
        self.begun = []

    async def __call__(self, goal):
        self.begun.append(goal.request.order)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(goal.request.order):
                await goal.wait_for_cancel()
        ended = result(goal.request.order)
        return goal.canceled(ended) if goal.is_cancel_requested else ended


@contextlib.asynccontextmanager
async def programs(execute, *, client=(), node=(), **options):
    """Two programs: yields the server's node, the action server, and an action client.

    `client` and `node` are settings of the client and of the server's node.
    """
    memory = {"transport": "memory"}
    async with (
        taskrpc.Node("server", **memory, listen="server", **dict(node)) as served,
        taskrpc.Node("client", **memory, listen="client") as calling,
    ):
        server = served.create_action_server(Fibonacci, "fibonacci", execute, **options)
        caller = calling.create_action_client(Fibonacci, "fibonacci", **dict(client))
        assert await caller.wait_for_server(60)
        yield served, server, caller
