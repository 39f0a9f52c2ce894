"""Counts the functions that Python code calls in fixed pieces of work: `python -m tests.steps`.

Everything happens in one process, over the memory transport, on virtual time and after a warm-up,
so that the counts are the same each time and on every machine. `--update` writes them into
`steps.json` as the figures of this Python.
"""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import srvgen
import taskrpc
from taskrpc.core.transport.shared_endpoint import TRANSPORTS, Registration
from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from taskrpc.robot.tasks.records.store import MemoryStore
from taskrpc.testing import VirtualTimeLoop

FIGURES = Path(__file__).with_name("steps.json")
VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"
CALLS, IN_FLIGHT, SERVICES, TASKS = 1000, 20, 100, 200
PAYLOAD = 65_536

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
Submit = srvgen.load("my_robot_interfaces/srv/RobotTask")
Int32 = srvgen.load("std_msgs/msg/Int32")
Types = srvgen.load("rcl_interfaces/srv/GetParameterTypes")  # takes texts, answers with bytes

Work: TypeAlias = Callable[[], Awaitable[Any]]


def add(request: Any, response: Any) -> Any:
    response.sum = request.a + request.b
    return response


async def add_later(request: Any, response: Any) -> Any:
    await asyncio.sleep(0)
    return add(request, response)


def types(request: Any, response: Any) -> Any:
    response.types = request.names[0].encode()
    return response


@asynccontextmanager
async def connected(
    srv_type: Any,
    callback: Any,
    *,
    once: bool = False,
    beside_once: bool = False,
    transport: str = "memory",
    **options: Any,
) -> AsyncIterator[Any]:
    """A client in one process, so to speak, and its server in another."""
    store = taskrpc.MemoryCompletions() if once else None
    async with (
        taskrpc.Node("server", transport=transport, listen="server") as server,
        taskrpc.Node("client", transport=transport, listen="client") as node,
    ):
        server.create_service(srv_type, "work", callback, concurrency=IN_FLIGHT, exactly_once=store)
        if beside_once:
            other = node.create_client(Add, "once")
            server.create_service(Add, "once", add, exactly_once=taskrpc.MemoryCompletions())
            await other.call(_two_ints)
        client = node.create_client(srv_type, "work", **options)
        await client.wait_for_service()
        yield client


def calling(
    srv_type: Any, callback: Any, request: Any, *, in_flight: int = 1, **options: Any
) -> Callable[[], Awaitable[int]]:
    """Steps of `CALLS` calls."""

    async def caller(client: Any, count: int) -> None:
        for _ in range(count):
            await client.call(request)

    async def callers(client: Any) -> None:
        share = CALLS // in_flight
        await asyncio.gather(*(caller(client, share) for _ in range(in_flight)))

    async def measured() -> int:
        async with connected(srv_type, callback, **options) as client:
            await caller(client, 10)
            return await steps_of(partial(callers, client))

    return measured


async def publishing() -> int:
    """Steps of `CALLS` messages from one process, so to speak, to another."""
    async with (
        taskrpc.Node("talker", transport="memory", token="talker") as talker,
        taskrpc.Node("listener", transport="memory", token="listener") as listener,
    ):
        came = 0

        def take(_: Any) -> None:
            nonlocal came
            came += 1

        publisher = talker.create_publisher(Int32, "counts")
        listener.create_subscription(Int32, "counts", take)
        while not publisher.get_subscription_count():
            await asyncio.sleep(0)
        message = Int32(data=1)

        async def work() -> None:
            nonlocal came
            came = 0
            for number in range(1, CALLS + 1):
                publisher.publish(message)
                while came < number:
                    await asyncio.sleep(0)

        await work()
        return await steps_of(work)


async def creating() -> int:
    """Steps of making services, and of destroying them."""
    async with taskrpc.Node("server", transport="memory") as node:

        async def work() -> None:
            made = [node.create_service(Add, f"s{number}", add) for number in range(SERVICES)]
            for service in made:
                service.destroy()

        await work()
        return await steps_of(work)


async def queueing() -> int:
    """Steps of submitting tasks in a paused queue, and of cancelling them."""
    manager = TaskManager(StandingRobot(), MemoryStore(), TaskSettings(wall_clock=lambda: 1e9))
    await manager.start()
    await manager.pause()

    async def work() -> None:
        answers = [
            await manager.submit("move", str(number % 7), 1 + number % 10)
            for number in range(TASKS)
        ]
        for answer in answers:
            await manager.cancel(answer.task_id)

    await work()
    steps = await steps_of(work)
    await manager.close()
    return steps


async def submitting() -> int:
    """Steps of calls of `/robot_task` while its queue is paused."""
    async with (
        taskrpc.Node("server", transport="memory", token="server") as server,
        taskrpc.Node("client", transport="memory", token="client") as node,
        taskrpc.TaskServer(server, StandingRobot(), MemoryStore(), wall_clock=lambda: 1e9) as tasks,
    ):
        await tasks.manager.pause()
        client = node.create_client(Submit, "robot_task")

        async def work() -> None:
            for number in range(TASKS):
                request = Submit.Request(
                    task_type="move", target=str(number % 7), priority=1 + number % 10
                )
                assert (await client.call(request)).success

        await work()
        return await steps_of(work)


class StandingRobot:
    """A robot that only plans: no task starts."""

    speed = 1.0
    task_types = ("move",)

    def plan(self, task_type: str, target: str, start: Pose) -> Plan:
        return Plan(abs(float(target) - start.x) + 1.0, Pose(float(target), 0.0, 0.0))

    def pose(self) -> Pose:
        return Pose(0.0, 0.0, 0.0)

    def remaining(self) -> float:
        return 0.0

    def pause(self) -> None: ...

    def resume(self) -> None: ...

    def stop(self) -> None: ...


_two_ints = Add.Request(a=1, b=2)
WORKS: dict[str, tuple[Callable[[], Awaitable[int]], int]] = {
    "a call": (calling(Add, add, _two_ints), CALLS),
    f"a call of {IN_FLIGHT} at a time": (calling(Add, add, _two_ints, in_flight=IN_FLIGHT), CALLS),
    "a call of an async callback": (calling(Add, add_later, _two_ints), CALLS),
    "a call with 64 KiB": (calling(Types, types, Types.Request(names=["x" * PAYLOAD])), CALLS),
    "a call over a middleware": (calling(Add, add, _two_ints, transport="tunnel"), CALLS),
    "a call with a retry policy": (
        calling(Add, add, _two_ints, retry=taskrpc.RetryPolicy()),
        CALLS,
    ),
    "an exactly-once call": (calling(Add, add, _two_ints, once=True), CALLS),
    "a call beside an exactly-once service": (
        calling(Add, add, _two_ints, beside_once=True),
        CALLS,
    ),
    "a message to one subscription": (publishing, CALLS),
    "a service made and destroyed": (creating, SERVICES),
    "a task submitted and cancelled": (queueing, TASKS),
    "a call that submits a task": (submitting, TASKS),
}
"""What is counted, and for how many the count stands."""


async def steps_of(work: Work) -> int:
    """Count the function calls that begin while `work` runs, in all code."""
    count = 0

    def note(_frame: object, event: str, _argument: object) -> None:
        nonlocal count
        if event in ("call", "c_call"):
            count += 1

    gc.collect()
    gc.disable()  # finalizers run whenever they run
    sys.setprofile(note)
    try:
        await work()
    finally:
        sys.setprofile(None)
        gc.enable()
    return count


def count_all() -> dict[str, float]:
    """Steps of one of each, in a process of their own: `TRANSPORTS` changes."""
    TRANSPORTS["tunnel"] = Registration("taskrpc.testing.memory_engine:open_network")
    counts = {}
    for name, (measure, pieces) in WORKS.items():
        with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
            counts[name] = runner.run(_awaited(measure)) / pieces
    return counts


async def _awaited(measure: Callable[[], Awaitable[int]]) -> int:
    return await measure()


def counted() -> dict[str, float]:
    """The same, counted in a fresh process with a known order of everything."""
    environment = {**os.environ, "PYTHONHASHSEED": "0"}
    command = [sys.executable, "-m", "tests.steps"]
    root = Path(__file__).parents[1]
    done = subprocess.run(command, cwd=root, env=environment, stdout=subprocess.PIPE, check=True)
    counts: dict[str, float] = json.loads(done.stdout)
    return counts


def update() -> None:
    """Make what is counted now the figures of this Python."""
    figures = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    figures[VERSION] = {name: round(count, 1) for name, count in counted().items()}
    FIGURES.write_text(json.dumps(figures, indent=2, sort_keys=True) + "\n")


if __name__ == "__main__":
    logging.disable()
    if "--update" in sys.argv[1:]:
        update()
    else:
        print(json.dumps(count_all()))
