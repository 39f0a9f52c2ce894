"""Conversations with a task server of one robot, or of a fleet with one robot, as lines of text."""

from __future__ import annotations

import asyncio
import re
import shlex
from contextlib import AsyncExitStack
from functools import cache

import srvgen
from taskrpc import Account, Accounts, Node, Role
from taskrpc.errors import HandlerFailed, TaskRpcError
from taskrpc.robot.fleet import FleetServer, FleetSettings
from taskrpc.robot.protocol import Plan, Pose, RobotStopped, TargetError
from taskrpc.robot.tasks import TaskServer


class Robot:
    """A robot whose tasks take 100 s; how a task ends is written in its target."""

    task_types = ("move", "scan", "report")
    speed = 1.0

    def __init__(self):
        self._target = ""
        self._stopped = asyncio.Event()

    def plan(self, task_type, target, start):
        if target == "moon":
            raise TargetError("there is no place 'moon'")
        if target == "unmapped":
            raise RuntimeError("the map is missing")
        return Plan(100.0, start)

    def pose(self):
        return Pose(0.0, 0.0, 0.0)

    def remaining(self):
        return 100.0

    def pause(self):
        if self._target == "jammed":
            raise RuntimeError("the brake is jammed")

    def resume(self):
        if self._target == "flat":
            raise RuntimeError("the battery is flat")

    def stop(self):
        if self._target == "runaway":
            raise RuntimeError("no contact")
        self._stopped.set()

    async def execute(self, task_type, target, report):
        self._target = target
        self._stopped.clear()
        try:
            if target == "done":
                return {"x": 1.0}
            if target == "fails":
                raise RuntimeError("a wheel is stuck")
            await self._halted(ignores_cancel=target == "stubborn")
            raise RobotStopped("stopped")
        finally:
            self._target = ""

    async def _halted(self, *, ignores_cancel):
        while not self._stopped.is_set():
            try:
                await self._stopped.wait()
            except asyncio.CancelledError:
                if not ignores_cancel:
                    raise


def one_robot(store):
    """Return a function that makes a server of one robot; `store` makes its store."""

    def make(node, **settings):
        return TaskServer(node, Robot(), store(), **settings)

    return make


def fleet_of_one(store):
    """Return a function that makes a fleet's only server; `store` makes its store."""

    def make(node, **settings):
        return FleetServer(node, Robot(), store(), FleetSettings(name="r1", **settings))

    return make


ANN = Account("ann", "0123456789abcdef0123", Role.OPERATE)
TYPES = {
    "submit": "my_robot_interfaces/srv/RobotTask",
    "list": "taskrpc_interfaces/srv/ListTasks",
    "show": "taskrpc_interfaces/srv/ShowTask",
    "watch": "taskrpc_interfaces/srv/WatchTasks",
    "cancel": "taskrpc_interfaces/srv/CancelTask",
    "pause": "taskrpc_interfaces/srv/PauseTasks",
    "resume": "taskrpc_interfaces/srv/ResumeTasks",
    "reprioritise": "taskrpc_interfaces/srv/ReprioritiseTask",
    "requeue": "taskrpc_interfaces/srv/RequeueTask",
    "drop": "taskrpc_interfaces/srv/DropTask",
    "stop": "taskrpc_interfaces/srv/StopRobot",
    "health": "std_srvs/srv/Trigger",
}
"""The type of each service."""


@cache
def service_type(verb):
    return srvgen.load(TYPES[verb])


WORDS = {
    "submit": ("task_type", "target", "priority"),
    "reprioritise": ("task_id", "priority"),
    "until": ("task_id", "state"),
    **dict.fromkeys(["list", "pause", "resume", "stop", "health", "restart"], ()),
}
"""The fields of the words after each verb; for all other verbs, it is the task's id."""
NUMBERS = {"task_id": int, "priority": int, "limit": int, "timeout": float}


def parsed(line):
    """Return the verb and the fields of a line such as `requeue 3 resume` or `list limit=1`."""
    verb, *words = (word.replace(r"\n", "\n") for word in shlex.split(line))
    known = WORDS.get(verb, ("task_id",))
    fields = dict(zip(known, words, strict=False))
    for word in words[len(known) :]:
        name, equals, value = word.partition("=")
        fields[name] = value if equals else True
    return verb, {name: NUMBERS.get(name, lambda v: v)(each) for name, each in fields.items()}


class Conversation:
    """A server in this process and its client."""

    def __init__(self, make, *, has_accounts=False, **settings):
        self._make = make
        self._settings = {"settle": 0.0} | settings
        self._accounts = Accounts([ANN]) if has_accounts else None
        self._token = {"token": ANN.token} if has_accounts else {}
        self._stack = AsyncExitStack()
        self._node = None
        self._clients = {}
        self._revision, self._next_page = 0, ""

    async def __aenter__(self):
        server = Node("server", transport="memory", listen="server", accounts=self._accounts)
        await self._stack.enter_async_context(server)
        await self._stack.enter_async_context(self._make(server, **self._settings))
        client = Node("client", transport="memory", listen="client", **self._token)
        self._node = await self._stack.enter_async_context(client)
        return self

    async def __aexit__(self, *exc_info):
        self._clients.clear()
        await self._stack.aclose()

    async def answer(self, line):
        """Send the request of a line; returns the response as text.

        `until 1 RUNNING` waits until a task has a state, and `restart` ends the server and starts
        another one with the same store; the answer is "".
        """
        verb, fields = parsed(line)
        if verb == "restart":
            await self.__aexit__()
            await self.__aenter__()
            return ""
        if verb == "until":
            await self._until(**fields)
            return ""
        for name, last in (("page", self._next_page), ("revision", self._revision)):
            if fields.get(name) == "last":
                fields[name] = last
        try:
            response = await self._call(verb, **fields)
        except HandlerFailed as error:
            return f"{error.code.name}: {error.message}"
        except TaskRpcError as error:
            return f"{type(error).__name__}: {error}"
        self._revision = getattr(response, "revision", self._revision)
        self._next_page = getattr(response, "next_page", "")
        return TOLD.get(verb, told)(response)

    async def _call(self, verb, id=None, **fields):
        srv_type = service_type(SHOWN.get(verb, verb))
        name = "/robot_task" if verb == "submit" else f"/robot_task/{SHOWN.get(verb, verb)}"
        if name not in self._clients:
            self._clients[name] = self._node.create_client(srv_type, name, timeout=30)
        return await self._clients[name].call(srv_type.Request(**fields), request_id=id)

    async def _until(self, task_id, state):
        async with asyncio.timeout(20):
            while (await self._call("show", task_id=task_id)).task.state != state:
                await asyncio.sleep(0.01)


def told(response):
    """Return a response as one line; estimates are rounded to 10 s, because time passes."""
    words = []
    if hasattr(response, "success"):
        words.append("yes" if response.success else "no")
    if getattr(response, "message", ""):
        words.append(response.message)
    if getattr(response, "task_id", -1) != -1:
        words.append(f"task {response.task_id}")
    if getattr(response, "estimated_time", 0.0):
        words.append(seconds(response.estimated_time))
    if hasattr(response, "task") and response.success:
        words.append(whole(response.task))
    if hasattr(response, "tasks"):
        words.append(", ".join(brief(each) for each in response.tasks) or "no tasks")
    if hasattr(response, "complete") and not response.complete:
        words.append("incomplete")
    if getattr(response, "next_page", ""):
        words.append("next page " + re.sub(r"^e[^:]*", "e", response.next_page))
    if hasattr(response, "queued"):
        words.append(f"{response.queued} queued")
    if getattr(response, "paused", False):
        words.append("paused")
    return " ".join("; ".join(words).split())


def seconds(value):
    return f"{10 * round(value / 10)} s"


def brief(task):
    return f"{task.task_id} {task.state} {seconds(task.estimated_time)}"


def whole(task):
    words = [brief(task), f"{task.task_type} at {task.target}", f"priority {task.priority}"]
    words += [f"accepted {seconds(task.accepted_estimate)}", f"{task.progress:.0%}", task.client]
    words += ["begun"] if task.started.sec else []
    words += ["ended"] if task.ended.sec else []
    words += [each for each in (task.message, task.result) if each]
    return ", ".join(words)


def changes(response):
    found = [each for each in response.task.estimate_changes if abs(each.seconds) > 5]
    return ", ".join(f"{seconds(each.seconds)}: {each.cause}" for each in found) or "none"


TOLD = {"robot": lambda response: response.task.robot or "none", "changes": changes}
SHOWN = dict.fromkeys(TOLD, "show")
"""Verbs that show one part of a task, which `show` leaves out here."""


async def answers(make, lines, **settings):
    """Return what a server answers to lines; `make` and `settings` make it."""
    async with Conversation(make, **settings) as conversation:
        return [await conversation.answer(line) for line in lines]
