"""Stacks on greenlets, and their clock: one runs until it waits, and the clock jumps.

Nothing here knows what the stacks do. Which of the ready ones runs next is decided by a function,
so that the same decisions give the same run.
"""

from __future__ import annotations

import asyncio
import heapq
import math
import sys
from collections.abc import Callable
from contextvars import copy_context
from enum import Enum
from typing import Any, Final

from greenlet import GreenletExit, getcurrent, greenlet

from taskrpc.simulation.interpreter.threads import Handle, Waiter
from taskrpc.spi import current_program

STEP: Final = 1e-6
"""Seconds of virtual time that a stack runs until it waits."""

_RESTLESS = 10_000
"""Steps without a moment in which all stacks wait; after them, a program polls something."""

_POLL = 0.001
"""Seconds of virtual time for a step from then on, so that what it polls can happen."""

_FIRST_IDENT = 1000

_MOST_CATCHES = 50
"""How often a killed stack may catch the exception and wait again."""

_immortal: list[Stack] = []
"""Stacks that catch every exception in an endless loop; freeing them would run them for ever."""

Killed = GreenletExit
"""What ends the Python code of a killed stack."""


class Stack:
    """One thread of one program."""

    def __init__(self, ident: int, program: str, handle: Handle) -> None:
        self.ident = ident
        self.program = program
        """The value of `current_program`."""
        self.handle = handle
        self.waiter: StackWaiter | None = None
        """The wait that it is in; None while it is ready or runs."""
        self.is_dead = False
        self.polls_since: float | None = None
        """Since when it has only let others run, and has not waited."""
        self.greenlet: greenlet
        self.running_loop: asyncio.AbstractEventLoop | None = None
        self.own_loop: asyncio.AbstractEventLoop | None = None
        """What `asyncio.set_event_loop` has set."""
        self.hooks: tuple[Any, Any] = (None, None)
        """Those of its loop for asynchronous generators, while another stack runs."""


class StackWaiter:
    """One wait of a stack."""

    __slots__ = ("_is_over", "_stacks", "has_timeout", "is_granted", "reason", "stack")

    def __init__(self, stacks: Stacks, stack: Stack) -> None:
        self._stacks = stacks
        self.stack = stack
        self._is_over = False
        self.is_granted = False
        self.has_timeout = False
        self.reason: object = None

    @property
    def is_over(self) -> bool:
        """Whether the wait has ended."""
        return self._is_over

    def wake(self, *, granted: bool) -> bool:
        """End the wait; returns False if it has ended already."""
        if self._is_over:
            return False
        self._is_over, self.is_granted = True, granted
        if not self.stack.is_dead:
            self._stacks.make_ready(self.stack)
        return True


class Stop(Enum):
    """Why `Stacks.run` has returned."""

    TIME = "the time is over"
    IDLE = "nothing will ever happen"
    ASKED = "the watcher asked for it"


Choose = Callable[[list[Stack]], int]
"""Returns which of two or more ready stacks runs next; the list is in order of becoming ready."""


def _never() -> bool:
    return False


class Stacks:
    """All stacks of a simulation, and their clock; the `Scheduler` of their threads."""

    def __init__(self) -> None:
        self.now = 0.0
        """Virtual seconds since the begin of the run."""
        self.current: Stack | None = None
        """The running stack; None outside of the stacks."""
        self.all: dict[int, Stack] = {}
        self.steps = 0
        """How often a stack has run until it waited."""
        self.slowness: dict[str, float] = {}
        """Seconds of virtual time for a step of some programs, instead of `STEP`."""
        self.enter: Callable[[Stack], object] = _ignore_stack
        """Is called before a stack runs."""
        self._hub = getcurrent()
        self._ready: list[Stack] = []
        self._timers: list[tuple[float, int, StackWaiter]] = []
        self._numbers = 0
        self._last_ident = _FIRST_IDENT
        self._last: Stack | None = None
        """The stack that ran last; Python has its hooks."""
        self._restless = 0
        """The number of the step from which on a step takes `_POLL`."""
        self._until = 0.0
        self._is_quiet: Callable[[], bool] = _never

    def reset(self) -> None:
        """Begin a new run: end all stacks, and set the clock to zero.

        Python code of the stacks still runs here: `finally`, `except` and the ends of `with`. Each
        wait in it ends with `GreenletExit`.
        """
        while self.all:  # what they run may start more
            for stack in list(self.all.values()):
                self.kill(stack)
                for _ in range(_MOST_CATCHES):
                    if stack.greenlet.dead:
                        break
                    self._switch(stack, GreenletExit)
                else:
                    _immortal.append(stack)
                self.all.pop(stack.ident, None)
        if self._last is not None:
            sys.set_asyncgen_hooks(None, None)
        self.__init__()  # type: ignore[misc]

    # The scheduler of the threads

    def get_ident(self) -> int:
        """Return the number of the running stack, 1 outside of the stacks."""
        return 1 if self.current is None else self.current.ident

    def present_handle(self) -> Handle | None:
        """Return the handle of the running stack."""
        return None if self.current is None else self.current.handle

    def start(self, run: Callable[[], object], handle: Handle) -> None:
        """Start a stack, in a copy of the caller's context."""
        self._last_ident += 1
        handle.ident = self._last_ident
        stack = Stack(handle.ident, current_program.get(), handle)

        def live() -> None:
            try:
                if not stack.is_dead:
                    run()
            except GreenletExit:
                pass
            finally:
                self.all.pop(stack.ident, None)
                handle.end()

        stack.greenlet = greenlet(live, self._hub)
        stack.greenlet.gr_context = copy_context()
        self.all[stack.ident] = stack
        self._ready.append(stack)

    def wait(self, begin: Callable[[Waiter], object], timeout: float | None) -> bool:
        """Let others run until the waiter that `begin` gets is woken, or for `timeout` seconds."""
        me = self.current
        if me is None:
            raise RuntimeError("the code around the programs wants to wait")
        if me.is_dead:
            self._hub.switch()  # back to `reset`: a program may catch the exception in a loop
            raise GreenletExit
        if timeout != 0:
            me.polls_since = None
        elif me.polls_since is None:
            me.polls_since = self.now
        if timeout == 0 and self._goes_on(me):
            return False
        waiter = StackWaiter(self, me)
        begin(waiter)
        if timeout == 0:
            waiter.wake(granted=False)
        elif timeout is not None:
            waiter.has_timeout = True
            self._numbers += 1
            heapq.heappush(self._timers, (self.now + timeout, self._numbers, waiter))
        me.waiter = waiter
        self._hub.switch()
        me.waiter = None
        if me.is_dead:
            raise GreenletExit
        return waiter.is_granted

    def _goes_on(self, me: Stack) -> bool:
        """Take a step at once if `run` would choose the running stack, since no other is ready."""
        if self._ready or not self._is_quiet():
            return False
        after = self._after_step(me)
        if after > self._until or (self._timers and self._timers[0][0] <= after):
            return False
        self.steps += 1
        self.now = after
        return True

    def _after_step(self, stack: Stack) -> float:
        """Return the time after the present step of a stack."""
        is_restless = self.steps + 1 >= self._restless
        step = _POLL if is_restless else self.slowness.get(stack.program, STEP)
        after = self.now + step
        # The clock must move even where adding a step does not change it.
        return after if after > self.now else math.nextafter(self.now, math.inf)

    def sleep(self, seconds: float) -> None:
        """Let others run for some time; takes the place of `time.sleep`."""
        if seconds < 0:
            raise ValueError("sleep length must be non-negative")
        self.wait(_ignore, seconds)

    def let_others_run(self) -> None:
        """Do nothing: a stack runs until it waits."""

    # The run

    def make_ready(self, stack: Stack) -> None:
        """Let a stack that waits run again."""
        self._ready.append(stack)

    def kill(self, stack: Stack) -> None:
        """Let a stack never run again."""
        stack.is_dead = True
        if stack in self._ready:
            self._ready.remove(stack)
        if stack.waiter is not None:
            stack.waiter.wake(granted=False)  # its timer must not move the clock

    def of(self, program: str) -> list[Stack]:
        """Return the living stacks of a program, the oldest first."""
        return [each for each in self.all.values() if each.program == program and not each.is_dead]

    def run(
        self,
        until: float,
        choose: Choose,
        watch: Callable[[], bool],
        is_quiet: Callable[[], bool] = _never,
    ) -> Stop:
        """Run the stacks until a time, or until nothing can happen any more.

        `watch` is called after each step; it returns True to stop. Where `is_quiet` returns True,
        `watch` would do nothing, and a step may be taken without it.
        """
        ready, timers = self._ready, self._timers
        self._until, self._is_quiet, self._restless = until, is_quiet, self.steps + _RESTLESS
        while True:
            while timers and (timers[0][0] <= self.now or timers[0][2].is_over):
                heapq.heappop(timers)[2].wake(granted=False)
            if not ready:
                if not timers:
                    return Stop.IDLE
                if timers[0][0] > until:
                    self.now = until
                    return Stop.TIME
                self.now = timers[0][0]
                self._restless = self.steps + _RESTLESS
                continue
            stack = ready.pop(choose(ready) if len(ready) > 1 else 0)
            self._switch(stack)
            self.now = self._after_step(stack)
            self.steps += 1
            if watch():
                return Stop.ASKED
            if self.now > until:
                return Stop.TIME

    def _switch(self, stack: Stack, *error: type[BaseException]) -> None:
        self.current = stack
        self.enter(stack)
        if stack is not self._last:
            self._exchange_hooks(stack)
        asyncio._set_running_loop(stack.running_loop)
        try:
            if error:
                stack.greenlet.throw(*error)
            else:
                stack.greenlet.switch()
        finally:
            stack.running_loop = asyncio._get_running_loop()
            asyncio._set_running_loop(None)
            self.current = None

    def _exchange_hooks(self, stack: Stack) -> None:
        hooks = sys.get_asyncgen_hooks()
        if self._last is not None:
            self._last.hooks = hooks
        if hooks != stack.hooks:
            sys.set_asyncgen_hooks(*stack.hooks)
        self._last = stack


def _ignore(_: Waiter) -> None:
    """Begin a wait that only its timeout ends."""


def _ignore_stack(_: Stack) -> None:
    """Do nothing before a stack runs."""
