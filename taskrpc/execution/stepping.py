"""Runs coroutines, and makes a task of one only if it suspends.

A task costs more than all the rest of a call, and most callbacks never wait for anything. But
`asyncio.timeout`, task groups and others ask for the current task before anything has suspended.
So a spare task stands by: it is the current one while a coroutine takes its first step, and where
that was not the last, it is the one that carries the coroutine on.
"""

from __future__ import annotations

import asyncio
import types
from asyncio import _enter_task, _leave_task  # for those who run steps themselves, says asyncio
from collections.abc import Callable, Coroutine, Generator
from contextvars import Context, copy_context
from typing import Any

from taskrpc.callinfo import answering


class Stepper:
    """Takes the first step of coroutines on one event loop.

    `held` is told how many seconds each later step kept the loop.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, held: Callable[[float], None]) -> None:
        self._loop = loop
        self._held = held
        self._spare: _Spare | None = None

    def step(self, prepare: Callable[[], object], coroutine: Coroutine[Any, Any, Any]) -> Any:
        """Run a coroutine up to its first suspension; returns the task that carries it on.

        `prepare` is called before, in the context of the coroutine. Raises StopIteration with the
        value of a coroutine that returned, or what it raised.
        """
        spare = self._spare
        # Cancelled by a program that cancels all tasks, or by a coroutine that was stepped before.
        # The number of cancels does not tell: `uncancel` lowers it, but takes nothing back from a
        # task that waits, and before Python 3.13 nothing from one that has not begun either.
        if (
            spare is None
            or spare.task._must_cancel  # type: ignore[attr-defined]  # typeshed lacks it
            or spare.given.done()
        ):
            spare = self._spare = _Spare(self._loop, self._held)
        try:
            _enter_task(self._loop, spare.task)
        except RuntimeError:  # somebody's task is running, and calls us
            return self._in_task(prepare, coroutine)
        try:
            waits_for = spare.context.run(_first_step, prepare, coroutine)
        except BaseException:
            if len(spare.context) != spare.variables or (spare.inherited and spare.is_used()):
                self.close()  # what one coroutine sets must not be seen by the next
            raise
        finally:
            _leave_task(self._loop, spare.task)
        self._spare = None
        spare.carry_on(coroutine, waits_for)
        return spare.task

    def close(self) -> None:
        """Let the spare task end."""
        if self._spare is not None:
            self._spare.task.cancel()
            self._spare = None

    def _in_task(
        self, prepare: Callable[[], object], coroutine: Coroutine[Any, Any, Any]
    ) -> asyncio.Task[Any]:
        context = copy_context()
        context.run(prepare)
        return self._loop.create_task(coroutine, context=context)


def _first_step(prepare: Callable[[], object], coroutine: Coroutine[Any, Any, Any]) -> Any:
    prepare()
    return coroutine.send(None)


@types.coroutine
def _begun() -> Generator[None, None, None]:
    yield


class _Spare:
    """A task that waits until it is given a coroutine which has taken its first step."""

    def __init__(self, loop: asyncio.AbstractEventLoop, held: Callable[[float], None]) -> None:
        self.context: Context = copy_context()
        self._loop = loop
        self._held = held
        self.given: asyncio.Future[None] = loop.create_future()
        self._rest: _Rest | None = None
        main = self._main()
        main.send(None)
        self.task: asyncio.Task[Any] = loop.create_task(main, context=self.context)
        self.variables = len(self.context)
        self.inherited = [each for each in self.context.items() if each[0] is not answering]

    def is_used(self) -> bool:
        """Whether a variable that was there before now has another value."""
        return any(self.context[variable] is not value for variable, value in self.inherited)

    def carry_on(self, coroutine: Coroutine[Any, Any, Any], waits_for: Any) -> None:
        """Run the coroutine to its end; `waits_for` is what its first step yielded."""
        self._rest = _Rest(coroutine, waits_for, self._loop.time, self._held)
        if not self.given.done():
            self.given.set_result(None)

    async def _main(self) -> Any:
        try:
            # Passed before the task is made: a cancel that comes before the task's own first
            # step would else be thrown in above, where nothing hands it to the coroutine.
            await _begun()
            await self.given
        except asyncio.CancelledError:
            if self._rest is None:
                self.given.cancel()  # says that this task has ended
                raise
            self._rest.cancel()
        assert self._rest is not None
        return await self._rest


class _Rest:
    """What is left of a coroutine after its first step, as something that a task can await."""

    def __init__(
        self,
        coroutine: Coroutine[Any, Any, Any],
        waits_for: Any,
        now: Callable[[], float],
        held: Callable[[float], None],
    ) -> None:
        self._coroutine = coroutine
        self._waits_for = waits_for
        # An awaited future carries this word to the task that takes it from here. The task comes
        # later; until then others may await the same future.
        self._awaits: bool = getattr(waits_for, "_asyncio_future_blocking", False)
        if self._awaits:
            waits_for._asyncio_future_blocking = False
        self._now = now
        self._held = held
        self._cancelled = False

    def cancel(self) -> None:
        """Cancel before the task has taken over, as the task itself would do it."""
        if self._waits_for is None or not self._waits_for.cancel():
            self._cancelled = True

    def __await__(self) -> Generator[Any, Any, Any]:
        error: BaseException | None = asyncio.CancelledError() if self._cancelled else None
        waits_for = self._waits_for
        if self._awaits:
            waits_for._asyncio_future_blocking = True
        value = None
        while True:
            if error is None:
                try:
                    value = yield waits_for
                except GeneratorExit:
                    self._coroutine.close()
                    raise
                except BaseException as caught:
                    error = caught
            began = self._now()
            try:
                if error is None:
                    waits_for = self._coroutine.send(value)
                else:
                    thrown, error = error, None
                    waits_for = self._coroutine.throw(thrown)
            except StopIteration as done:
                return done.value
            finally:
                self._held(self._now() - began)
