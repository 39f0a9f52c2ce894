"""A robot of a fleet as its database knows it, and what it can do: plain values."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from fnmatch import fnmatchcase

import msgspec

from taskrpc.robot.protocol import Pose
from taskrpc.robot.world import coordinates

LEASE = 6.0
"""Seconds for which a robot belongs to its server after the server has renewed its lease."""
REMEMBERED = 7 * 24 * 3600.0
"""Seconds for which tasks are queued for a robot whose server does not run."""


class Meta(msgspec.Struct, frozen=True):
    """The facts about the whole fleet."""

    revision: int = 0
    """Counts the transactions that changed anything; each changed row has the revision of its
    transaction."""
    next_id: int = 1
    """The id of the next task."""
    next_arrival: int = 1
    """The next number in the order of arrival."""
    paused: bool = False
    """Whether no robot may begin a task."""
    halts: int = 0
    """Counts the requests to halt all robots at once."""
    halt_reason: str = ""
    """The message of the tasks that the last of these requests ended."""


class RobotRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One robot, its server and its lease. Instants are seconds since 1970, by the database."""

    name: str
    server: str
    """The id of the server that drives it, drawn at random when the server started."""
    address: str = ""
    """Where that server listens, for error texts."""
    host: str = ""
    """The name of the machine on which that server runs, for error texts."""
    pid: int = 0
    """That server's process there, for error texts."""
    epoch: int = 1
    """Counts the leases: a server writes only while its robot still has the server's epoch."""
    lease_until: float = 0.0
    """When the lease ends."""
    is_gone: bool = False
    """Whether its server has ended, or lost its lease."""
    task_types: tuple[str, ...] = ()
    capabilities: str = ""
    """What it may do, as the operator wrote it; see `Capabilities`. "" for everything."""
    places: tuple[str, ...] = ()
    """The named places that it reaches; empty if it does not tell."""
    size: tuple[float, float] | None = None
    """Width and height of its map in metres; None if it does not tell."""
    tells_all: bool = False
    """Whether it reaches nothing else than `places`, and x,y on its map if it has a `size`."""
    speed: float = 1.0
    """Robot seconds in a real second."""
    pose: Pose = Pose(0.0, 0.0, 0.0)
    """Its pose when it will be free."""
    free_at: float = 0.0
    """When it will have ended its task; an instant in the past if it is free."""
    task_id: int = 0
    """The task that it executes; 0 for none."""
    at: Pose | None = None
    """Where it was when the lease was renewed last."""
    paused: bool = False
    """Whether it may begin no task until an operator resumes this robot."""
    halts: int = 0
    """Counts the requests to halt this robot at once."""
    halt_reason: str = ""
    """The message of the task that the last of these requests ended."""

    def is_live(self, now: float) -> bool:
        """Return whether its server holds a lease."""
        return not self.is_gone and self.lease_until > now

    def activity(self, now: float) -> str:
        """Return what the robot does: `idle`, `running`, `paused` or `away`."""
        if not self.is_live(now):
            return "away"
        return "paused" if self.paused else "running" if self.task_id else "idle"

    @property
    def process(self) -> str:
        """Where its server runs, for error texts: process, machine and address."""
        parts = [f"process {self.pid}"] if self.pid else []
        parts += [f"on {self.host}"] if self.host else []
        parts += [f"at {self.address}"] if self.address else []
        return " ".join(parts)

    def offer(self) -> str:
        """Return which tasks it executes, for refusals: `move or scan at attic, dock or x,y`."""
        types = " or ".join(", ".join(self.task_types).rsplit(", ", 1))
        targets = list(self.places)
        if self.size is not None:
            targets.append(f"x,y up to {self.size[0]:g},{self.size[1]:g}")
        text = f"{types} at {' or '.join(', '.join(targets).rsplit(', ', 1))}" if targets else types
        return f"{text}, limited to {self.capabilities}" if self.capabilities else text


class Capabilities:
    """What a robot may do: a comma-separated list of `TYPE` or `TYPE:TARGET`.

    `*` and `?` stand for any letters, as in the shell: `move,scan:area_*,*:dock`.

    Raises:
        ValueError: the text has an empty part.
    """

    def __init__(self, text: str) -> None:
        self._rules: list[tuple[str, str]] = []
        for part in text.split(",") if text.strip() else []:
            task_type, colon, target = (word.strip() for word in part.partition(":"))
            if not task_type or (colon and not target):
                raise ValueError(
                    "expected a list such as move,scan:area_*,*:dock;"
                    f" got {text!r} with the part {part!r}"
                )
            self._rules.append((task_type, target or "*"))

    def allow(self, task_type: str, target: str) -> bool:
        """Return whether the robot may execute this type of task at this target."""
        if not self._rules:
            return True
        return any(
            fnmatchcase(task_type, types) and fnmatchcase(target.strip(), targets)
            for types, targets in self._rules
        )

    def name(self, task_type: str, target: str) -> bool:
        """Return whether a part with a target of its own allows this task."""
        return any(
            targets != "*"
            and fnmatchcase(task_type, types)
            and fnmatchcase(target.strip(), targets)
            for types, targets in self._rules
        )

    def unused(self, task_types: Iterable[str], places: Collection[str]) -> list[str]:
        """Return the parts that allow a robot nothing, probably because of a misspelling.

        `places` are the named places that the robot reaches; empty if it does not tell.
        """
        known = tuple(task_types)
        unused = []
        for types, target in self._rules:
            does = any(fnmatchcase(each, types) for each in known)
            is_place = not places or target in places or any(mark in target for mark in "*?[")
            if not (does and is_place):
                unused.append(types if target == "*" else f"{types}:{target}")
        return unused


class Abilities:
    """Which robots can execute which tasks; remembers what it has computed."""

    def __init__(self, robots: Iterable[RobotRecord]) -> None:
        self._capabilities = {robot.name: Capabilities(robot.capabilities) for robot in robots}
        self._robots = {robot.name: robot for robot in robots}
        self._places = frozenset(place for robot in robots for place in robot.places)
        self._known: dict[tuple[str, str], frozenset[str]] = {}

    def certain(self, task_type: str, target: str) -> frozenset[str]:
        """Return the names of the robots whose records say that they can execute a task.

        A robot that tells nothing about its targets may be able to execute others too: only its own
        server knows.
        """
        able = self.of(task_type, target)
        return frozenset(name for name in able if self._says(name, task_type, target.strip()))

    def _says(self, name: str, task_type: str, target: str) -> bool:
        robot = self._robots[name]
        if target in robot.places or self._capabilities[name].name(task_type, target):
            return True
        return robot.size is not None and coordinates(target) is not None

    def of(self, task_type: str, target: str) -> frozenset[str]:
        """Return the names of the robots that can execute a task."""
        key = task_type, target
        known = self._known.get(key)
        if known is None:
            if len(self._known) >= _REMEMBERED:  # clients may name any number of targets
                self._known.clear()
            able = (name for name in self._robots if self._can(name, task_type, target.strip()))
            known = self._known[key] = frozenset(able)
        return known

    def _can(self, name: str, task_type: str, target: str) -> bool:
        robot = self._robots[name]
        if task_type not in robot.task_types:
            return False
        return _may_reach(robot, target, self._places) and self._capabilities[name].allow(
            task_type, target
        )


def _may_reach(robot: RobotRecord, target: str, known: Collection[str]) -> bool:
    """Return whether a robot's record allows a target; `known` are the places of all robots."""
    if target in robot.places:
        return True
    if robot.size is not None and (point := coordinates(target)) is not None:
        return all(0.0 <= value <= most for value, most in zip(point, robot.size, strict=True))
    if robot.tells_all:
        return False
    # A place that only other robots know is out of reach; the robot itself judges other targets.
    return not robot.places or target not in known


_REMEMBERED = 4096
