"""The truth: what was really done, and what everybody was told about it."""

from __future__ import annotations

import asyncio
import collections
from dataclasses import dataclass, field

import taskrpc
from taskrpc.tasks.model import State

LATE = 0.02
"""Seconds by which a deadline may be missed: a tick, and the loop's own grain."""

PROMISES = (
    "ran twice",
    "ran although not executed",
    "lost",
    "wrong answer",
    "out of order",
    "robot moved twice",
    "ran on after the deadline",
    "waited beyond the deadline",
    "left behind",
)
"""Counts that must be zero."""

ANSWERED, UNTOUCHED, UNKNOWN, CANCELLED = "answered", "not executed", "unknown", "cancelled"
SAYS_MORE = ("", UNTOUCHED, CANCELLED, UNKNOWN, ANSWERED)


@dataclass
class Request:
    """One call of a client, and what became of it."""

    number: int
    kind: str
    deadline: float
    outcome: str = ""
    task_id: int = 0
    started: list[float] = field(default_factory=list)
    effects: int = 0


class Ledger:
    """Writes down everything, and compares."""

    def __init__(self, counts, tell=None):
        self.counts = counts
        self.lines: list[str] = []
        self.requests: dict[int, Request] = {}
        self.disks = []
        self.runs: collections.Counter[str] = collections.Counter()
        self._tell = tell
        self._waiting: set[str] = set()
        self._loop = asyncio.get_running_loop()

    def note(self, what: str) -> None:
        line = f"{self._loop.time():.6f} {what}"
        self.lines.append(line)
        if self._tell is not None:
            self._tell(line)

    def broke(self, promise: str, what: object) -> None:
        self.counts[promise] += 1
        self.note(f"BROKEN: {promise}: {what}")

    # What servers do

    def started(self, number: int) -> None:
        request = self.requests[number]
        request.started.append(self._loop.time())
        self.note(f"run {number}")

    def finished(self, number: int, latest: float) -> None:
        self.note(f"ran {number}")
        if self._loop.time() > latest + LATE:
            self.broke("ran on after the deadline", number)

    def had_effect(self, number: int) -> None:
        self.requests[number].effects += 1
        self.note(f"effect {number}")

    def chosen(self, task, waiting) -> None:
        """The worker begins a task; those wait that the store has or is about to have."""
        place = (-task.priority, task.arrival)
        better = [each.task_id for each in waiting if (-each.priority, each.arrival) < place]
        if better:
            self.broke("out of order", f"task {task.task_id} before {better}")

    def moved(self, target: str) -> None:
        """The robot begins to do what a task asks for."""
        self.runs[target] += 1
        self.note(f"robot {target}")
        if self.runs[target] > 1:
            self.broke("robot moved twice", target)

    # What clients are told

    def asked(self, kind: str, timeout: float) -> Request:
        number = len(self.requests) + 1
        request = Request(number, kind, self._loop.time() + timeout)
        self.requests[number] = request
        self.note(f"ask {number} {kind} {timeout:.3f}")
        return request

    def told(self, request: Request, answer) -> None:
        outcome = self._outcome(request, answer)
        self.counts[outcome] += 1
        said = answer if isinstance(answer, BaseException) else ""
        self.note(f"told {request.number} {outcome} {said!r}")
        # Sent twice under one id, a request did not run only if neither of them did.
        request.outcome = max(request.outcome, outcome, key=SAYS_MORE.index)
        if self._loop.time() > request.deadline + LATE:
            self.broke("waited beyond the deadline", request.number)

    def _outcome(self, request: Request, answer) -> str:
        if isinstance(answer, asyncio.CancelledError):
            return CANCELLED
        if isinstance(answer, taskrpc.TaskRpcError):
            return UNTOUCHED if answer.not_executed is True else UNKNOWN
        if request.kind == "submit":
            request.task_id = answer.task_id
        elif answer.sum != 2 * request.number:
            self.broke("wrong answer", request.number)
        return ANSWERED

    # In the end

    async def compare(self) -> None:
        tasks = collections.defaultdict(list)
        for disk in self.disks:
            for task in (await disk.load()).tasks:
                tasks[task.target].append(task)
        self._waiting = {task.target for task in (await self.disks[-1].load()).tasks}
        for request in self.requests.values():
            if request.kind == "submit":
                self._compare_task(request, tasks[str(request.number)])
            else:
                self._compare_call(request)

    def _compare_call(self, request: Request) -> None:
        once = request.kind == "once"
        done = request.effects if once else len(request.started)
        if done > 1 and request.kind != "repeatable":
            self.broke("ran twice", request.number)
        if done and request.outcome == UNTOUCHED:
            self.broke("ran although not executed", request.number)
        if not done and request.outcome == ANSWERED:
            self.broke("lost", request.number)

    def _compare_task(self, request: Request, tasks) -> None:
        if len(tasks) > 1:
            self.broke("ran twice", request.number)
        if tasks and request.outcome == UNTOUCHED:
            self.broke("ran although not executed", request.number)
        if request.outcome == ANSWERED and [each.task_id for each in tasks] != [request.task_id]:
            self.broke("lost", f"{request.number}: told {request.task_id}, there is {tasks}")
        for task in tasks:
            runs = self.runs[task.target]
            if task.state is State.SUCCEEDED and not runs:
                self.broke("lost", f"task {task.task_id} was never done")
            if task.state is State.QUEUED and task.target in self._waiting:
                self.broke("lost", f"task {task.task_id} still waits")
            self.counts["interrupted tasks"] += task.state is State.INTERRUPTED
            self.counts["finished tasks"] += task.state is State.SUCCEEDED
