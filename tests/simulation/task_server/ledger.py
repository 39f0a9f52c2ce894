"""Compares what really happened in a run with what the callers were told."""

import collections
import functools
import json
import math
from dataclasses import dataclass, field

from accounts import Accounts
from disks import Disk
from orders import Orders
from records import fails

LATE = 0.02
"""Seconds by which a deadline may be missed: a few steps of a program."""
PROMPT = 0.2
"""Seconds within which callers notice the end of a server, after messages in transit."""
NOTICED = 1.0 + PROMPT
"""Seconds within which a server ends the connections of revoked accounts: it checks each second."""
INSIDE = "the server's inside"
"""The message of a callback's exception, which no caller may read."""
FORGOTTEN = ("the server does not remember this client", "has another store")
"""Responses too: an earlier one may be lost with its store, or on a broken connection; then the
outcome is unknown."""

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
    is_sent_once: bool
    """Whether nothing repeats it when its response is lost."""
    must_be_answered: bool
    outcome: str = ""
    senders: int = 0
    """Programs and calls that sent it under one id."""
    waiting: int = 0
    """Calls of the present life of the client that have not ended."""
    task_id: int = 0
    started: list[float] = field(default_factory=list)
    effects: collections.Counter[int] = field(default_factory=collections.Counter)
    """Keyed by the number of the disk."""
    server: str = ""
    """The server that began to execute it last."""
    runs: bool = False
    """Whether the server executes it now."""
    ends: float = math.inf
    hears_by: float = math.inf
    started_with: int = 0
    """The number of faults of its two programs before its execution started."""
    is_drained: bool = False
    """Whether its server was shut down, and had to wait for it."""

    @property
    def fails(self) -> bool:
        """Whether its callback raises."""
        return fails(self.number, self.kind)


class Ledger:
    """Reads the records of all programs in the order of time."""

    def __init__(self):
        self.counts = collections.Counter()
        self.broken = collections.defaultdict(list)
        """What broke each promise."""
        self.requests: dict[int, Request] = {}
        self.disks: dict[int, Disk] = {}
        self.now = 0.0
        self._program = ""
        """The program whose record is read."""
        self._orders = Orders(self)
        self._accounts = Accounts()
        self._present = 0
        """The number of the main server's disk."""
        self._tasks = collections.defaultdict(list)
        """The tasks at the end, with their disks, by target."""
        self._troubles = collections.Counter()
        """By program, the faults after which its messages may be lost."""
        self._apart: frozenset[str] = frozenset()
        self._accounts_settle = collections.Counter()
        """By server, when it has noticed the last change of an account."""

    def read(self, time, program, what, values):
        """Read one record."""
        self.now, self._program = time, program
        handler = getattr(self, "_on_" + what.replace(" ", "_"), None)
        if handler is None:
            self.counts[what] += 1
        else:
            handler(*values)

    def broke(self, promise, what):
        self.counts[promise] += 1
        self.broken[promise].append(f"{self.now:.3f} {what}")

    # Faults

    def _on_fault(self, text):
        words = text.split()
        match words[0]:
            case "part":
                self._apart = frozenset((words[1], words[3]))
                self._troubled(*self._apart)
                self.counts["partitions"] += 1
            case "cut":
                self._troubled(*(words[each].partition("#")[0] for each in (4, 6)))
                self.counts["cuts"] += 1
            case "wrong":
                self.counts["wrong clocks"] += 1
            case _ if words[-1] == "again":
                self._troubled(*self._apart)
                self._apart = frozenset()

    def _on_crash(self, text):
        name = self._program
        self.counts[f"crashes of {name.rstrip('0123456789')}"] += 1
        if name.startswith("client"):
            self._troubled(name)
            for request in self.requests.values():
                if request.client == name and request.waiting:
                    request.waiting, request.client = 0, ""
                    self._judge(request, UNKNOWN)
            return
        if name == "main" and self.disks:
            self.counts["crashes in a write"] += self._disk.is_written
        for request in self._running_on(name):
            is_near = {request.client, name} != self._apart
            if request.client and is_near and request.is_sent_once:
                request.hears_by = self.now + PROMPT
            request.runs = False

    def _troubled(self, *programs):
        """Messages of these programs may be lost now."""
        self._troubles.update(programs)
        for request in self.requests.values():
            if request.client in programs or request.server in programs:
                request.hears_by = math.inf

    def _troubles_of(self, request):
        return self._troubles[request.client] + self._troubles[request.server]

    # Servers

    def _on_accounts(self, roles):
        for user, role in roles.items():
            self._accounts.changed(self._program, self.now, user, role, False)

    def _on_account(self, user, role, revoked):
        self._accounts.changed(self._program, self.now, user, role, revoked)
        self.counts["revocations" if revoked else "changes of role"] += 1
        self._troubled(self._program)
        self._accounts_settle[self._program] = self.now + NOTICED

    def _on_run(self, number, until, principal, kind):
        request = self.requests[number]
        request.ends = until
        request.started.append(self.now)
        request.server, request.runs, request.is_drained = self._program, True, False
        request.started_with = self._troubles_of(request)
        if not self._accounts.may_use(self._program, principal, kind, self.now):
            self.broke("ran without the right", f"{number} for {principal}")

    def _on_ran(self, number, latest):
        self.requests[number].runs = False
        if self.now > latest + LATE:
            self.broke("ran on after the deadline", number)

    def _on_stopped(self, number):
        self.requests[number].runs = False

    def _on_drain(self, until):
        self.counts["drains"] += 1
        if self._program in self._apart or self.now < self._accounts_settle[self._program]:
            return
        for request in self._running_on(self._program):
            # A fault that cut its caller off before has ended it by now.
            has_settled = request.started[-1] < self.now - PROMPT
            if request.ends < until - LATE and has_settled and request.kind != "once":
                request.is_drained = True

    def _on_left_behind(self, what):
        self.broke("left behind", f"{self._program}: {what}")

    def _running_on(self, server):
        return [each for each in self.requests.values() if each.runs and each.server == server]

    # The disk and the robot

    @property
    def _disk(self):
        return self.disks[self._present]

    def _on_server_starts(self, number):
        self.counts["starts of servers"] += 1
        if number is not None:
            self._present = number
            if number not in self.disks:
                self.disks[number] = Disk(number, self)
            self._disk.opened()

    def _on_loaded(self, _, tasks):
        self._disk.loaded(tasks)

    def _on_saving(self, tasks):
        for task in self._disk.saving(tasks):
            self._orders.begins(self._disk, task, self.now)

    def _on_saved(self, numbers):
        self._disk.saved(numbers)

    def _on_not_saved(self, numbers, is_sure):
        self._disk.not_saved(numbers, is_sure=is_sure)

    def _on_moved(self, target):
        self._disk.moved(target)

    def _on_disk(self, number, tasks, effects):
        """Read the contents of a disk at the end."""
        disk = self.disks[number]
        disk.opened()
        disk.loaded(tasks)
        self._orders.compare(disk)
        for task in disk.tasks:
            self._tasks[task.target].append((disk, task))
        for effect in effects:
            self.requests[effect].effects[number] += 1

    # Clients

    def _on_ask(self, number, kind, deadline, is_sent_once, must_be_answered):
        client = self._program
        self.requests[number] = Request(
            number, kind, client, self.now, deadline, is_sent_once, must_be_answered
        )

    def _on_ask_again(self, number, deadline):
        self.counts["asked again"] += 1
        request = self.requests.get(number)
        if request is None:  # killed before it recorded the request
            self._on_ask(number, "", deadline, False, False)
            return
        request.client, request.deadline = self._program, max(request.deadline, deadline)

    def _on_send(self, number):
        self.requests[number].senders += 1
        self.requests[number].waiting += 1

    def _on_answered(self, number, value):
        request = self._ended(number)
        if request.kind == "submit":
            if request.task_id not in (0, value) and len(self.disks) == 1:
                self.broke("wrong answer", f"{number}: task {request.task_id}, then {value}")
            request.task_id = value
        elif request.fails or value != 2 * number:
            self.broke("wrong answer", number)
        self._told(request, ANSWERED)

    def _on_cancelled(self, number):
        self._told(self._ended(number), CANCELLED)

    def _on_failed(self, number, name, not_executed, text):
        request = self._ended(number)
        is_late = self.now > request.asked + LATE
        if request.kind == "nowhere" and request.is_sent_once and is_late:
            self.broke("waited without a server", number)
        if not_executed is not False:
            outcome = UNTOUCHED if not_executed else UNKNOWN
        else:
            outcome = FAILED
            if not request.fails or INSIDE in text:
                self.broke("wrong answer", f"{number}: {text}")
        is_forgotten = any(each in text for each in FORGOTTEN)
        if request.must_be_answered and outcome != FAILED and not is_forgotten:
            self.broke("did not come back", f"{number}: {name} {text}")
        is_quiet = request.started_with == self._troubles_of(request)
        is_lost = name in ("ConnectionLost", "OutcomeUnknown")
        if is_lost and request.is_drained and is_quiet:
            self.broke("lost in a drain", number)
        self._told(request, outcome)

    def _ended(self, number):
        request = self.requests[number]
        request.waiting -= 1
        return request

    def _told(self, request, outcome):
        self.counts[outcome] += 1
        if self.now > request.deadline + LATE:
            self.broke("waited beyond the deadline", f"{request.number} of {request.client}")
        if self.now > request.hears_by + LATE:
            self.broke("heard late of a crash", request.number)
        self._judge(request, outcome)

    def _judge(self, request, outcome):
        # Sent twice under one id, a request did not run only if neither of them did.
        request.outcome = max(request.outcome, outcome, key=SAYS_MORE.index)

    # Messages

    def _on_heard(self, messages):
        user = self._program.replace("client", "user")
        for topic, server, sent in messages:
            self.counts[f"heard of {topic}"] += 1
            if not self._accounts.may_hear(server, user, topic, sent):
                self.broke("heard without the right", f"{user}: {topic} of {sent}")

    def _on_heard_twice(self, what):
        self.broke("heard twice", f"{self._program}: {what}")

    def _on_heard_nothing(self):
        self.broke("heard nothing", self._program)

    def _on_heard_in_the_end(self, missing, lost):
        for topic, count in lost.items():
            self.counts["lost messages"] += count
            if missing[topic] > count:
                what = f"{self._program} lacks {missing[topic]} of {topic}, knows of {count}"
                self.broke("lost unseen", what)

    # Operators

    def _on_order(self, number, verb, task_id, priority):
        self._orders.given(number, verb, task_id, priority, self.now, self._present)

    def _on_order_ended(self, number, done):
        self._orders.told(number, done, self.now, self._present)

    # In the end

    def compare(self):
        """Compare what the callers were told with what is on the disks."""
        for request in self.requests.values():
            if request.kind == "submit":
                self._compare_task(request, self._tasks[str(request.number)])
            elif request.kind:
                self._compare_call(request)

    def _compare_call(self, request):
        is_once = request.kind == "once"
        done = request.effects.total() if is_once else len(request.started)
        if self._is_too_much(request, request.effects if is_once else {0: done}):
            self.broke("ran twice", f"{request.number} {request.kind}")
        if done and request.outcome == UNTOUCHED:
            self.broke("ran although not executed", request.number)
        if not done and request.outcome == ANSWERED:
            self.broke("lost", request.number)
        if not request.started and request.outcome == FAILED:
            self.broke("lost", request.number)

    def _is_too_much(self, request, done):
        """Whether it executed twice for one store, or in more stores than it was sent to."""
        if request.kind == "repeatable":
            return False
        return any(count > 1 for count in done.values()) or len(done) > max(1, request.senders)

    def _compare_task(self, request, tasks):
        if self._is_too_much(request, collections.Counter(disk.number for disk, _ in tasks)):
            self.broke("ran twice", f"{request.number}: {len(tasks)} tasks")
        if tasks and request.outcome == UNTOUCHED:
            self.broke("ran although not executed", request.number)
        numbers = [task.task_id for _, task in tasks]
        if request.outcome == ANSWERED and request.task_id not in numbers:
            self.broke("lost", f"{request.number}: told {request.task_id}, there is {numbers}")
        for disk, task in tasks:
            if task.state == "SUCCEEDED" and not disk.runs[task.target]:
                self.broke("lost", f"task {task.task_id} was never done")
            if task.state == "QUEUED" and disk is self._disk:
                self.broke("lost", f"task {task.task_id} still waits")
            self.counts["interrupted tasks"] += task.state == "INTERRUPTED"
            self.counts["finished tasks"] += task.state == "SUCCEEDED"


@functools.lru_cache(maxsize=1)
def verdict(world):
    """Return the ledger of a run that has ended."""
    found = []
    for program in ("main", "helper", "client0", "client1", "client2", "operator"):
        for line in world.lines(program):
            if line.startswith("[0") or line[:2].strip("[").isdigit():
                time, what, *values = json.loads(line)
                found.append((time, program, what, values))
    found += [(each.time, each.program, each.kind, [each.text]) for each in world.faults()]
    found.sort(key=lambda each: each[0])
    ledger = Ledger()
    for each in found:
        ledger.read(*each)
    ledger.compare()
    return ledger
