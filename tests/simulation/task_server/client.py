"""A caller: it calls everything, several at a time; killed, it repeats what it asked before."""

import asyncio
import json
import os
import random
import sys

from messages import Listener
from moments import LEASE, RECOVERED
from records import now, record

import srvgen
import taskrpc

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
TYPES = {
    "plain": Add,
    "repeatable": Add,
    "once": Add,
    "submit": RobotTask,
    "steer": Add,
    "nowhere": Add,
}
NAMES = {"submit": "robot_task"}
AT_ONCE = ("plain", "repeatable", "steer", "nowhere")
"""Requests that are sent once unless the caller has a retry policy."""
KINDS = (*TYPES, "plain", "once", "once", "submit", "submit")
LASTING = ("repeatable", "once", "submit")
"""Requests that must be answered once all faults have ended."""
AGAIN_WITHIN = 4.0
"""Seconds after which a caller that was killed does not repeat its earlier requests: by then the
servers may have forgotten it."""
CALLS = 10
LATEST_BREAK = 4.0
"""The latest time at which a caller begins a break that is longer than its lease."""


class Notes:
    """The calls that this program has made, on its disk."""

    def __init__(self, name):
        self._name = f"{name}.notes"
        self.calls = []
        if os.path.exists(self._name):
            with open(self._name) as file:
                self.calls = [json.loads(line) for line in file]

    def add(self, number, kind, request_id):
        self.calls.append((now(), number, kind, request_id))
        with open(self._name, "a") as file:
            file.write(json.dumps(self.calls[-1]) + "\n")
            file.flush()
            os.fsync(file.fileno())


class Caller:
    def __init__(self, name, node):
        self._name = name
        self._first = 1000 * (1 + int(name[-1]))
        self._notes = Notes(name)
        self._clients = {
            kind: node.create_client(srv_type, NAMES.get(kind, kind))
            for kind, srv_type in TYPES.items()
        }
        self._listener = Listener(node)

    async def run(self):
        before = list(self._notes.calls)
        record("caller starts")
        async with asyncio.TaskGroup() as group:
            for asked, number, kind, request_id in before:
                if request_id and now() - asked < AGAIN_WITHIN:
                    group.create_task(self._repeat(number, kind, request_id))
            while len(self._notes.calls) < CALLS and now() < RECOVERED:
                group.create_task(self._call())
                is_long = now() < LATEST_BREAK and random.random() < 0.08
                await asyncio.sleep(1.2 * LEASE if is_long else random.expovariate(3))
        await asyncio.sleep(max(0.0, RECOVERED - now()))
        for kind in LASTING:
            number = self._ask(kind, 10.0, must_be_answered=True)
            await self._send(number, kind, 10.0, taskrpc.RetryPolicy(), "", patience=None)
        await self._listener.hear_the_present()

    async def _call(self):
        kind = random.choice(KINDS)
        timeout = random.choice((0.1, 1.0, 5.0)) * (0.1 + random.random())
        policy = random.choice((None, taskrpc.RetryPolicy(), taskrpc.RetryPolicy(attempts=3)))
        is_named = kind in ("once", "submit") and random.random() < 0.6
        is_sent_once = kind in AT_ONCE and policy is None
        number = self._ask(kind, timeout, is_named=is_named, is_sent_once=is_sent_once)
        request_id = str(number) if is_named else ""
        patience = timeout * random.random() if random.random() < 0.1 else None
        async with asyncio.TaskGroup() as group:
            if is_named and random.random() < 0.6:
                delay = random.choice((0.0, 2.0)) * random.random()
                group.create_task(self._repeat(number, kind, request_id, delay))
            await self._send(number, kind, timeout, policy, request_id, patience)

    async def _repeat(self, number, kind, request_id, delay=0.0):
        """Send a request once more, as another program could that knows its id."""
        await asyncio.sleep(delay)
        record("ask again", number, now() + 2.0)
        await self._send(number, kind, 2.0, taskrpc.RetryPolicy(), request_id, None)

    def _ask(self, kind, timeout, *, is_named=False, is_sent_once=False, must_be_answered=False):
        number = self._first + len(self._notes.calls)
        self._notes.add(number, kind, str(number) if is_named else "")
        record("ask", number, kind, now() + timeout, is_sent_once, must_be_answered)
        return number

    async def _send(self, number, kind, timeout, policy, request_id, patience):
        record("send", number)
        call = asyncio.ensure_future(
            self._clients[kind].call(
                _message(number, kind), timeout=timeout, retry=policy, request_id=request_id
            )
        )
        done, _ = await asyncio.wait({call}, timeout=patience)
        if not done:
            call.cancel()
        try:
            response = await call
            value = response.task_id if kind == "submit" else response.sum
            record("answered", number, value)
        except asyncio.CancelledError:
            record("cancelled", number)
        except taskrpc.TaskRpcError as error:
            record("failed", number, type(error).__name__, error.not_executed, str(error))


def _message(number, kind):
    if kind == "submit":
        priority = 1 + number * 7 % 10
        return RobotTask.Request(task_type="move", target=str(number), priority=priority)
    return Add.Request(a=number, b=number)


async def main(name, token):
    async with taskrpc.Node("client", token=token, keepalive="robot") as node:
        await Caller(name, node).run()
    record("caller ends")


asyncio.run(main(*sys.argv[1:]))
