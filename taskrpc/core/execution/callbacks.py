"""Checks callbacks, and runs those of subscriptions and timers, one call at a time."""

from __future__ import annotations

import asyncio
import inspect
import logging
import operator
from collections.abc import Awaitable, Callable
from functools import partial
from types import FunctionType, MethodType
from typing import TYPE_CHECKING, Any, TypeAlias

from taskrpc.core.execution.eager_start import EagerStarter
from taskrpc.core.transport.base import end_program

if TYPE_CHECKING:
    from taskrpc.core.execution.daemon_threads import DaemonThreads

log = logging.getLogger("taskrpc.callbacks")

Callback: TypeAlias = Callable[..., Any]
"""Plain or async; its return value is ignored."""

HOLDS_LOOP_AFTER = 0.25
"""Seconds on the event loop after which a warning names the callback."""


class CallbackRunner:
    """Calls one callback, at most once at a time, and logs its exceptions.

    A plain callback runs on the event loop, or with `threaded` in a thread of its own. `idle` is
    called at the end of each call that outlasts `run`. `description` names the callback in logs
    and errors.

    Raises TypeError for a callback that does not take one argument for each name in `parameters`.
    """

    def __init__(
        self,
        callback: Callback,
        description: str,
        *parameters: str,
        threaded: bool,
        idle: Callable[[], object],
    ) -> None:
        check_callback(callback, description, parameters)
        self.busy = False
        """Whether a call runs."""
        self.spent = 0.0
        """Seconds for which plain calls have held the loop since this was last set to 0."""
        self._callback = callback
        self._description = description
        self._idle = idle
        self._loop = asyncio.get_running_loop()
        self._starter = EagerStarter(self._loop, self._held)
        self._threads = threads_for(1, description, threaded=threaded)
        self._job: asyncio.Future[Any] | None = None
        """The call that runs, if it outlasts `run`."""
        self._warned = False
        """Whether the log has the warning about a slow callback."""

    def run(self, *arguments: Any) -> None:
        """Call the callback; only allowed while `busy` is False."""
        self.busy = True
        if self._threads is not None:
            callback = self._callback
            job = self._loop.run_in_executor(
                self._threads, lambda: run_to_end(callback, *arguments)
            )
            self._await(job)
            return
        began = self._loop.time()
        try:
            result = self._callback(*arguments)
            if hasattr(result, "__await__"):
                coroutine = result if inspect.iscoroutine(result) else as_coroutine(result)
                self._await(self._starter.start(coroutine))
                return
        except StopIteration:
            pass
        except BaseException as error:
            self._raised(error)
        seconds = self._loop.time() - began
        self.spent += seconds
        self._held(seconds)
        self.busy = False

    def close(self) -> None:
        """Cancel the running call, unless that call itself calls `close`; allow no further call."""
        if self._job is not None and self._job is not asyncio.current_task():
            self._job.cancel()
        self._starter.close()
        if self._threads is not None:
            self._threads.shutdown()

    def _await(self, job: asyncio.Future[Any]) -> None:
        self._job = job
        job.add_done_callback(self._ended)

    def _ended(self, job: asyncio.Future[Any]) -> None:
        self._job = None
        self.busy = False
        if not job.cancelled() and (error := job.exception()) is not None:
            self._raised(error)
        self._idle()

    def _raised(self, error: BaseException) -> None:
        if isinstance(error, SystemExit | KeyboardInterrupt):
            # In a separate iteration of the loop: uvloop ignores exceptions in a protocol.
            self._loop.call_soon(end_program, error)
        else:
            log.error("%s failed:", self._description, exc_info=error)

    def _held(self, seconds: float) -> None:
        if seconds > HOLDS_LOOP_AFTER and not self._warned:
            self._warned = True
            log.warning(
                "%s held the event loop for %.2f s, so that nothing else ran; let it await"
                " instead of blocking, or use taskrpc.sync",
                self._description,
                seconds,
            )


def threads_for(count: int, description: str, *, threaded: bool) -> DaemonThreads | None:
    """Return the threads for a callback if it is `threaded`, otherwise None."""
    if not threaded:
        return None
    from taskrpc.core.execution.daemon_threads import DaemonThreads  # few programs need it

    return DaemonThreads(count, f"taskrpc {description}")


async def as_coroutine(awaitable: Awaitable[Any]) -> Any:
    """Return a coroutine that awaits any awaitable."""
    return await awaitable


def run_to_end(callback: Callback, *arguments: Any) -> Any:
    """Call a callback in a thread; one that is async runs in an event loop of its own."""
    try:
        result = callback(*arguments)
        return asyncio.run(result) if inspect.iscoroutine(result) else result
    except StopIteration as error:
        # A future cannot hold StopIteration; generators turn it into the same error.
        raise RuntimeError("the callback raised StopIteration") from error


def check_count(setting: str, value: object) -> None:
    """Raise ValueError for a setting that is not a whole number from 1 on."""
    try:
        is_valid = operator.index(value) >= 1  # type: ignore[arg-type]
    except TypeError:
        is_valid = False
    if not is_valid:
        raise ValueError(f"{setting}: expected a whole number from 1 on, such as 10, got {value!r}")


def check_callback(callback: Callback, description: str, parameters: tuple[str, ...]) -> None:
    """Raise TypeError for a callback that does not take one argument for each parameter's name."""
    if problem := problem_of_callback(callback, description, parameters):
        raise TypeError(problem)


def problem_of_callback(callback: Any, description: str, parameters: tuple[str, ...]) -> str:
    """Return why a callback cannot be called with an argument for each name, "" if it can."""
    if _is_plain(callback, len(parameters)):
        return ""
    taken = ", ".join(parameters) or "nothing"
    expected = f"{description}: expected a function that takes {taken}, got"
    if not callable(callback):
        return f"{expected} {callback!r}"
    if hasattr(callback, "__signature__"):  # what a decorator publishes, not what it takes
        return ""
    try:
        # A decorator may add arguments, so that the decorated function takes others.
        signature = inspect.signature(callback, follow_wrapped=False)
    except (TypeError, ValueError):  # some built-in functions have no signature
        return ""
    try:
        signature.bind(*parameters)
    except TypeError as error:
        name = getattr(callback, "__qualname__", repr(callback))
        return f"{expected} {name}{signature}{_location_of(callback)}: {error}"
    return ""


def _is_plain(callback: Any, count: int) -> bool:
    """Whether a callback is a function or method with so many parameters; `signature` is slow."""
    if type(callback) is MethodType:
        callback, count = callback.__func__, count + 1
    if type(callback) is not FunctionType:
        return False
    return bool(callback.__code__.co_argcount == count and not callback.__code__.co_kwonlyargcount)


def _location_of(callback: Callback) -> str:
    """Where a callback is defined: ` at FILE:LINE`, "" if unknown."""
    function: Any = callback
    while isinstance(function, partial):
        function = function.func
    if not hasattr(function, "__code__"):
        function = getattr(function, "__func__", None) or type(function).__call__
    code = getattr(inspect.unwrap(function), "__code__", None)
    return f" at {code.co_filename}:{code.co_firstlineno}" if code is not None else ""
