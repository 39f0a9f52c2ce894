"""Pages of a task server for browsers and monitoring, over HTTP; needs the extra `web` (aiohttp).

Start with `server`. It is the only module that imports aiohttp, so `WebServer` is imported late.
`pages` makes the pages for monitoring and reads the files of the live page; `live`, `calls` and
`graph` make its events, `streams` sends them, and `control` makes the calls of its buttons.
`guard`, `tokens` and `peers` decide which user may do what.
Metrics themselves are in `taskrpc.observe.metrics`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskrpc.observe.web.pages import Page, task_pages

if TYPE_CHECKING:
    from taskrpc.observe.web.server import WebServer

__all__ = ["Page", "WebServer", "task_pages"]


def __getattr__(name: str) -> type[WebServer]:
    if name != "WebServer":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from taskrpc.observe.web.server import WebServer  # needs aiohttp, which the other names do not

    return WebServer
