"""A whole program: the event loop that runs it, and the signals that end it."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import os
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any, TypeVar, cast

from taskrpc import errors
from taskrpc.errors import ServiceUnavailable, TaskRpcError, WouldDeadlock

_Result = TypeVar("_Result")


@contextlib.asynccontextmanager
async def stop_requested() -> AsyncIterator[asyncio.Future[int]]:
    """Yield a future that is done when the program gets Ctrl-C, SIGTERM or Ctrl-Break.

    Its result is the signal's number. Signals are caught while the block runs; a second one ends
    the program at once.
    """
    from taskrpc.core.system import signals  # a program that does not spin needs none

    loop = asyncio.get_running_loop()
    stopped: asyncio.Future[int] = loop.create_future()

    def stop(number: int) -> None:
        if stopped.done():
            os._exit(128 + number)
        stopped.set_result(number)

    with signals.stop_signals(lambda number: loop.call_soon_threadsafe(stop, number)):
        yield stopped


def run(main: Coroutine[Any, Any, _Result]) -> _Result:
    """Run a coroutine to its end: `asyncio.run`, on uvloop where it is installed.

    If the script does not catch an error of taskrpc, it ends with one message without a traceback,
    and with the exit status of the commands' table.

    Raises:
        TaskRpcError: `main` is not a coroutine.
        WouldDeadlock: an event loop is already running, as in a notebook; await `main()` there.
    """
    show_errors_in_one_message()
    _check_main(main)
    with asyncio.Runner(loop_factory=fast_loop()) as runner:
        return runner.run(main)


def show_errors_in_one_message() -> None:
    """Do what `errors.show_in_one_message` does, with suggestions for unknown services."""
    errors.show_in_one_message(suggestion)


def suggestion(error: BaseException) -> str:
    """Return what the user can do if the error is a service that no program offers; else ""."""
    if not isinstance(error, ServiceUnavailable) or not error.service:
        return ""
    from taskrpc.core.transport import suggestions  # few programs end with an error

    return suggestions.suggestion(error.service)


def _check_main(main: Any) -> None:
    """Raise the errors of `run`."""
    name = getattr(main, "__name__", "main")
    if not inspect.iscoroutine(main):
        found = f"the function {name}" if callable(main) else repr(main)
        raise TaskRpcError(
            f"taskrpc.run: expected a coroutine, got {found}; write taskrpc.run({name}())"
        )
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return
    main.close()
    raise WouldDeadlock(
        "taskrpc.run: an event loop runs already, as in a notebook or an async function;"
        f" write `await {name}()` there"
    )


def fast_loop() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """Return uvloop's loop factory if uvloop is installed, else None for asyncio's own loop."""
    try:
        from uvloop import new_event_loop
    except ImportError:
        return None
    return cast("Callable[[], asyncio.AbstractEventLoop]", new_event_loop)
