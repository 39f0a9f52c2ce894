"""Opens sessions of Zenoh, and passes what their threads receive to the event loop."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

import zenoh

from taskrpc.errors import TaskRpcError
from taskrpc.transport.zenoh.configuration import OVERRIDE_VARIABLE, Configuration

_T = TypeVar("_T")
_SOURCE = re.compile(r" at /\S+\.rs:\d+\.?")
"""Where in Zenoh's source code an error arose."""
_MAX_REASON = 300


def open_session(configuration: Configuration) -> zenoh.Session:
    """Open a session; this blocks. Raises TaskRpcError with what the user can do."""
    config = _config(configuration)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        reason = reason_of(error)
        if "nable to connect" in reason and configuration.routers:
            routers = ", ".join(configuration.routers)
            raise TaskRpcError(
                f"no Zenoh router answers at {routers}; start one there with `taskrpc router`, or"
                f" give the address of yours with peers= or {OVERRIDE_VARIABLE}"
            ) from None
        raise TaskRpcError(f"cannot open a Zenoh session: {reason}") from None


def reason_of(error: BaseException) -> str:
    """Return the text of one of Zenoh's errors in one line, without places in its source."""
    text = " ".join(_SOURCE.sub("", str(error)).split())
    return text if len(text) <= _MAX_REASON else text[:_MAX_REASON] + "…"


def _config(configuration: Configuration) -> zenoh.Config:
    file = configuration.file
    try:
        config = zenoh.Config.from_file(file) if file else zenoh.Config()
    except Exception as error:  # the file may be missing, or not valid JSON5
        problem = f"cannot read Zenoh's configuration {file}: {reason_of(error)}"
        raise TaskRpcError(problem) from None
    for key, value in configuration.values:
        try:
            config.insert_json5(key, value)
        except zenoh.ZError as error:
            problem = f"Zenoh refuses {key}={value} ({OVERRIDE_VARIABLE}?): {reason_of(error)}"
            raise TaskRpcError(problem) from None
    return config


class HandOff:
    """Passes values from Zenoh's threads to the event loop, in order.

    Many values that arrive together wake the loop once.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.turn = 0
        """Counts the turns of the loop that handled values."""
        self._loop = loop
        self._waiting: deque[tuple[Callable[[Any], object], Any]] = deque()
        self._planned = False
        self._closed = False

    def post(self, handle: Callable[[_T], object], value: _T) -> None:
        """Call `handle(value)` on the loop soon; any thread may call this."""
        self._waiting.append((handle, value))
        if not self._planned:
            self._planned = True
            # The loop may have been closed while this thread received the value.
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self.drain)

    def callback(
        self, handle: Callable[[_T], object], over: Callable[[None], object] | None = None
    ) -> Any:
        """Return a handler for Zenoh that posts each value, and the end if `over` is given."""
        post = self.post
        # Direct: an indirect callback would go through one more thread.
        return zenoh.handlers.Callback(
            lambda value: post(handle, value),
            (lambda: None) if over is None else (lambda: post(over, None)),
            indirect=False,
        )

    def drain(self) -> None:
        """Handle the values that wait now; later ones plan another turn."""
        self._planned = False
        self.turn += 1
        waiting = self._waiting
        for _ in range(len(waiting)):
            handle, value = waiting.popleft()
            if self._closed:
                continue
            try:
                handle(value)
            except Exception as error:  # the other values must arrive all the same
                context = {"message": "a value from Zenoh was not handled", "exception": error}
                self._loop.call_exception_handler(context)

    def close(self) -> None:
        """Drop all values from now on."""
        self._closed = True
