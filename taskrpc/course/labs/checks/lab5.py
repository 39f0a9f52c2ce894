"""Lab 5: a task server with a priority queue, validation, estimates and a worker thread."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, cast

import msgspec

import srvgen
from taskrpc.client import Client
from taskrpc.course.labs.checks.common import ANSWERED, answer, service_of
from taskrpc.course.labs.lab import Check, Lab, NotMet
from taskrpc.course.labs.trial import Call, Program, Ran, Simulated, Trial
from taskrpc.course.labs.variants import Variant

if TYPE_CHECKING:
    from srvgen.stubs.my_robot_interfaces.srv import RobotTask

_TYPE: Final = "my_robot_interfaces/srv/RobotTask"
_NAMES = ("robot_task", "submit_task", "task_desk", "orders", "work_list")
_TYPES = (
    ("move", "scan", "report"),
    ("drive", "photo", "weigh"),
    ("fetch", "measure", "inspect"),
    ("carry", "count", "label"),
)
_SECONDS = ((5.0, 3.0, 1.0), (4.0, 2.0, 1.0), (6.0, 3.0, 1.0), (5.0, 2.0, 1.0))
_TARGETS = ("warehouse", "station_1", "area_a", "central", "dock")
_PRIORITIES = (3, 8, 5, 10, 8, 3)
_SLACK = 0.5
"""Seconds by which an estimate may be wrong: the worker may look into its queue now and then."""
_PATIENCE = 30.0
"""Seconds on top of those that the tasks take."""


class Work(msgspec.Struct, frozen=True):
    """The types of tasks of a variant with their seconds, longest first, and the targets."""

    types: Sequence[str]
    seconds: Mapping[str, float]
    targets: Sequence[str]


def work_of(variant: Variant) -> Work:
    """Return the tasks of a variant."""
    types = variant.choose("types", _TYPES)
    seconds = variant.choose("seconds", _SECONDS)
    targets = variant.order("targets", _TARGETS)[:3]
    return Work(types, dict(zip(types, seconds, strict=True)), targets)


def _service(variant: Variant) -> str:
    return variant.choose("service", _NAMES)


def _values(variant: Variant) -> Mapping[str, str]:
    work = work_of(variant)
    values = {"SERVICE": _service(variant)}
    for word, name in zip(("LONG", "MIDDLE", "SHORT"), work.types, strict=True):
        values |= {word: name, f"{word}_SECONDS": str(work.seconds[name])}
    return values | {f"TARGET_{n}": target for n, target in enumerate(work.targets, 1)}


class Accepted(msgspec.Struct, frozen=True):
    """A task that the server has accepted, and when the response arrived."""

    type: str
    priority: int
    id: int
    estimate: float
    time: float


class Desk:
    """The submission's server, with what a check needs to talk to it; use `started`."""

    def __init__(
        self,
        trial: Trial,
        program: Program,
        client: Client[RobotTask.Request, RobotTask.Response],
        *,
        interleaved: bool = False,
    ) -> None:
        self.program = program
        self.work = work_of(trial.variant)
        self.longest, self.middle, self.shortest = self.work.types
        self._trial = trial
        self._client = client
        self._is_interleaved = interleaved

    @staticmethod
    async def started(trial: Trial, *, interleaved: bool = False) -> Desk:
        """Start the server and wait for its service."""
        program = await trial.start("server.py", interleaved=interleaved)
        srv_type, name = srvgen.load(_TYPE), f"/{_service(trial.variant)}"
        client = await service_of(trial, program, srv_type, name)
        return Desk(trial, program, client, interleaved=interleaved)

    def time(self) -> float:
        """Return the time of the trial."""
        return self._trial.time()

    async def request(self, task_type: str, target: str, priority: int) -> RobotTask.Response:
        """Return the response to any request."""
        request = srvgen.load(_TYPE).Request(task_type=task_type, target=target, priority=priority)
        words = f"task_type={task_type} target={target} priority={priority}"
        # Long enough to see that a server does its task before it responds.
        patience = ANSWERED + self.work.seconds[self.longest]
        if self._is_interleaved:
            patience += _PATIENCE
        return await answer(self._client, request, words, patience)

    async def accept(self, task_type: str, priority: int, target: str = "") -> Accepted:
        """Send a valid task; NotMet if the server refuses it."""
        target = target or self.work.targets[0]
        response = await self.request(task_type, target, priority)
        return accepted(response, task_type, target, priority, self._trial.time())

    async def executing(self, id: int) -> None:
        """Wait until the server begins a task; NotMet if it does not."""
        if await self.program.wait_for_line(rf"Executing task {id}\b", _PATIENCE) is None:
            raise NotMet(
                f"the worker to execute task {id}",
                f"it did not, and executed {self.executed() or 'none'}{self.error()}",
                "which line calls self.execute? Does the thread start? Does its loop never end?",
            )

    def executed(self) -> list[int]:
        """Return the ids of the tasks that the server has begun, in their order."""
        return executed(self.program)

    def completed(self) -> list[int]:
        """Return the ids of the tasks that the server has completed."""
        found = (re.search(r"Task (-?\d+) completed", line) for line in self.program.output)
        return [int(one[1]) for one in found if one]

    def error(self) -> str:
        """Return in words the last exception that the server has printed; "" if there is none."""
        return error(self.program)


def accepted(
    response: RobotTask.Response, task_type: str, target: str, priority: int, time: float
) -> Accepted:
    """Return the task of a response that arrived at a time; NotMet if the server refuses it."""
    words = f"task_type={task_type} target={target} priority={priority}"
    if not response.success:
        raise NotMet(
            f"success=True for the valid task {words}",
            f"success=False, message={response.message!r}",
            "which values are allowed? See the comment at 3",
        )
    if not response.message:
        raise NotMet(
            f"a message in the response to {words}",
            "the message is empty",
            "for example, Task queued: and the type",
        )
    return Accepted(task_type, priority, response.task_id, response.estimated_time, time)


def executed(program: Ran) -> list[int]:
    """Return the ids of the tasks that a server has begun, in their order."""
    found = (re.search(r"Executing task (-?\d+)", line) for line in program.output)
    return [int(one[1]) for one in found if one]


def error(program: Ran) -> str:
    """Return in words the last exception that a server has printed; "" if there is none."""
    errors = [line for line in program.output if re.match(r"\w+(Error|Exception)\b", line)]
    return f"; it printed {errors[-1]}" if errors else ""


async def simulated(
    trial: Trial, tasks: Sequence[tuple[str, int, float]]
) -> tuple[Simulated, list[Accepted], float]:
    """Simulate the server with tasks: the type, the priority, and when each is sent.

    Returns the run, the accepted tasks, and when the first one was sent.
    """
    work = work_of(trial.variant)
    new, target = srvgen.load(_TYPE).Request, work.targets[0]
    calls = [
        Call(
            _TYPE,
            f"/{_service(trial.variant)}",
            new(task_type=task_type, target=target, priority=priority),
            at,
        )
        for task_type, priority, at in tasks
    ]
    seconds = sum(work.seconds[task_type] for task_type, _, _ in tasks)
    server = await trial.simulate("server.py", duration=seconds + _PATIENCE, calls=calls)
    found = []
    for (task_type, priority, _), response in zip(tasks, server.responses, strict=True):
        if response.message is None:
            raise NotMet(
                f"a response to task_type={task_type} target={target} priority={priority}",
                (response.problem or server.problem or "there was none") + error(server),
                "what does the callback wait for? Print a line before and after it",
            )
        message = cast("RobotTask.Response", response.message)
        found.append(accepted(message, task_type, target, priority, response.time))
    return server, found, server.responses[0].began


async def _accepts(trial: Trial) -> None:
    desk = await Desk.started(trial)
    first = await _at_once(desk, desk.longest)
    if first.id != 1:
        raise NotMet("task_id=1 for the first task", f"task_id={first.id}", "see the comment at 4")
    await desk.executing(1)
    began = desk.time()
    second = await _at_once(desk, desk.shortest)
    if second.id != 2:
        raise NotMet("task_id=2 for the second one", f"task_id={second.id}", "see the comment at 4")
    await desk.executing(2)
    if 1 not in desk.completed():
        raise NotMet(
            "the server to do one task after another",
            "it began task 2 before it had completed task 1",
            "how many threads run self.work?",
        )
    duration, longest = desk.time() - began, desk.work.seconds[desk.longest]
    if duration < longest / 2:
        raise NotMet(
            f"task 1 to take {longest:g} s",
            f"task 2 began {duration:.1f} s after task 1",
            "self.execute does one task; it was complete in the starter file",
        )


async def _at_once(desk: Desk, task_type: str) -> Accepted:
    """Send a task; NotMet if its response waits for the end of the task that runs."""
    before = desk.completed()
    sent = desk.time()
    accepted = await desk.accept(task_type, 5)
    # A slow machine alone is no reason to fail: a task must have ended too.
    longest = desk.work.seconds[desk.longest]
    if accepted.time - sent > longest / 2 and desk.completed() != before:
        raise NotMet(
            "a response at once, before the task is done",
            f"the response came only after {accepted.time - sent:.1f} s, when a task was completed",
            "what does the callback wait for: for self.execute, or for a lock that work holds?",
        )
    return accepted


async def _refuses(trial: Trial) -> None:
    desk = await Desk.started(trial)
    types, targets = desk.work.types, desk.work.targets
    low, high = -trial.unpredictable(1, 50), trial.unpredictable(11, 50)
    requests = [
        ("fly", targets[0], 5, "fly"),
        (types[0], "moon", 5, "moon"),
        (types[1], targets[1], 0, "0"),
        (types[1], targets[1], low, str(low)),
        (types[2], targets[2], high, str(high)),
    ]
    for task_type, target, priority, wrong in requests:
        response = await desk.request(task_type, target, priority)
        words = f"task_type={task_type} target={target} priority={priority}"
        if response.success:
            raise NotMet(
                f"success=False for {words}",
                f"success=True, task_id={response.task_id}",
                "which values are allowed? See the comment at 3",
            )
        if (response.task_id, response.estimated_time) != (-1, 0.0):
            raise NotMet(
                f"task_id=-1 and estimated_time=0.0 for the refused task {words}",
                f"task_id={response.task_id} and estimated_time={response.estimated_time:g}",
                "see the comment at 3",
            )
        if wrong not in response.message:
            raise NotMet(
                f"a message with the wrong value {wrong!r} for {words}",
                f"message={response.message!r}",
                "the caller has to know what to change",
            )
    accepted = await desk.accept(desk.shortest, 10)
    if accepted.id != 1:
        raise NotMet(
            f"task_id=1 for the first valid task, after {len(requests)} refused ones",
            f"task_id={accepted.id}: refused tasks used up ids",
            "when does the server count?",
        )


async def _orders(trial: Trial) -> None:
    work = work_of(trial.variant)
    longest, _, shortest = work.types
    priorities = list(_PRIORITIES)
    for left in range(len(priorities) - 1, 0, -1):
        other = trial.unpredictable(0, left)
        priorities[left], priorities[other] = priorities[other], priorities[left]
    # The worker is busy with a first task while the others arrive, so it can choose.
    middle = work.seconds[longest] / 2
    waiting = [(shortest, priority, middle) for priority in priorities]
    server, tasks, _ = await simulated(trial, [(longest, 10, 0.0), *waiting])
    if len(done := executed(server)) < len(tasks):
        raise NotMet(
            f"the worker to execute {len(tasks)} tasks",
            f"it executed {len(done)}: {done}{error(server)}",
            "does the loop of the worker go on after a task?",
        )
    expect_order(tasks[1:], done[: len(tasks)])


def expect_order(tasks: Sequence[Accepted], executed: Sequence[int]) -> None:
    """Raise NotMet if the tasks after the first one were not done in the right order."""
    right = sorted(tasks, key=lambda task: (-task.priority, task.id))
    names = {task.id: f"{task.id} (priority {task.priority})" for task in tasks}
    if list(executed[1:]) == [task.id for task in right]:
        return
    by_priority = [names.get(id, str(id)) for id in executed[1:]]
    equal = [task.priority for task in right] == [
        next((task.priority for task in tasks if task.id == id), 0) for id in executed[1:]
    ]
    raise NotMet(
        "the waiting tasks in the order " + ", ".join(names[task.id] for task in right),
        "it did them in the order " + ", ".join(by_priority),
        "of two tasks of one priority, the one with the smaller id comes first"
        if equal
        else "the queue gives its smallest tuple first; which priority is that in your tuple?",
    )


async def _estimates(trial: Trial) -> None:
    work = work_of(trial.variant)
    longest, middle, shortest = work.types
    early = work.seconds[longest] / 4
    sent = [(middle, 4, early), (shortest, 4, early + 0.1), (middle, 9, early + 0.2)]
    _, tasks, began = await simulated(trial, [(longest, 10, 0.0), *sent])
    expect_estimates(work.seconds, began, tasks[0], tasks[1:])


def expect_estimates(
    seconds: Mapping[str, float], sent: float, first: Accepted, tasks: Sequence[Accepted]
) -> None:
    """Raise NotMet if an estimate is shorter or longer than the work ahead.

    Args:
        seconds: how long a task of each type takes.
        sent: when the first task was sent; it cannot have begun before.
        first: the task that runs.
        tasks: those sent while it runs, in their order.
    """
    _expect_at_least(first, seconds[first.type], f"its own {seconds[first.type]:g} s")
    for number, task in enumerate(tasks):
        ahead = [one for one in tasks[:number] if one.priority >= task.priority]
        waiting = sum(seconds[one.type] for one in ahead)
        rest = max(0.0, seconds[first.type] - (task.time - sent))
        words = f"{rest:.1f} s of the running task, {waiting:g} s of waiting ones ahead of it"
        own = seconds[task.type]
        _expect_at_least(task, rest + waiting + own, f"{words}, {own:g} s of its own")
        most = seconds[first.type] + waiting + own
        if task.estimate > most + _SLACK:
            raise NotMet(
                f"an estimate of at most {most:g} s for task {task.id} of priority"
                f" {task.priority}: less important tasks come after it",
                f"estimated_time={task.estimate:.1f}",
                "which of the waiting tasks come before this one? See the comment at 6",
            )


def _expect_at_least(task: Accepted, least: float, words: str) -> None:
    if task.estimate < least - _SLACK:
        raise NotMet(
            f"an estimate of at least {least:.1f} s for task {task.id}: {words}",
            f"estimated_time={task.estimate:.1f}",
            "which tasks have to be done before this one? See the comment at 6",
        )


async def _twenty(trial: Trial) -> None:
    # The callbacks take turns at each step: without a lock, two of them always get the same id.
    desk = await Desk.started(trial, interleaved=True)
    tasks = await asyncio.gather(*(desk.accept(desk.shortest, n % 10 + 1) for n in range(20)))
    ids = sorted(task.id for task in tasks)
    if ids != list(range(1, 21)):
        twice = sorted({id for id in ids if ids.count(id) > 1})
        raise NotMet(
            "the ids 1 to 20 for 20 requests at the same time",
            f"it gave {ids}" + (f"; {twice} more than once" if twice else ""),
            "may two callbacks run at the same time? A lock must hold from reading to writing",
        )


async def _ends(trial: Trial) -> None:
    desk = await Desk.started(trial)
    await desk.accept(desk.longest, 5)
    await desk.executing(1)
    await desk.program.interrupt()
    if await desk.program.finished(_PATIENCE) is None:
        raise NotMet(
            "the program to end after Ctrl-C, also while a task runs",
            f"it still ran {_PATIENCE:g} s later",
            "a program waits for all its threads, except for daemon threads",
        )


_OFFERS = "the server accepts tasks at once, and does them"

LAB = Lab(
    number=5,
    title="The task system",
    minutes=25,
    goal="You can write a server that accepts work at once and does it in order of importance.",
    files=("server.py",),
    values=_values,
    speed=8.0,  # its programs wait for seconds
    is_simulated=True,
    checks=(
        Check(_OFFERS, 2.5, _accepts),
        Check("a wrong task is refused and uses no id", 2, _refuses, needs=(_OFFERS,)),
        Check("the most important task is the next one", 2, _orders, needs=(_OFFERS,)),
        Check("the estimate counts the work ahead", 1.5, _estimates, needs=(_OFFERS,)),
        Check("20 requests at the same time get 20 ids", 1, _twenty, needs=(_OFFERS,)),
        Check("Ctrl-C ends the server", 1, _ends, needs=(_OFFERS,)),
    ),
)
