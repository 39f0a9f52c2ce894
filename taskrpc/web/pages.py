"""What the pages of a task server say."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

import msgspec

from taskrpc.metrics.prometheus import CONTENT_TYPE

if TYPE_CHECKING:
    from taskrpc.metrics import Metrics
    from taskrpc.tasks import TaskServer


class Page(msgspec.Struct, frozen=True):
    """One answer."""

    body: str
    content_type: str = "text/plain; charset=utf-8"
    status: int = 200


Pages: TypeAlias = Mapping[str, Callable[[], Awaitable[Page]]]
"""What to show under each path, such as `/health`."""


def task_pages(server: TaskServer, metrics: Metrics) -> Pages:
    """`/health` (200, or 503 while no tasks are taken) and `/metrics` of a task server."""

    async def health() -> Page:
        answer = await server.health()
        body = json.dumps({"ready": answer.success, "message": answer.message})
        return Page(f"{body}\n", "application/json", 200 if answer.success else 503)

    async def measured() -> Page:
        return Page(metrics.text(), CONTENT_TYPE)

    return {"/health": health, "/metrics": measured}
