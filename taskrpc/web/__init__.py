"""Pages of a task server for browsers and monitoring, over HTTP; needs the extra `web` (aiohttp).

Start with `server`. It is the only module that imports aiohttp, so it is not imported here.
`pages` makes the pages for monitoring and reads the files of the live page; `live`, `calls` and
`graph` make its events, `streams` sends them, and `control` makes the calls of its buttons.
`guard`, `tokens` and `peers` decide which user may do what.
Metrics themselves are in `taskrpc.metrics`.
"""

from taskrpc.web.pages import Page, task_pages

__all__ = ["Page", "task_pages"]
