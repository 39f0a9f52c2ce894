"""Records what really happened and what the callers were told, and compares both."""

from __future__ import annotations

import asyncio
import collections
import math
from dataclasses import dataclass, field

import taskrpc
from taskrpc.robot.tasks.model import TaskState
from tests.simulation.orders import Orders

LATE = 0.02
"""Seconds by which a deadline may be missed: a tick, and the resolution of the loop."""

PROMPT = 0.2
"""Seconds within which callers notice the end of a server, after messages in transit."""

NOTICED = 1.0 + PROMPT
"""Seconds within which a server ends the connections of revoked accounts: it checks each second."""

INSIDE = "the server's inside"
"""The message of a callback's exception, which no caller may read."""

FORGOTTEN = ("the server does not remember this client", "has another store")
"""Responses too: an earlier one may be lost with its store, or on a broken connection; then the
outcome is unknown."""

PROMISES = (
    "ran twice",
    "ran although not executed",
    "lost",
    "wrong answer",
    "out of order",
    "began while paused",
    "began although called off",
    "forbidden move",
    "robot moved twice",
    "robot moved before it was stored",
    "ran on after the deadline",
    "ran without the right",
    "waited beyond the deadline",
    "waited without a server",
    "heard late of a crash",
    "lost in a drain",
    "heard twice",
    "heard nothing",
    "heard without the right",
    "lost unseen",
    "did not come back",
    "left behind",
)
"""Counts that must be zero."""

ANSWERED, UNTOUCHED, UNKNOWN, CANCELLED = "answered", "not executed", "unknown", "cancelled"
FAILED = "ran and failed"
SAYS_MORE = ("", UNTOUCHED, CANCELLED, UNKNOWN, FAILED, ANSWERED)


@dataclass(eq=False)
class Request:
    """One call of a client and its outcome."""

    number: int
    kind: str
    client: str
    asked: float
    deadline: float
    request_id: str = ""
    is_sent_once: bool = False
    """Whether nothing repeats it when its response is lost."""
    must_be_answered: bool = False
    outcome: str = ""
    senders: int = 0
    """Programs and calls that sent it under one id."""
    task_id: int = 0
    started: list[float] = field(default_factory=list)
    effects: collections.Counter[int] = field(default_factory=collections.Counter)
    """Keyed by the number of the disk."""
    runs_on: str = ""
    """The server that executes it now."""
    ends: float = math.inf
    hears_by: float = math.inf
    started_with: int = 0
    """The number of network faults before its execution started."""
    is_drained: bool = False
    """Whether its server was shut down, and had to wait for it."""

    @property
    def fails(self) -> bool:
        """Whether its callback raises."""
        return self.number % 9 == 4 and self.kind not in ("submit", "nowhere")


class Ledger:
    """Records all events, and compares them."""

    def __init__(self, counts, tell=None):
        self.counts = counts
        self.lines: list[str] = []
        self.requests: dict[int, Request] = {}
        self.lives = 0
        """Of publishers."""
        self.disks = []
        self.orders = Orders(self)
        self.network_happened: collections.Counter[str] = collections.Counter()
        self._troubles = 0
        self._accounts_settle = 0.0
        self.runs: collections.Counter[tuple[int, str]] = collections.Counter()
        self._tell = tell
        self._loop = asyncio.get_running_loop()

    def now(self) -> float:
        return self._loop.time()

    def note(self, what: str) -> None:
        line = f"{self._loop.time():.6f} {what}"
        self.lines.append(line)
        if self._tell is not None:
            self._tell(line)

    def broke(self, promise: str, what: object) -> None:
        self.counts[promise] += 1
        self.note(f"BROKEN: {promise}: {what}")

    @property
    def trouble(self) -> int:
        """Counts events that may break a connection or lose its messages."""
        return self._troubles + self.network_happened["cuts"] + self.network_happened["deaths"]

    # What servers do

    def started(self, number: int, server: str, until: float) -> None:
        """Record that a callback starts; it ends at `until` unless it is stopped."""
        request = self.requests[number]
        request.ends = until
        request.started_with = self.trouble
        request.started.append(self._loop.time())
        request.runs_on = server
        self.note(f"run {number}")

    def finished(self, number: int, latest: float) -> None:
        self.note(f"ran {number}")
        self.requests[number].runs_on = ""
        if self._loop.time() > latest + LATE:
            self.broke("ran on after the deadline", number)

    def stopped(self, number: int) -> None:
        """Record that a callback was cancelled."""
        self.note(f"stopped {number}")
        self.requests[number].runs_on = ""

    def had_effect(self, number: int, disk: int) -> None:
        self.requests[number].effects[disk] += 1
        self.note(f"effect {number}")

    def drains(self, server: str, until: float) -> None:
        """Record that a server drains while the network has no faults."""
        if self.now() < self._accounts_settle:
            return
        for request in self._running_on(server):
            # Whatever had cut its caller off before has ended it by now.
            has_settled = request.started[-1] < self.now() - PROMPT
            if request.ends < until and has_settled and request.kind not in ("once", "submit"):
                request.is_drained = True

    def crashed(self, server: str, hear_of_it: set[str]) -> None:
        """Record that a server died; these clients can notice it."""
        for request in self._running_on(server):
            if request.client in hear_of_it and request.is_sent_once:
                request.hears_by = self._loop.time() + PROMPT
            request.runs_on = ""

    def troubled(self) -> None:
        """Record a network fault, after which messages may be lost."""
        self._troubles += 1
        for request in self.requests.values():
            request.hears_by = math.inf

    def account_changed(self) -> None:
        """Record that some callers may be disconnected, though not at once."""
        self.troubled()
        self._accounts_settle = self.now() + NOTICED

    def _running_on(self, server: str) -> list[Request]:
        return [each for each in self.requests.values() if each.runs_on == server]

    # What the robot does

    def chosen(self, disk, task, waiting) -> None:
        """Record that the worker starts a task; the store holds the queued ones."""
        place = (-task.priority, task.arrival)
        better = [each.task_id for each in waiting if (-each.priority, each.arrival) < place]
        if better:
            self.broke("out of order", f"task {task.task_id} before {better}")
        self.orders.begins(disk.number, task, self._loop.time())

    def moved(self, disk, target: str) -> None:
        """Record that the robot starts a task's action."""
        self.runs[disk.number, target] += 1
        self.note(f"robot {target}")
        task = disk.task_of(target)
        if task is None or not task.state.is_begun:
            self.broke("robot moved before it was stored", target)
        elif self.runs[disk.number, target] > 1 + disk.requeues[task.task_id]:
            self.broke("robot moved twice", target)

    # What clients are told

    def asked(self, kind: str, client: str, timeout: float, **more) -> Request:
        number, now = len(self.requests) + 1, self._loop.time()
        request = Request(number, kind, client, now, now + timeout, **more)
        self.requests[number] = request
        self.note(f"ask {number} {kind} {timeout:.3f}")
        return request

    def abandoned(self, request: Request) -> None:
        """Record that the caller died: it received no response."""
        request.outcome = max(request.outcome, UNKNOWN, key=SAYS_MORE.index)
        request.client = ""

    def told(self, request: Request, answer) -> None:
        outcome, now = self._outcome(request, answer), self._loop.time()
        self.counts[outcome] += 1
        said = answer if isinstance(answer, BaseException) else ""
        self.note(f"told {request.number} {outcome} {said!r}")
        # Sent twice under one id, a request did not run only if neither of them did.
        request.outcome = max(request.outcome, outcome, key=SAYS_MORE.index)
        if now > request.deadline + LATE:
            self.broke("waited beyond the deadline", request.number)
        if now > request.hears_by + LATE:
            self.broke("heard late of a crash", request.number)
        is_forgotten = any(each in str(said) for each in FORGOTTEN)
        if request.must_be_answered and outcome not in (ANSWERED, FAILED) and not is_forgotten:
            self.broke("did not come back", request.number)
        is_quiet = request.started_with == self.trouble
        if isinstance(answer, taskrpc.ConnectionLost) and request.is_drained and is_quiet:
            self.broke("lost in a drain", request.number)

    def _outcome(self, request: Request, answer) -> str:
        if isinstance(answer, asyncio.CancelledError):
            return CANCELLED
        if isinstance(answer, taskrpc.TaskRpcError):
            return self._failure(request, answer)
        if request.kind == "submit":
            if request.task_id not in (0, answer.task_id) and len(self.disks) == 1:
                self.broke("wrong answer", f"{request.task_id}, then {answer.task_id}")
            request.task_id = answer.task_id
        elif request.fails or answer.sum != 2 * request.number:
            self.broke("wrong answer", request.number)
        return ANSWERED

    def _failure(self, request: Request, error) -> str:
        is_late = self._loop.time() > request.asked + LATE
        if request.kind == "nowhere" and request.is_sent_once and is_late:
            self.broke("waited without a server", request.number)
        if error.not_executed is not False:
            return UNTOUCHED if error.not_executed else UNKNOWN
        if not request.fails or INSIDE in str(error):
            self.broke("wrong answer", f"{request.number}: {error}")
        return FAILED

    # In the end

    async def compare(self) -> None:
        stored = [(disk, (await disk.load()).tasks) for disk in self.disks]
        tasks = collections.defaultdict(list)
        for disk, found in stored:
            self.orders.compare(disk, found)
            for task in found:
                tasks[task.target].append((disk.number, task))
        for request in self.requests.values():
            if request.kind == "submit":
                self._compare_task(request, tasks[str(request.number)])
            else:
                self._compare_call(request)

    def _compare_call(self, request: Request) -> None:
        once = request.kind == "once"
        done = request.effects.total() if once else len(request.started)
        if self._is_too_much(request, request.effects if once else {0: done}):
            self.broke("ran twice", request.number)
        if done and request.outcome == UNTOUCHED:
            self.broke("ran although not executed", request.number)
        if not done and request.outcome == ANSWERED:
            self.broke("lost", request.number)
        if not request.started and request.outcome == FAILED:
            self.broke("lost", request.number)

    def _is_too_much(self, request: Request, done) -> bool:
        """Whether it executed twice for one store, or in more stores than it was sent to."""
        if request.kind == "repeatable":
            return False
        return any(count > 1 for count in done.values()) or len(done) > max(1, request.senders)

    def _compare_task(self, request: Request, tasks) -> None:
        if self._is_too_much(request, collections.Counter(disk for disk, _ in tasks)):
            self.broke("ran twice", request.number)
        if tasks and request.outcome == UNTOUCHED:
            self.broke("ran although not executed", request.number)
        numbers = [task.task_id for _, task in tasks]
        if request.outcome == ANSWERED and request.task_id not in numbers:
            self.broke("lost", f"{request.number}: told {request.task_id}, there is {numbers}")
        for disk, task in tasks:
            if task.state is TaskState.SUCCEEDED and not self.runs[disk, task.target]:
                self.broke("lost", f"task {task.task_id} was never done")
            if task.state is TaskState.QUEUED and disk == self.disks[-1].number:
                self.broke("lost", f"task {task.task_id} still waits")
            self.counts["interrupted tasks"] += task.state is TaskState.INTERRUPTED
            self.counts["finished tasks"] += task.state is TaskState.SUCCEEDED
