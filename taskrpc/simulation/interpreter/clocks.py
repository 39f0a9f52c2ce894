"""The clocks and the random bytes of programs: those of the simulation instead of the machine's."""

from __future__ import annotations

import datetime as datetimes
import importlib
import os
import random
import select
import time
from collections.abc import Callable
from typing import Any, Final, Protocol

from taskrpc.simulation.interpreter.loop import FIRST_DAY
from taskrpc.simulation.interpreter.stacks import Stacks

POLLS: Final = 1000
"""How often a stack may read the clock in one step; after that, each reading lets others run."""

READS_A_CLOCK: Final = "_read"
"""The name of the function in which such a stack lets others run."""

_NEED_REAL_DATES: Final = ("taskrpc.core.security.account_file",)
"""Modules with a `msgspec.Struct` that has a field for a `datetime`, for which msgspec accepts only
the real class."""


class Source(Protocol):
    """Where the random bytes and the clock of the running program come from."""

    def randbytes(self, n: int, /) -> bytes:
        """Return random bytes for the running program."""

    def ahead(self) -> float:
        """Return how far the wall clock of the running program is ahead, in seconds."""


class Clocks:
    """Replaces the functions of `time`, `datetime` and `os`; call `install` once.

    Outside of the stacks, they are those of the machine.
    """

    def __init__(self, stacks: Stacks, source: Callable[[], Source]) -> None:
        self._stacks = stacks
        self._source = source
        self._step = -1
        self._polls = 0

    def install(self) -> None:
        """Replace the functions in this interpreter."""
        self._install_clocks()
        self._install_dates()
        self._install_chance()

    def _install_clocks(self) -> None:
        stacks = self._stacks
        for name, wall in ("time", True), ("monotonic", False), ("perf_counter", False):
            real, real_ns = getattr(time, name), getattr(time, f"{name}_ns")

            def seconds(real: Callable[[], float] = real, wall: bool = wall) -> float:
                return real() if stacks.current is None else self._read(wall)

            def nanoseconds(real: Callable[[], int] = real_ns, wall: bool = wall) -> int:
                return real() if stacks.current is None else round(self._read(wall) * 1e9)

            setattr(time, name, seconds)
            setattr(time, f"{name}_ns", nanoseconds)
            for module in _BOUND.get(name, ()):
                setattr(*module, seconds)
        for name in "process_time", "thread_time":
            setattr(time, name, time.monotonic)
            setattr(time, f"{name}_ns", time.monotonic_ns)
        for name in "localtime", "gmtime", "ctime":
            real_function = getattr(time, name)

            def at(moment: float | None = None, real: Callable[..., Any] = real_function) -> Any:
                return real(time.time() if moment is None else moment)

            setattr(time, name, at)
        real_select = select.select

        def wait_for_files(read: Any, write: Any, other: Any, timeout: float | None = None) -> Any:
            if stacks.current is None:
                return real_select(read, write, other, timeout)
            stacks.wait(lambda _: None, timeout)  # nobody types, and there are no sockets
            return [], [], []

        vars(select)["select"] = wait_for_files
        strftime = time.strftime
        time.strftime = lambda text, *when: strftime(text, *(when or (time.localtime(),)))

    def _read(self, wall: bool) -> float:
        """Read a clock on a stack."""
        stacks = self._stacks
        if stacks.steps != self._step:
            self._step, self._polls = stacks.steps, 0
        self._polls += 1
        if self._polls > POLLS:  # a loop that waits for a time
            stacks.sleep(0)
            self._step = stacks.steps  # so the next reading sleeps, too
        if wall:
            return FIRST_DAY + stacks.now + self._source().ahead()
        return 1000.0 + stacks.now

    def _install_dates(self) -> None:
        for name in _NEED_REAL_DATES:
            importlib.import_module(name)
        real: Any = datetimes.datetime

        class Meta(type):
            def __instancecheck__(cls, instance: object) -> bool:
                return isinstance(instance, real)

        class SimulatedDateTime(real, metaclass=Meta):  # type: ignore[misc]
            @classmethod
            def now(cls, tz: datetimes.tzinfo | None = None) -> Any:
                return cls.fromtimestamp(time.time(), tz)

            @classmethod
            def utcnow(cls) -> Any:
                return cls.fromtimestamp(time.time(), datetimes.UTC).replace(tzinfo=None)

            @classmethod
            def today(cls) -> Any:
                return cls.fromtimestamp(time.time())

        SimulatedDateTime.__name__ = SimulatedDateTime.__qualname__ = "datetime"
        SimulatedDateTime.__module__ = "datetime"
        datetimes.datetime = SimulatedDateTime  # type: ignore[misc]

    def _install_chance(self) -> None:
        real = os.urandom

        def urandom(size: int, /) -> bytes:
            return real(size) if self._stacks.current is None else self._source().randbytes(size)

        os.urandom = urandom
        random._urandom = urandom  # type: ignore[attr-defined]


def _bound() -> dict[str, list[tuple[Any, str]]]:
    """Modules of the standard library that have imported a clock by its name."""
    import queue
    import threading

    return {"monotonic": [(queue, "time"), (threading, "_time")]}


_BOUND = _bound()
