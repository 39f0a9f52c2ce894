"""The event loop of a simulated program: it waits as a stack does, and has no sockets."""

from __future__ import annotations

import asyncio
import contextvars
import math
import random
from collections.abc import Callable, Coroutine, Generator
from typing import Any, TypeVar, TypeVarTuple, Unpack

from taskrpc.simulation.interpreter.stacks import Stack, Stacks
from taskrpc.simulation.interpreter.threads import Waiter

_Arguments = TypeVarTuple("_Arguments")
_Result = TypeVar("_Result")

FIRST_DAY = 1_767_225_600.0
"""The time of day when a run begins: 2026-01-01 00:00 UTC, in seconds since 1970."""


class SimulatedLoop(asyncio.BaseEventLoop):
    """An event loop on one stack of a simulation.

    Args:
        stacks: the stacks of the simulation.
        chance: everything random in taskrpc comes from it.
        hubs: the memory network that the programs share, by domain.
    """

    def __init__(self, stacks: Stacks, chance: random.Random, hubs: dict[int, Any]) -> None:
        self._stacks = stacks
        super().__init__()
        self.chance = chance
        self.hubs = hubs
        self._clock_resolution = math.ulp(1e6)
        self._selector = _Selector(self)
        self._stack: Stack | None = None
        """The stack that runs the loop."""
        self._waiter: Waiter | None = None
        """The wait of the stack for something to do."""
        self._is_woken = False
        self._tasks = 0
        self._signals: set[int] = set()

    def create_task(
        self,
        coro: Generator[object, None, _Result] | Coroutine[object, object, _Result],
        *,
        name: object = None,
        context: contextvars.Context | None = None,
    ) -> asyncio.Task[_Result]:
        """Start a task; its default name counts the tasks of this loop."""
        self._tasks += 1
        return super().create_task(coro, name=name or f"Task-{self._tasks}", context=context)

    def time(self) -> float:
        """The virtual time in seconds."""
        return self._stacks.now

    def call_soon(
        self,
        callback: Callable[[Unpack[_Arguments]], object],
        *args: *_Arguments,
        context: contextvars.Context | None = None,
    ) -> asyncio.Handle:
        """Call a function in the next turn; other programs may use it, too."""
        if self.is_closed() and self._is_left():
            return asyncio.Handle(callback, args, self, context)
        handle = super().call_soon(callback, *args, context=context)
        if self._stacks.current is not self._stack:
            self._write_to_self()
        return handle

    def call_at(
        self,
        when: float,
        callback: Callable[[Unpack[_Arguments]], object],
        *args: *_Arguments,
        context: contextvars.Context | None = None,
    ) -> asyncio.TimerHandle:
        """Call a function at a time; other programs may use it, too."""
        if self.is_closed() and self._is_left():
            return asyncio.TimerHandle(when, callback, args, self, context)
        timer = super().call_at(when, callback, *args, context=context)
        if self._stacks.current is not self._stack:
            self._write_to_self()
        return timer

    def _is_left(self) -> bool:
        """Whether another program calls: what it sends to one that has closed its loop is lost."""
        caller, owner = self._stacks.current, self._stack
        return owner is not None and (caller is None or caller.program != owner.program)

    def call_exception_handler(self, context: dict[str, object]) -> None:
        """Report an exception that nobody handles, while a program runs."""
        if self._stacks.current is not None and not self._stacks.current.is_dead:
            super().call_exception_handler(context)

    def add_signal_handler(
        self, sig: int, callback: Callable[[Unpack[_Arguments]], object], *args: *_Arguments
    ) -> None:
        """Do nothing but remember it: no signal ever arrives."""
        self._signals.add(sig)

    def remove_signal_handler(self, sig: int) -> bool:
        """Return whether there was one."""
        found = sig in self._signals
        self._signals.discard(sig)
        return found

    def run_forever(self) -> None:
        """Run until `stop`."""
        self._stack = self._stacks.current
        super().run_forever()

    def wait(self, timeout: float | None) -> None:
        """Let other stacks run until there is something to do."""
        if self._is_woken:
            timeout = 0.0
        self._is_woken = False
        self._stacks.wait(self._begin_wait, timeout)
        self._waiter = None

    def _begin_wait(self, waiter: Waiter) -> None:
        self._waiter = waiter

    def _write_to_self(self) -> None:
        self._is_woken = True
        if self._waiter is not None:
            self._waiter.wake(granted=True)

    def _process_events(self, event_list: list[Any]) -> None:
        """Do nothing: there are no sockets."""


class _Selector:
    """Takes the place of a selector of sockets."""

    def __init__(self, loop: SimulatedLoop) -> None:
        self._loop = loop

    def select(self, timeout: float | None) -> list[Any]:
        self._loop.wait(timeout)
        return []


class Policy(asyncio.AbstractEventLoopPolicy):
    """Makes the loops of simulated programs; each stack has its own present loop."""

    def __init__(self, stacks: Stacks, new_loop: Callable[[], SimulatedLoop]) -> None:
        self._stacks = stacks
        self._new_loop = new_loop

    def get_event_loop(self) -> asyncio.AbstractEventLoop:
        """Return the loop that this stack has set. Raises RuntimeError."""
        found = getattr(self._stacks.current, "own_loop", None)
        if found is None:
            raise RuntimeError("There is no current event loop in this thread.")
        loop: asyncio.AbstractEventLoop = found
        return loop

    def set_event_loop(self, loop: asyncio.AbstractEventLoop | None) -> None:
        """Set the loop of this stack."""
        if self._stacks.current is not None:
            self._stacks.current.own_loop = loop

    def new_event_loop(self) -> asyncio.AbstractEventLoop:
        """Return a new loop."""
        return self._new_loop()
