"""What a user simulates: programs, the faults that may happen, and what must always be true."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from taskrpc.simulation.run.world import SimulatedWorld

_Check = TypeVar("_Check", bound="Callable[[Any], object]")


class ProgramEntry(msgspec.Struct, frozen=True):
    """One program of a scenario."""

    name: str
    file: str
    """A path relative to the folder of the scenario's file."""
    arguments: tuple[str, ...] = ()


class Faults(msgspec.Struct, frozen=True):
    """The faults that may happen in a run."""

    lose_requests: float = 0.0
    """The share of the requests that never reach their service, 0 to 1."""
    lose_responses: float = 0.0
    """The share of the responses that never reach their caller, 0 to 1."""
    duplicate_requests: float = 0.0
    """The share of the requests that reach their service twice, 0 to 1."""
    reorder_requests: float = 0.0
    """The share of the requests that later ones overtake, 0 to 1."""
    busy: float = 0.0
    """The share of the requests that are refused because the queue is full, 0 to 1."""
    delay: tuple[float, float] = (0.0, 0.0)
    """The least and the most seconds that a request, a response or a message takes. While two
    programs connect, it is at most half a second."""
    cut: float = 0.0
    """The share of the connections that break at some time, 0 to 1. The programs connect again."""
    partition: tuple[float, float] | None = None
    """The least and the most seconds for which two programs cannot reach each other, at a moment
    of the run; None: never."""
    slow: tuple[str, ...] = ()
    """The programs that may be slow: each of their steps takes up to 20 ms."""
    wrong_clock: tuple[str, ...] = ()
    """The programs whose time of day may be wrong, jump, or stand still."""
    crash: tuple[str, ...] = ()
    """The programs that may be killed."""
    restart: tuple[float, float] | None = None
    """The least and the most seconds until a killed program starts again; None: never."""
    until: float = math.inf
    """The virtual seconds after which no fault happens any more, so that a check can say that
    everything works again. Wrong clocks stay wrong, and slow programs slow."""


class Scenario:
    """A robot system to simulate; a file `NAME.sim.py` defines one with the name `scenario`.

    Args:
        duration: virtual seconds after which a run ends, if its programs have not ended before.

    Raises TaskRpcError for a wrong value, here and in the methods.
    """

    def __init__(self, duration: float = 60.0) -> None:
        self.duration = _seconds("duration", duration, least=math.ulp(0.0))
        self.programs: list[ProgramEntry] = []
        self.fault_settings = Faults()
        self.always_checks: list[Callable[[SimulatedWorld], object]] = []
        self.final_checks: list[Callable[[SimulatedWorld], object]] = []

    def program(self, name: str, file: str | Path, *arguments: str) -> None:
        """Add a program: a Python file, which may import rclpy or taskrpc, and its arguments.

        A relative path begins in the folder of the scenario's file.
        """
        if not name or not name.isidentifier():
            raise TaskRpcError(f"program: expected a name such as robot, got {name!r}")
        if any(each.name == name for each in self.programs):
            raise TaskRpcError(f"program: there are two programs with the name {name!r}")
        words = tuple(str(each) for each in arguments)
        self.programs.append(ProgramEntry(name, str(file), words))

    def faults(
        self,
        *,
        lose_requests: float = 0.0,
        lose_responses: float = 0.0,
        duplicate_requests: float = 0.0,
        reorder_requests: float = 0.0,
        busy: float = 0.0,
        delay: tuple[float, float] = (0.0, 0.0),
        cut: float = 0.0,
        partition: tuple[float, float] | None = None,
        slow: Sequence[str] = (),
        wrong_clock: Sequence[str] = (),
        crash: Sequence[str] = (),
        restart: tuple[float, float] | None = None,
        until: float | None = None,
    ) -> None:
        """Say which faults may happen; see `Faults`. Add the programs before."""
        if restart is not None and not crash:
            raise TaskRpcError("restart: expected crash=(…) beside it: the programs to be killed")
        self.fault_settings = Faults(
            lose_requests=_share("lose_requests", lose_requests),
            lose_responses=_share("lose_responses", lose_responses),
            duplicate_requests=_share("duplicate_requests", duplicate_requests),
            reorder_requests=_share("reorder_requests", reorder_requests),
            busy=_share("busy", busy),
            delay=_range("delay", delay),
            cut=_share("cut", cut),
            partition=None if partition is None else _range("partition", partition),
            slow=self._names("slow", slow),
            wrong_clock=self._names("wrong_clock", wrong_clock),
            crash=self._names("crash", crash),
            restart=None if restart is None else _range("restart", restart),
            until=math.inf if until is None else _seconds("until", until),
        )

    def _names(self, what: str, names: Sequence[str]) -> tuple[str, ...]:
        known = [each.name for each in self.programs]
        is_one = isinstance(names, str) or not isinstance(names, Iterable)
        found: tuple[Any, ...] = (names,) if is_one else tuple(names)
        for name in found:
            if name not in known:
                words = ", ".join(known) or "no program yet"
                raise TaskRpcError(f"{what}: expected names of programs ({words}), got {name!r}")
        return found

    def always(self, check: _Check) -> _Check:
        """Decorate a function of the `SimulatedWorld` that must not raise after any step."""
        self.always_checks.append(check)
        return check

    def finally_(self, check: _Check) -> _Check:
        """Decorate a function of the `SimulatedWorld` that must not raise at the end of a run."""
        self.final_checks.append(check)
        return check


def _share(what: str, value: float) -> float:
    if not isinstance(value, int | float) or not 0 <= value <= 1:
        raise TaskRpcError(f"{what}: expected a share from 0 to 1, got {value!r}")
    return float(value)


def _seconds(what: str, value: float, least: float = 0.0) -> float:
    if not isinstance(value, int | float) or not math.isfinite(value) or value < least:
        raise TaskRpcError(f"{what}: expected seconds, got {value!r}")
    return float(value)


def _range(what: str, value: tuple[float, float]) -> tuple[float, float]:
    try:
        least, most = value
    except (TypeError, ValueError):
        raise TaskRpcError(
            f"{what}: expected the least and the most seconds, such as (0.0, 0.2), got {value!r}"
        ) from None
    least, most = _seconds(what, least), _seconds(what, most)
    if least > most:
        raise TaskRpcError(f"{what}: expected the least seconds first, got {value!r}")
    return least, most
