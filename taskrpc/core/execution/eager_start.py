"""Starts coroutines eagerly: a coroutine becomes a task only if it suspends.

A task costs more than all the rest of a call, and most callbacks never wait for anything. But
`asyncio.timeout`, task groups and others need the current task before anything has suspended. So a
spare task is kept ready: it is the current task during a coroutine's first step, and if the
coroutine suspends, the spare task runs the rest of it. Python 3.12 has eager tasks of its own,
which make one task for each coroutine; this also works in Python 3.11.
"""

from __future__ import annotations

import asyncio
import types
from asyncio import _enter_task, _leave_task  # documented for code that runs steps itself
from collections.abc import Callable, Coroutine, Generator
from contextvars import Context, copy_context
from typing import Any, TypeAlias, cast

from taskrpc.core.callinfo import CallInfo, UnmadeCall, answering
from taskrpc.core.transport.base import Begun, Ended

Answered: TypeAlias = CallInfo | UnmadeCall | None
"""The call that a coroutine answers, if any."""


class EagerStarter:
    """Runs the first steps of coroutines on one event loop.

    `held` is called with the seconds for which each later step held the loop.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, held: Callable[[float], None]) -> None:
        self._loop = loop
        self._held = held
        self._spare: _Spare | None = None

    def start(self, coroutine: Coroutine[object, None, object]) -> asyncio.Task[object]:
        """Run a coroutine up to its first suspension; return the task that runs the rest.

        Raises StopIteration with the return value if the coroutine returned, or the exception that
        it raised.
        """
        result, has_ended = self.begin(coroutine)
        if has_ended:
            raise StopIteration(result)
        return cast("Begun", result).task

    def begin(
        self, coroutine: Coroutine[object, None, object], call: Answered = None
    ) -> tuple[object, bool]:
        """Do as `start`, for the coroutine that answers a call.

        Return the return value and True, or what runs the rest (a `Begun`) and False.
        """
        spare = self._spare
        # Is the spare task cancelled: by a program that cancels all tasks, or by an earlier
        # coroutine? `cancelling()` does not say so: `uncancel` lowers the count, but does not undo
        # the cancel of a task that waits, nor before Python 3.13 of one that has not begun.
        if (
            spare is None
            or spare.task._must_cancel  # type: ignore[attr-defined]  # typeshed lacks it
            or spare.given.done()
        ):
            spare = self._spare = _Spare(self._loop, self._held)
        try:
            _enter_task(self._loop, spare.task)
        except RuntimeError:  # called from within a running task
            return _InTask(self._loop, coroutine, call), False
        has_ended = True
        try:
            result, has_ended = spare.context.run(_first_step, coroutine, call)
        finally:
            _leave_task(self._loop, spare.task)
            if has_ended and (
                len(spare.context) != spare.variables or (spare.inherited and spare.is_used())
            ):
                self.close()  # one coroutine's context variables must not be visible to the next
        if has_ended:
            return result, True
        self._spare = None
        spare.run_rest(coroutine, waits_for=result)
        return spare, False

    def close(self) -> None:
        """End the spare task."""
        if self._spare is not None:
            self._spare.task.cancel()
            self._spare = None


class _InTask:
    """A coroutine with a task of its own: it was started from within a running task."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        coroutine: Coroutine[Any, Any, Any],
        call: Answered,
    ) -> None:
        context = copy_context()
        context.run(answering.set, call)
        self.task: asyncio.Task[Any] = loop.create_task(coroutine, context=context)

    def then(self, ended: Ended) -> None:
        """Call `ended.done` at the end."""
        self.task.add_done_callback(ended.done)


def _first_step(coroutine: Coroutine[Any, Any, Any], call: Answered) -> tuple[Any, bool]:
    """Return the return value and True, or what the coroutine waits for and False."""
    answering.set(call)
    try:
        return coroutine.send(None), False
    except StopIteration as done:
        return done.value, True


@types.coroutine
def _begun() -> Generator[None, None, None]:
    yield


class _Spare:
    """A task that waits until it gets a coroutine whose first step has run."""

    def __init__(self, loop: asyncio.AbstractEventLoop, held: Callable[[float], None]) -> None:
        self.context: Context = copy_context()
        self.context.run(answering.set, None)
        self._loop = loop
        self._held = held
        self.given: asyncio.Future[None] = asyncio.Future(loop=loop)
        """Done when the coroutine is given; cancelled when this task has ended without one."""
        self._rest: _Rest | None = None
        self._ended: Ended | None = None
        main = self._main()
        main.send(None)
        self.task: asyncio.Task[Any] = loop.create_task(main, context=self.context)
        self.variables = len(self.context)
        """How many context variables there were at the start."""
        self.inherited = [each for each in self.context.items() if each[0] is not answering]

    def is_used(self) -> bool:
        """Whether the coroutine changed a context variable that existed before."""
        return any(self.context[variable] is not value for variable, value in self.inherited)

    def then(self, ended: Ended) -> None:
        """Call one of the methods of `ended` at the end of the coroutine."""
        self._ended = ended

    def run_rest(self, coroutine: Coroutine[Any, Any, Any], waits_for: Any) -> None:
        """Run the coroutine to its end; `waits_for` is the future that its first step yielded."""
        self._rest = _Rest(coroutine, waits_for, self._loop.time, self._held)
        if not self.given.done():
            self.given.set_result(None)

    async def _main(self) -> Any:
        try:
            # This first await runs before the task is made. A cancel before the task's own first
            # step is thrown in here, inside the `try`, which passes it on to the coroutine.
            await _begun()
            await self.given
        except asyncio.CancelledError:
            if self._rest is None:
                self.given.cancel()  # marks that this task has ended
                raise
            self._rest.cancel()
        assert self._rest is not None
        ended = self._ended
        if ended is None:
            return await self._rest
        try:
            value = await self._rest
        except BaseException:
            self.task.add_done_callback(ended.done)
            raise
        # Not a callback of the task: it would run one turn of the loop later.
        ended.returned(value)
        return value


class _Rest:
    """The rest of a coroutine after its first step, as an awaitable."""

    def __init__(
        self,
        coroutine: Coroutine[Any, Any, Any],
        waits_for: Any,
        now: Callable[[], float],
        held: Callable[[float], None],
    ) -> None:
        self._coroutine = coroutine
        self._waits_for = waits_for
        # asyncio sets this flag on a future that is being awaited, and the task that receives the
        # future clears it. Our task receives it later; until then others may await the future.
        self._awaits: bool = getattr(waits_for, "_asyncio_future_blocking", False)
        if self._awaits:
            waits_for._asyncio_future_blocking = False
        self._now = now
        self._held = held
        self._cancelled = False

    def cancel(self) -> None:
        """Cancel before the task has taken over, as the task itself would."""
        if self._waits_for is None or not self._waits_for.cancel():
            self._cancelled = True

    def __await__(self) -> Generator[Any, Any, Any]:
        error: BaseException | None = asyncio.CancelledError() if self._cancelled else None
        waits_for = self._waits_for
        if self._awaits:
            waits_for._asyncio_future_blocking = True
        value = None
        # A bare yield waits for one turn of the loop, which has passed since the first step.
        waits = waits_for is not None
        while True:
            if error is None and waits:
                try:
                    value = yield waits_for
                except GeneratorExit:
                    self._coroutine.close()
                    raise
                except BaseException as caught:
                    error = caught
            waits = True
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
