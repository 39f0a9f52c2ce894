"""Pages for browsers and monitors; needs the extra `web` (aiohttp)."""

from taskrpc.web.pages import Page, task_pages
from taskrpc.web.server import WebServer

__all__ = ["Page", "WebServer", "task_pages"]
