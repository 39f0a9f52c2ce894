"""Runs a callback that nobody waits for: of a subscription or a timer, one call at a time."""

from __future__ import annotations

import asyncio
import inspect
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

from taskrpc.execution.stepping import Stepper

if TYPE_CHECKING:
    from taskrpc.execution.daemon_threads import DaemonThreads

log = logging.getLogger("taskrpc.callbacks")

Callback: TypeAlias = Callable[..., Any]
"""Plain or async; what it returns is dropped."""

HOLDS_LOOP_AFTER = 0.25
"""Seconds on the loop after which a callback is named in a warning."""


class Runner:
    """Calls a callback; `idle` is called when a call that took a while has ended.

    An exception is logged and ends nothing. A plain callback runs on the event loop, or in a thread
    of its own with `threaded`.

    Raises TypeError for one that cannot be called with a value for each name in `takes`.
    """

    def __init__(
        self,
        callback: Callback,
        what: str,
        *takes: str,
        threaded: bool,
        idle: Callable[[], object],
    ) -> None:
        _check(callback, what, takes)
        self.busy = False
        """Whether a call runs."""
        self.spent = 0.0
        """Seconds that plain calls have kept the loop since this was last set to 0."""
        self._callback = callback
        self._what = what
        self._idle = idle
        self._loop = asyncio.get_running_loop()
        self._stepper = Stepper(self._loop, self._held)
        self._threads = _thread(what) if threaded else None
        self._job: asyncio.Future[Any] | None = None
        self._warned = False

    def run(self, *arguments: Any) -> None:
        """Call it; not while it is busy."""
        self.busy = True
        if self._threads is not None:
            callback = self._callback
            job = self._loop.run_in_executor(
                self._threads, lambda: _run_to_end(callback, arguments)
            )
            self._await(job)
            return
        began = self._loop.time()
        try:
            result = self._callback(*arguments)
            if hasattr(result, "__await__"):
                coroutine = result if inspect.iscoroutine(result) else _awaited(result)
                self._await(self._stepper.step(_nothing, coroutine))
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
        """Stop the call that runs, unless it is the one that says so; there will be no other."""
        if self._job is not None and self._job is not asyncio.current_task():
            self._job.cancel()
        self._stepper.close()
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
            # From a turn of its own: uvloop swallows what a protocol raises.
            self._loop.call_soon(_end_program, error)
        else:
            log.error("%s failed:", self._what, exc_info=error)

    def _held(self, seconds: float) -> None:
        if seconds > HOLDS_LOOP_AFTER and not self._warned:
            self._warned = True
            log.warning(
                "%s held the event loop for %.2f s, so that nothing else ran; let it await"
                " instead of blocking, or use taskrpc.sync",
                self._what,
                seconds,
            )


def _check(callback: Callback, what: str, takes: tuple[str, ...]) -> None:
    wanted = f"{what}: expected a function that takes {', '.join(takes) or 'nothing'}"
    if not callable(callback):
        raise TypeError(f"{wanted}, got {callback!r}")
    try:
        signature = inspect.signature(callback)
    except (TypeError, ValueError):  # some built-in functions tell nothing of themselves
        return
    try:
        signature.bind(*takes)
    except TypeError as error:
        name = getattr(callback, "__qualname__", repr(callback))
        raise TypeError(f"{wanted}, got {name}{signature}: {error}") from None


def _thread(what: str) -> DaemonThreads:
    from taskrpc.execution.daemon_threads import DaemonThreads  # asyncio programs need none

    return DaemonThreads(1, f"taskrpc {what}")


def _nothing() -> None:
    """A callback that answers no call has no context to prepare."""


async def _awaited(result: Any) -> Any:
    return await result


def _end_program(error: BaseException) -> None:
    raise error


def _run_to_end(callback: Callback, arguments: tuple[Any, ...]) -> None:
    try:
        result = callback(*arguments)
        if inspect.iscoroutine(result):
            asyncio.run(result)
    except StopIteration as error:
        raise RuntimeError("the callback raised StopIteration") from error
