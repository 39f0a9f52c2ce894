"""Opens sessions of Zenoh, and passes what their threads receive to the event loop."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, TypeVar

import zenoh

from taskrpc.errors import TaskRpcError
from taskrpc.middleware.zenoh.configuration import (
    FILE_VARIABLE,
    OVERRIDE_VARIABLE,
    Configuration,
    start_command,
)
from taskrpc.spi import Handoff

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
        if "nable to connect" in reason:
            raise TaskRpcError(_no_router(configuration, reason)) from None
        raise TaskRpcError(f"cannot open a Zenoh session: {reason}") from None


def _no_router(configuration: Configuration, reason: str) -> str:
    routers, source = configuration.routers, configuration.routers_from
    if not routers:
        file = f"{configuration.file} ({FILE_VARIABLE})"
        return f"no Zenoh router answers at the addresses in {file}; start one there: {reason}"
    start = f"start one there with `{start_command(routers[0])}`"
    elsewhere = "give the address of another router with --connect, peers= or TASKRPC_PEERS"
    other = f"correct {source}" if source else elsewhere
    return f"no Zenoh router answers at {', '.join(routers)}; {start}, or {other}"


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
            problem = (
                f"Zenoh refuses {key}={value}: {reason_of(error)}; correct {OVERRIDE_VARIABLE}"
            )
            raise TaskRpcError(problem) from None
    return config


def handler(
    handoff: Handoff,
    handle: Callable[[_T], object],
    over: Callable[[], object] | None = None,
) -> Any:
    """Return a handler for Zenoh that passes each value to the loop, and the end to `over`."""
    put = handoff.put
    # Direct: an indirect callback would go through one more thread.
    return zenoh.handlers.Callback(
        lambda value: put(handle, value),
        (lambda: None) if over is None else (lambda: put(over)),
        indirect=False,
    )
