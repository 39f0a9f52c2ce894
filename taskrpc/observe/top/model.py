"""What `taskrpc top` shows: rates and percentiles, computed from readings of programs' counts.

Pure: time is in the readings.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import NamedTuple, TypeAlias

import msgspec

from taskrpc.errors import Code
from taskrpc.spi import (
    ProgramStatistics,
    RegistryEntry,
    ServiceStatistics,
    Statistics,
    names,
    percentile,
)

WINDOW = 5.0
"""Seconds of which rates and latencies are shown; one reading back if the readings are rarer."""

_MOST_READINGS = 64  # of a program that are kept: more than the window holds
_SLACK = 0.05  # seconds by which a reading may be late and still be in the window
_NO_ERRORS = frozenset({Code.OK, Code.CANCELLED})


class ServiceRow(msgspec.Struct, frozen=True):
    """One service; the servers of one name are added up."""

    name: str
    nodes: tuple[str, ...]
    """The nodes that offer it."""
    per_second: float | None
    """Calls a second; None before the second reading."""
    p50: float | None
    """Seconds from arrival to response, as half of the calls; None without calls."""
    p99: float | None
    errors: int
    """Calls that failed since `top` began to watch."""
    errors_now: int
    """Calls that failed within the window."""
    codes: dict[int, int]
    """How many calls have ended since `top` began to watch, by status code."""
    running: int
    waiting: int


class NodeRow(msgspec.Struct, frozen=True):
    """One node, and the program in which it is."""

    name: str
    program: str
    pid: int
    """0 for a program on another machine."""
    cpu: float | None
    """CPU time of the program, as a fraction of one processor; None if it is unknown."""
    calls_in: float | None
    """Calls a second that its services have answered."""
    calls_out: float | None
    """Calls a second that it has made, as far as measured programs have answered them."""
    problem: str
    """Why the program has no statistics, "" if it has."""


class TaskRow(msgspec.Struct, frozen=True):
    """A task that runs or waits."""

    task_id: int
    work: str
    priority: int
    state: str
    progress: float
    """0 to 1."""
    done_in: float
    """Seconds."""
    client: str


class Pose(NamedTuple):
    """Where the robot is: metres, and radians from the x axis."""

    x: float
    y: float
    theta: float


class TaskServerRow(msgspec.Struct, frozen=True):
    """A task server: its queue and its robot."""

    service: str
    paused: bool = False
    queued: int = 0
    tasks: tuple[TaskRow, ...] = ()
    """The running task and the first ones of the queue."""
    pose: Pose | None = None
    problem: str = ""
    """Why it cannot be read, "" if it can."""

    @property
    def state(self) -> str:
        """What the robot does: `paused`, `working` or `idle`."""
        if self.paused:
            return "paused"
        return "working" if self.tasks and self.tasks[0].state != "QUEUED" else "idle"


class View(msgspec.Struct, frozen=True):
    """Everything that one picture shows."""

    time: float
    """Seconds since 1970."""
    domain: int
    address: str
    """The address of the one program that is watched, "" for this machine."""
    seconds: float
    """The time of which rates and latencies are shown: `WINDOW`, less at first; 0: none yet."""
    programs: int
    services: tuple[ServiceRow, ...]
    nodes: tuple[NodeRow, ...]
    task_servers: tuple[TaskServerRow, ...]
    elsewhere: tuple[int, ...] = ()
    """Other domains in which programs run; known only if none runs in this one."""

    @property
    def per_second(self) -> float | None:
        """Calls a second of all services; None before the second reading."""
        known = [each.per_second for each in self.services if each.per_second is not None]
        return sum(known) if known else None

    @property
    def open(self) -> int:
        """Calls that run or wait."""
        return sum(each.running + each.waiting for each in self.services)

    @property
    def errors(self) -> int:
        """Calls that failed since `top` began to watch."""
        return sum(each.errors for each in self.services)

    @property
    def errors_now(self) -> int:
        """Calls that failed within the window."""
        return sum(each.errors_now for each in self.services)


_Key: TypeAlias = tuple[int, str]
"""A program: its process id and address."""


class History:
    """The last readings of each program.

    Args:
        hidden: whether services and nodes with hidden names are shown.
    """

    def __init__(self, *, hidden: bool = False) -> None:
        self._hidden = hidden
        self._programs: dict[_Key, _Program] = {}
        self._called: set[str] = set()
        """Services that were called while `top` watches; they and their nodes stand first."""

    def add(self, programs: Sequence[ProgramStatistics]) -> None:
        """Add a reading of all programs."""
        known = self._programs
        self._programs = {}
        for each in programs:
            program = known.get(key := _key(each.entry)) or _Program()
            program.add(each)
            self._programs[key] = program

    def services(self) -> tuple[ServiceRow, ...]:
        """Return the services: those that were called first, then by name."""
        found: dict[str, list[tuple[_Program, ServiceStatistics]]] = {}
        for program in self._programs.values():
            for service in program.services():
                if self._hidden or not names.is_hidden(service.name):
                    found.setdefault(service.name, []).append((program, service))
        rows = [_service_row(name, parts) for name, parts in found.items()]
        self._called.update(row.name for row in rows if row.codes)
        return tuple(sorted(rows, key=lambda row: (row.name not in self._called, row.name)))

    def nodes(self) -> tuple[NodeRow, ...]:
        """Return the nodes: those of programs with a problem, those with called services, others.

        A program with a problem has at least one row.
        """
        callers: Counter[str] = Counter()
        for program in self._programs.values():
            callers.update(program.callers())
        known = callers if self._seconds > 0 else None
        rows = [row for program in self._programs.values() for row in program.nodes(known)]
        shown = (row for row in rows if self._hidden or not names.is_hidden(row.name))
        called = {
            (program.latest.entry.pid, service.node)
            for program in self._programs.values()
            for service in program.latest.entry.services
            if service.name in self._called
        }

        def order(row: NodeRow) -> tuple[bool, bool, str, int]:
            return not row.problem, (row.pid, row.name) not in called, row.name, row.pid

        return tuple(sorted(shown, key=order))

    def view(
        self,
        time: float,
        *,
        domain: int = 0,
        address: str = "",
        task_servers: Iterable[TaskServerRow] = (),
        elsewhere: Iterable[int] = (),
    ) -> View:
        """Return what a picture shows."""
        services, nodes = self.services(), self.nodes()
        programs = len({(row.pid, row.program) for row in nodes})
        servers = tuple(task_servers)
        others = tuple(elsewhere)
        return View(
            time, domain, address, self._seconds, programs, services, nodes, servers, others
        )

    @property
    def _seconds(self) -> float:
        return max((each.seconds for each in self._programs.values()), default=0.0)


class _Program:
    """The readings of one program."""

    def __init__(self) -> None:
        self.latest: ProgramStatistics
        self._first: Statistics | None = None
        """The reading with which watching began; None before."""
        self._window: deque[Statistics] = deque(maxlen=_MOST_READINGS)
        """The readings of the window; the oldest one may be a little older."""

    def add(self, reading: ProgramStatistics) -> None:
        """Add a reading; the counts may have begun anew since the last one."""
        self.latest, now = reading, reading.statistics
        if now is None:
            return
        if self._window and self._window[-1].since != now.since:
            self._window.clear()
            self._first = None
        self._first = self._first or now
        self._window.append(now)
        while len(self._window) > 2 and now.clock - self._window[1].clock >= WINDOW - _SLACK:
            self._window.popleft()

    @property
    def seconds(self) -> float:
        """The time between the first and the last reading of the window, 0 if there is only one."""
        return self._window[-1].clock - self._window[0].clock if self._window else 0.0

    def services(self) -> list[ServiceStatistics]:
        """Return the services of the last reading; none if there was no response."""
        return [] if self.latest.statistics is None else self.latest.statistics.services

    def nodes_of(self, service: str) -> list[str]:
        """Return the nodes that offer a service."""
        return [each.node for each in self.latest.entry.services if each.name == service]

    def recent(self, name: str) -> tuple[Counter[int], Counter[int]]:
        """Return the calls of a service within the window, by code and by duration."""
        return _between(self._window[0], self._window[-1], name)

    def since_first(self, name: str) -> Counter[int]:
        """Return the calls of a service since watching began, by code."""
        assert self._first is not None, "a service without a reading"
        return _between(self._first, self._window[-1], name)[0]

    def callers(self) -> dict[str, float]:
        """Return the calls a second of each calling node."""
        if self.latest.statistics is None or not self.seconds > 0:
            return {}
        before, now = self._window[0].callers, self._window[-1].callers
        return {name: (now[name] - before.get(name, 0)) / self.seconds for name in now}

    def nodes(self, callers: Mapping[str, float] | None) -> list[NodeRow]:
        """Return a row for each node; `callers`: the calls a second of each, None if unknown."""
        entry, problem = self.latest.entry, self.latest.problem
        measured = self.latest.statistics is not None and self.seconds > 0
        cpu = None
        if measured:
            cpu = (self._window[-1].cpu - self._window[0].cpu) / self.seconds
        nodes = entry.nodes or ((entry.script,) if problem else ())
        served = self._served() if measured else {}
        return [
            NodeRow(
                node,
                entry.script,
                entry.pid,
                cpu,
                served.get(node, 0.0) if measured else None,
                None if callers is None else callers.get(node, 0.0),
                problem,
            )
            for node in nodes
        ]

    def _served(self) -> dict[str, float]:
        found: dict[str, float] = {}
        counted = set()
        for service in self.latest.entry.services:
            if service.name not in counted:  # a ROS program may announce two servers of a name
                counted.add(service.name)
                calls = sum(self.recent(service.name)[0].values()) / self.seconds
                found[service.node] = found.get(service.node, 0.0) + calls
        return found


def _service_row(name: str, parts: list[tuple[_Program, ServiceStatistics]]) -> ServiceRow:
    codes: Counter[int] = Counter()
    durations: Counter[int] = Counter()
    rates: list[float] = []
    errors_now = 0
    for program, _ in parts:
        recent, recent_durations = program.recent(name)
        codes.update(program.since_first(name))
        durations.update(recent_durations)
        errors_now += _errors(recent)
        if program.seconds > 0 and isfinite(program.seconds):
            rates.append(sum(recent.values()) / program.seconds)
    return ServiceRow(
        name,
        tuple(sorted({node for program, _ in parts for node in program.nodes_of(name)})),
        sum(rates) if rates else None,
        percentile(durations, 0.5),
        percentile(durations, 0.99),
        _errors(codes),
        errors_now,
        dict(codes),
        sum(service.running for _, service in parts),
        sum(service.waiting for _, service in parts),
    )


def _between(before: Statistics, now: Statistics, name: str) -> tuple[Counter[int], Counter[int]]:
    """Return how many calls of a service have ended between two readings."""
    (codes, durations), (codes_now, durations_now) = _counts(before, name), _counts(now, name)
    return codes_now - codes, durations_now - durations


def _counts(reading: Statistics, name: str) -> tuple[Counter[int], Counter[int]]:
    for service in reading.services:
        if service.name == name:
            return Counter(service.codes), Counter(service.durations)
    return Counter(), Counter()


def _errors(codes: Mapping[int, int]) -> int:
    return sum(count for code, count in codes.items() if code not in _NO_ERRORS)


def _key(entry: RegistryEntry) -> _Key:
    return entry.pid, entry.address or entry.script
