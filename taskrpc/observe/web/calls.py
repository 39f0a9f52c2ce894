"""The calls of a task server, and statistics of them, for the live page.

`CallLog` is an observer of the server's node. While no page is open it only counts. It keeps the
newest calls until the next event, at most `MAX_CALLS`, and makes their JSON only then: a flood of
calls costs little more than counting it.
"""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Any

import msgspec

from taskrpc import CallInfo, Observer
from taskrpc.errors import Code
from taskrpc.observe.web.streams import MAX_CALLS, CallsEvent
from taskrpc.robot.tasks.page_events import client_label
from taskrpc.spi import ReceivedId

SLOW = 0.05
"""Seconds after which a call is shown although it has not ended."""
MAX_DURATIONS = 1000
"""Newest calls from which the percentiles are computed."""
MAX_REQUESTS = 4096
"""Request ids that are remembered to count attempts."""
MAX_CALLERS = 100
"""Callers that are remembered; ten times as many accounts have a count of their own."""
CALLER_SECONDS = 60.0
"""Seconds for which a caller is shown after its last call."""
RATE_SECONDS = 3.0
"""Seconds over which calls per second are measured."""

EARLY = 0.1
"""A call that is cancelled so many seconds before its deadline, or later, counts as expired.

The caller's timeout passes before the server's deadline, by the time that the request travels.
"""

_WAITING_SERVICES = ("/watch",)  # their calls wait on purpose, so their durations do not count
_NOT_BY_STUDENTS = ("/health", "/page")  # `taskrpc join` and `taskrpc view` call these themselves
_MAX_MESSAGE = 200  # characters of a response's message


class ShownCall(msgspec.Struct):
    """One call as the page shows it."""

    id: int
    """Counts the calls; negative for calls between other programs."""
    client: str
    account: str
    service: str
    begin: float
    """Seconds since 1970."""
    ms: float | None = None
    """Milliseconds until the end; None while it is open."""
    state: str = "open"
    """`open`, `ok` or `error`."""
    code: str = ""
    """The status code of an error, such as `DEADLINE_EXCEEDED`."""
    deadline_ms: float | None = None
    """Milliseconds that the caller waits at most; None: without a limit."""
    attempt: int = 1
    """From 1, as far as the server knows: only requests with a request id can be recognised."""
    repeated: bool = False
    """Whether the request got the stored response, without running again."""
    task_id: int | None = None
    """The task that the call is about."""


class _Open:
    """A call that has begun and not ended."""

    __slots__ = ("call", "is_shown", "refusal", "shown", "since")

    def __init__(self, call: CallInfo, shown: ShownCall, since: float) -> None:
        self.call = call
        self.shown = shown
        self.since = since  # on the loop's clock
        self.is_shown = False  # whether an event had it as an open call
        self.refusal: str | None = None  # the message of a response with `success` false


class Caller(msgspec.Struct):
    """A program that has called."""

    name: str
    account: str
    machine: str
    """The address of its machine, "" for the server's own."""
    services: dict[str, None]
    """The services that it has called, at most `MAX_CALLERS`."""
    at: float
    """When it called last, on the loop's clock."""


class Problem(msgspec.Struct, frozen=True):
    """Why a call failed."""

    service: str
    code: str
    """The status code, such as `DEADLINE_EXCEEDED`; "" for a response that says no."""
    message: str = ""
    """The message of this response."""


class AccountCalls(msgspec.Struct):
    """The calls of one account."""

    calls: int = 0
    first: float = 0.0
    """When the first one began, in seconds since 1970."""
    last: float = 0.0
    """When the last one began, in seconds since 1970."""
    succeeded: int = 0
    """How many succeeded; those of `taskrpc join` and the page do not count."""
    problem: Problem | None = None
    """Why the last call failed; None if it succeeded."""


class CallLog(Observer):
    """Keeps the newest calls and statistics: `Node(observer=log)`."""

    def __init__(self, wall_clock: Callable[[], float] = time.time) -> None:
        self.is_active = False
        """Whether pages are open, so that calls are kept."""
        self.callers: OrderedDict[tuple[str, str, str], Caller] = OrderedDict()
        """The programs that have called while pages were open; the one that called last is last."""
        self.accounts: dict[str, AccountCalls] = {}
        """The calls of each account."""
        self._wall_clock = wall_clock
        self._open: dict[int, _Open] = {}
        """By call number."""
        self._ended: deque[ShownCall] = deque(maxlen=MAX_CALLS)
        """The newest calls since the last event."""
        self._skipped = 0
        """Calls since the last event that are not in it."""
        self._durations: deque[float] = deque(maxlen=MAX_DURATIONS)
        """Milliseconds of the newest calls."""
        self._attempts: OrderedDict[tuple[str, bytes, int], int] = OrderedDict()
        """How often each request has arrived."""
        self._total = self._errors = 0
        self._rates: deque[tuple[float, int]] = deque()
        """The total at recent events, with their instants."""
        self._stats = b""
        """The statistics of the last event."""

    # The methods of an observer

    def call_began(self, call: CallInfo) -> None:
        """Note a call."""
        now = self._wall_clock()
        if call.principal and (len(self.accounts) < 10 * MAX_CALLERS or self._is_known(call)):
            account = self.accounts.setdefault(call.principal, AccountCalls(first=now))
            account.calls += 1
            account.last = now
        shown = self._shown(call, now)
        self._open[call.number] = _Open(call, shown, call.clock())
        if self.is_active:
            shown.attempt = self._attempt(call)
            self._note_caller(call)

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """Note the task that a response is about, and whether it says no."""
        found = self._open.get(call.number)
        if found is None:
            return
        if self.is_active:
            found.shown.task_id = _task_of(response) or found.shown.task_id
        if call.principal and getattr(response, "success", True) is False:
            found.refusal = str(getattr(response, "message", ""))

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """Note the end of a call."""
        self._total += 1
        is_ok = code is Code.OK
        if not is_ok:
            self._errors += 1
        found = self._open.pop(call.number, None)
        if call.principal in self.accounts and not call.service.endswith(_NOT_BY_STUDENTS):
            _note_end(self.accounts[call.principal], call, code, found.refusal if found else None)
        if not self.is_active:
            return
        shown = self._shown(call, self._wall_clock()) if found is None else found.shown
        shown.ms = round(seconds * 1000, 3)
        shown.state = "ok" if is_ok else "error"
        shown.code = "" if is_ok else _reason(call, code).name
        shown.repeated = call.repeated
        if call.repeated:  # an earlier attempt may have reached an earlier server
            shown.attempt = max(shown.attempt, 2)
        if shown.task_id is None:
            shown.task_id = _task_of(getattr(call, "request", None))
        if not call.service.endswith(_WAITING_SERVICES):
            self._durations.append(shown.ms)
        self.add(shown)

    def add(self, shown: ShownCall) -> None:
        """Show a call in the next event."""
        self._skipped += len(self._ended) == MAX_CALLS
        self._ended.append(shown)

    def event(self, now: float, *, always: bool = False) -> CallsEvent | None:
        """Return the calls since the last event, None if nothing has changed.

        With `always` there is an event in any case: a page that opens needs the statistics.
        """
        slow = [each for each in self._open.values() if self._is_due(each, now)]
        for each in slow:
            each.is_shown = True
            if each.shown.task_id is None:
                each.shown.task_id = _task_of(getattr(each.call, "request", None))
            each.shown.repeated = each.call.repeated
        shown = [*(each.shown for each in slow), *self._ended]
        surplus = max(0, len(shown) - MAX_CALLS)
        skipped, stats = self._skipped + surplus, self._statistics(now)
        self._ended.clear()
        self._skipped = 0
        if not (shown or always) and stats == self._stats:
            return None
        self._stats = stats
        return CallsEvent([msgspec.json.encode(each) for each in shown[surplus:]], skipped, stats)

    # Internals

    def _shown(self, call: CallInfo, now: float) -> ShownCall:
        left = None if call.deadline is None else round((call.deadline - call.clock()) * 1000, 1)
        return ShownCall(
            call.number,
            client_label(call.caller),
            call.principal,
            call.service,
            now,
            deadline_ms=left,
        )

    def _is_known(self, call: CallInfo) -> bool:
        return call.principal in self.accounts

    def _is_due(self, each: _Open, now: float) -> bool:
        return not each.is_shown and now - each.since >= SLOW

    def _attempt(self, call: CallInfo) -> int:
        received: ReceivedId | None = getattr(call, "received_id", None)
        if received is None:
            return 1
        key = call.principal, received.client, received.sequence
        count = self._attempts[key] = self._attempts.pop(key, 0) + 1
        if len(self._attempts) > MAX_REQUESTS:
            self._attempts.popitem(last=False)
        return count

    def _note_caller(self, call: CallInfo) -> None:
        key = call.caller, call.principal, call.machine
        caller = self.callers.get(key)
        if caller is None:
            caller = self.callers[key] = Caller(*key, {}, 0.0)
            if len(self.callers) > MAX_CALLERS:
                self.callers.popitem(last=False)
        else:
            self.callers.move_to_end(key)
        caller.at = call.clock()
        if len(caller.services) < MAX_CALLERS:
            caller.services[call.service] = None

    def _statistics(self, now: float) -> bytes:
        rates = self._rates
        rates.append((now, self._total))
        while len(rates) > 2 and rates[1][0] <= now - RATE_SECONDS:
            rates.popleft()
        seconds, calls = min(now - rates[0][0], RATE_SECONDS), self._total - rates[0][1]
        durations = sorted(self._durations)
        return msgspec.json.encode(
            {
                "per_second": round(calls / seconds, 1) if seconds > 0 else 0.0,
                "p50_ms": _percentile(durations, 0.50),
                "p99_ms": _percentile(durations, 0.99),
                "errors": self._errors,
                "total": self._total,
                "open": len(self._open),
            }
        )


def _note_end(account: AccountCalls, call: CallInfo, code: Code, refusal: str | None) -> None:
    """Note whether a call of an account has succeeded."""
    if code is not Code.OK:
        account.problem = Problem(call.service, _reason(call, code).name)
    elif refusal is not None:
        account.problem = Problem(call.service, "", refusal[:_MAX_MESSAGE])
    else:
        account.succeeded += 1
        account.problem = None


def _reason(call: CallInfo, code: Code) -> Code:
    """Return why a call failed: a client cancels the call when its timeout passes."""
    left = call.time_left()
    is_late = code is Code.CANCELLED and left is not None and left <= EARLY
    return Code.DEADLINE_EXCEEDED if is_late else code


def live_callers(log: CallLog) -> list[Caller]:
    """Return the callers of the last `CALLER_SECONDS`."""
    oldest = asyncio.get_running_loop().time() - CALLER_SECONDS
    return [caller for caller in log.callers.values() if caller.at >= oldest]


def _percentile(ordered: list[float], share: float) -> float | None:
    if not ordered:
        return None
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def _task_of(message: Any) -> int | None:
    task_id = getattr(message, "task_id", None)
    return task_id if isinstance(task_id, int) and task_id > 0 else None
