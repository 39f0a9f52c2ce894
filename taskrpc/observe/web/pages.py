"""The contents of HTTP responses: the pages for monitoring, and the files of the live page."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import msgspec

from taskrpc.observe.metrics.prometheus import CONTENT_TYPE

if TYPE_CHECKING:
    from taskrpc.observe.metrics import Metrics
    from taskrpc.robot.tasks.services.offered_tasks import OfferedTasks

STATIC = Path(__file__).with_name("static")
"""The folder of the live page's files."""

JSON = "application/json"
TEXT = "text/plain; charset=utf-8"

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".json": JSON,
    ".woff2": "font/woff2",
}
_INDEX = "index.html"


class Page(msgspec.Struct, frozen=True):
    """One HTTP response."""

    body: str | bytes
    content_type: str = TEXT
    status: int = 200
    etag: str = ""
    """The version of a file that browsers may keep; "" for a page that they must not keep."""


Pages: TypeAlias = Mapping[str, Callable[[], Awaitable[Page]]]
"""The functions that make the page of each path, such as `/health`."""


def task_pages(server: OfferedTasks, metrics: Metrics) -> Pages:
    """Return the pages `/health` (503 while no tasks are accepted) and `/metrics`."""

    async def health() -> Page:
        response = await server.health()
        body = json.dumps({"ready": response.success, "message": response.message})
        return Page(f"{body}\n", JSON, 200 if response.success else 503)

    async def measured() -> Page:
        return Page(metrics.text(), CONTENT_TYPE)

    return {"/health": health, "/metrics": measured}


def static_files(folder: Path = STATIC) -> dict[str, Page]:
    """Return the files of a folder by path: `index.html` as `/`, the others as `/NAME`.

    All files are read now. So a request can never reach another file, whatever its path is. Files
    of unknown kinds are left out.
    """
    files = {}
    for path in sorted(folder.rglob("*")):
        content_type = _TYPES.get(path.suffix)
        if content_type is None or not path.is_file():
            continue
        body = path.read_bytes()
        name = path.relative_to(folder).as_posix()
        etag = f'"{hashlib.sha256(body).hexdigest()[:20]}"'
        files["/" if name == _INDEX else f"/{name}"] = Page(body, content_type, etag=etag)
    return files
