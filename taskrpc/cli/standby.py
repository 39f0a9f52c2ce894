"""`taskrpc-server --standby`: waits for the end of the server before it, and takes its place."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from typing import TypeVar

from taskrpc.errors import CannotListen, NameInUse
from taskrpc.tasks import SqliteStore
from taskrpc.tasks.server import load_types

_Result = TypeVar("_Result")

_PATIENCE = 5.0
"""Seconds in which a server that has given up its file must give up its addresses and names."""
_LOOK = 0.05


async def claimed(
    store: SqliteStore, stopped: asyncio.Future[int], say: Callable[[str], object]
) -> bool:
    """Wait until the store is ours; False where this server is told to end before.

    Raises StoreError.
    """
    load_types()  # here it takes nobody's time
    turn = asyncio.ensure_future(store.claim(lambda error: say(f"standing by: {error.fact}")))
    await asyncio.wait((turn, stopped), return_when=asyncio.FIRST_COMPLETED)
    if not stopped.done():
        await turn
        return True
    turn.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await turn
    await store.close()
    return False


async def once_free(start: Callable[[], Awaitable[_Result]]) -> _Result:
    """Start something at the addresses of the server before, which ends just now.

    Raises CannotListen or NameInUse if another program has them.
    """
    loop = asyncio.get_running_loop()
    latest = loop.time() + _PATIENCE
    while True:
        try:
            return await start()
        except (CannotListen, NameInUse):
            if loop.time() >= latest:
                raise
        await asyncio.sleep(_LOOK)
