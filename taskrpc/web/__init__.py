"""Pages of a task server for browsers and monitoring, over HTTP; needs the extra `web` (aiohttp).

Start with `server`, the only module that imports aiohttp. `pages` makes the pages for monitoring
and reads the files of the live page; `live`, `calls` and `graph` make its events, `streams` sends
them, and `control` makes the calls of its buttons. `guard`, `tokens` and `peers` decide which user
may do what.
Metrics themselves are in `taskrpc.metrics`.
"""

from taskrpc.web.pages import Page, task_pages
from taskrpc.web.server import WebServer

__all__ = ["Page", "WebServer", "task_pages"]
