"""Runs a small system with faults once for each seed, and prints a digest of each run.

`python -m tests.core.testing.one_seed FIRST COUNT [PLANT | --show]`; `--show` prints the traces.
A PLANT makes the runs depend on something else than their seed; see `PLANTS`.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import random
import sys
import time
from functools import partial

import pytest

import srvgen
import taskrpc
from taskrpc.core import attempts, introspection
from taskrpc.core.storage import writer
from taskrpc.testing import FaultyNetwork, VirtualTimeLoop
from taskrpc.testing.faulty_connections import Direction

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
String = srvgen.load("std_msgs/msg/String")
Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
SERVICES = ["once", "often", "perhaps"]
LIMITED = taskrpc.RetryPolicy(attempt_timeout=3.0)


class Trace(logging.Handler):
    """Everything that can be seen of a run, with its virtual time: bytes, log lines, outcomes."""

    def __init__(self, loop):
        super().__init__(logging.DEBUG)
        self.lines = []
        self._loop = loop

    def add(self, *facts):
        self.lines.append(f"{self._loop.time():.9f} {facts}")

    def emit(self, record):
        if record.name != "asyncio":
            self.add(record.name, record.getMessage())


def traced(trace, send):
    """`Direction.send`, with a line in the trace for the bytes."""

    def wrapper(direction, data):
        trace.add(direction._source, direction._target, bytes(data))
        send(direction, data)

    return wrapper


async def robot(stop, runs, store):
    """Offer three kinds of services and a topic; crash and start again until `stop` is set."""

    async def add(request, response):
        runs.append(request.a)
        await asyncio.sleep(0.05 * (request.a % 4))
        response.sum = request.a + request.b
        return response

    async with taskrpc.Node("robot", transport="memory", listen="robot") as node:
        node.create_service(Add, "once", add, exactly_once=store)
        node.create_service(Add, "often", add, idempotent=True, concurrency=4)
        node.configure_introspection(node.create_service(Add, "perhaps", add), "metadata")
        node.create_action_server(Fibonacci, "count", count)
        publisher = node.create_publisher(String, "news")
        number = 0
        while not stop.is_set():
            number += 1
            publisher.publish(String(data=f"news {number}"))
            await asyncio.sleep(0.5)


async def count(goal):
    """Count up to the goal, with feedback."""
    numbers = []
    for number in range(goal.request.order):
        numbers.append(number)
        goal.publish_feedback(Fibonacci.Feedback(sequence=numbers))
        await asyncio.sleep(0.2)
    return Fibonacci.Result(sequence=numbers)


async def count_to(node, trace, name, order):
    """Send a goal, and wait for its result."""
    client = node.create_action_client(Fibonacci, "count")
    try:
        handle = await client.send_goal(Fibonacci.Goal(order=order), timeout=8.0)
        outcome = list((await handle.result(timeout=8.0)).sequence)
    except taskrpc.TaskRpcError as error:
        outcome = type(error).__name__, str(error)
    trace.add(name, "count", outcome)


async def user(name, trace):
    """Call the services, send goals, and subscribe to the topic."""
    async with taskrpc.Node(name, transport="memory", listen=name) as node:
        node.create_subscription(String, "news", lambda message: trace.add(name, message.data))
        node.create_subscription(
            Add.Event, "perhaps/_service_event", lambda event: trace.add(name, event.info.stamp)
        )
        policies = {"once": LIMITED, "often": LIMITED, "perhaps": taskrpc.RetryPolicy()}
        clients = {each: node.create_client(Add, each, retry=it) for each, it in policies.items()}

        async def call(service, number):
            request = Add.Request(a=number, b=1)
            try:
                outcome = (await clients[service].call(request, timeout=12.0)).sum
            except taskrpc.TaskRpcError as error:
                outcome = type(error).__name__, str(error), error.not_executed
            trace.add(name, service, number, outcome)

        for number in range(4):
            async with asyncio.TaskGroup() as group:
                for service in SERVICES:
                    group.create_task(call(service, number))
                group.create_task(count_to(node, trace, name, number))
            await asyncio.sleep(0.3)


async def system(seed, trace):
    """Two users call a robot over a network with faults; the robot is away for some time."""
    runs, stop = [], asyncio.Event()
    store = taskrpc.SqliteCompletions(":memory:")  # in a thread of its own, as with a file
    with FaultyNetwork(seed, delay=(0.0, 0.2), pieces=400, cut_after=6000, refuse=0.2) as network:
        first = asyncio.create_task(robot(stop, runs, store))
        users = [asyncio.create_task(user(name, trace)) for name in ("ada", "ben")]
        await asyncio.sleep(1.5)
        network.partition("ada", "robot")
        await asyncio.sleep(1.0)
        network.heal()
        network.crash("robot")
        stop.set()
        await first
        await asyncio.sleep(1.0)
        stop.clear()
        second = asyncio.create_task(robot(stop, runs, store))
        await asyncio.gather(*users)
        stop.set()
        await second
    await store.close()
    trace.add("runs", runs, dict(network.happened))


def run(seed):
    """The trace of one run, as lines."""
    with asyncio.Runner(loop_factory=partial(VirtualTimeLoop, seed)) as runner:
        loop = runner.get_loop()
        trace, root = Trace(loop), logging.getLogger("taskrpc")
        root.addHandler(trace)
        root.setLevel(logging.DEBUG)
        root.propagate = False
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Direction, "send", traced(trace, Direction.send))
            runner.run(system(seed, trace))
        root.removeHandler(trace)
    return trace.lines


def use_global_generator():
    attempts.present_chance = lambda: random


def use_chance_of_the_system():
    writer.give_chance = lambda _: None


def use_time_of_the_machine():
    introspection.time_of_day_ns = time.time_ns


def use_order_of_a_set():
    SERVICES[:] = set(SERVICES)


PLANTS = {
    "global-generator": use_global_generator,
    "order-of-a-set": use_order_of_a_set,
    "chance-of-the-system": use_chance_of_the_system,
    "time-of-the-machine": use_time_of_the_machine,
}


def main(first, count, *options):
    for plant in options:
        PLANTS.get(plant, lambda: None)()
    for seed in range(int(first), int(first) + int(count)):
        lines = run(seed)
        print(seed, len(lines), hashlib.sha256("\n".join(lines).encode()).hexdigest(), flush=True)
        if "--show" in options:
            print("\n".join(lines))


if __name__ == "__main__":
    main(*sys.argv[1:])
