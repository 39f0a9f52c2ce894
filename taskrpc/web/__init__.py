"""Pages of a task server for browsers and monitoring, over HTTP; needs the extra `web` (aiohttp).

Start with `server`, the only module that imports aiohttp; `task_pages` makes the contents. `guard`
decides which requests it answers. Metrics themselves are in `taskrpc.metrics`.
"""

from taskrpc.web.server import Page, WebServer, task_pages

__all__ = ["Page", "WebServer", "task_pages"]
