"""Pages of a task server for browsers and monitoring, over HTTP; needs the extra `web` (aiohttp).

Start with `server`; `guard` decides which requests it answers, `pages` makes the content. Only
`server` imports aiohttp, so that the other two work and are tested without it.
"""

from taskrpc.web.pages import Page, task_pages
from taskrpc.web.server import WebServer

__all__ = ["Page", "WebServer", "task_pages"]
