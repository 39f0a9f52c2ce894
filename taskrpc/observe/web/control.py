"""`POST /control/VERB`: the buttons of the live page call the task server's public services.

Each caller has a node of its own, which calls over the ordinary transport with the caller's own
token. So its calls have the same roles, limits and logs as the calls of every other client. A node
that has made no call for `IDLE_SECONDS` is closed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

import srvgen
from taskrpc.client import Client
from taskrpc.errors import (
    AuthenticationFailed,
    Code,
    DeadlineExceeded,
    HandlerFailed,
    InvalidRequest,
    OutcomeUnknown,
    PermissionDenied,
    ServerBusy,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.node import Node
from taskrpc.observe.web.pages import JSON, Page
from taskrpc.observe.web.tokens import Holder
from taskrpc.retry import RetryPolicy

NODE = "web_page"
"""The name of the nodes."""
VERBS = ("submit", "cancel", "pause", "resume", "reprioritise", "requeue", "drop", "stop")
"""The services that the page may call: `/robot_task` for `submit`, else the one of that name."""
MAX_NODES = 16
"""Most nodes, one for each account that uses the page for control."""
IDLE_SECONDS = 60.0
"""Seconds without a call after which a node is closed."""
TIMEOUT = 5.0
"""Seconds for one call, with its retries."""
MAX_BODY = 65_536
"""Most bytes of a request."""

_STATUS_OF_CODE = {
    Code.INVALID_ARGUMENT: 400,
    Code.NOT_FOUND: 404,
    Code.PERMISSION_DENIED: 403,
    Code.UNAUTHENTICATED: 401,
    Code.DEADLINE_EXCEEDED: 504,
}
_STATUS_OF_ERROR: tuple[tuple[type[TaskRpcError], int], ...] = (
    (InvalidRequest, 400),
    (AuthenticationFailed, 401),
    (PermissionDenied, 403),
    (TypeMismatch, 409),
    (DeadlineExceeded, 504),
    (OutcomeUnknown, 504),
)


class RequestError(TaskRpcError):
    """A request of the page that cannot become a call."""

    def __init__(self, status: int, problem: str) -> None:
        super().__init__(problem, not_executed=True)
        self.status = status


class _Caller:
    """The node of one caller, and its clients by verb."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.clients: dict[str, Client[Any, Any]] = {}
        self.calls = 0
        """The number of calls in flight."""
        self.used = 0.0
        """When the last call ended, on the loop's clock."""


class Control:
    """Calls the services of a task server for the live page.

    Args:
        types: the class of each verb's service.
        make_node: returns an unstarted node for the account's token; "" for the server's own user.
        service: the name of the service that accepts tasks.
    """

    def __init__(
        self,
        types: Mapping[str, Any],
        make_node: Callable[[str], Node],
        *,
        service: str = "/robot_task",
    ) -> None:
        self._types = types
        self._make_node = make_node
        self._service = service
        self._callers: dict[str, _Caller] = {}
        """By token; the least recently used first."""
        self._timer: asyncio.TimerHandle | None = None

    async def answer(self, verb: str, content_type: str, body: bytes, holder: Holder) -> Page:
        """Call a service with a request as a JSON object; returns its response, or the error."""
        try:
            request = self._request(verb, content_type, body)
            response = await self._call(verb, request, holder.token)
        except TaskRpcError as error:
            return error_page(error)
        return Page(msgspec.json.encode(srvgen.to_builtins(response)), JSON)

    async def close(self) -> None:
        """Close all nodes."""
        if self._timer is not None:
            self._timer.cancel()
        callers, self._callers = list(self._callers.values()), {}
        for caller in callers:
            await caller.node.destroy()

    def _request(self, verb: str, content_type: str, body: bytes) -> Any:
        if verb not in VERBS:
            raise RequestError(404, f"expected one of {', '.join(VERBS)}, got {verb[:40]!r}")
        if content_type.partition(";")[0].strip().lower() != JSON:
            raise RequestError(400, f"expected the Content-Type {JSON}, got {content_type[:80]!r}")
        if len(body) > MAX_BODY:
            raise RequestError(400, f"expected a body of at most {MAX_BODY} bytes, got more")
        try:
            fields = msgspec.json.decode(body or b"{}")
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise RequestError(400, f"expected a JSON object: {error}") from None
        except RecursionError:
            raise RequestError(400, "expected a JSON object with fewer levels") from None
        if not isinstance(fields, dict):
            raise RequestError(400, f"expected a JSON object, got {type(fields).__name__}")
        try:
            return srvgen.from_builtins(self._types[verb].Request, fields)
        except srvgen.FieldError as error:
            raise InvalidRequest(error.path, error.problem) from None
        except RecursionError:
            raise RequestError(400, "expected a JSON object with fewer levels") from None

    async def _call(self, verb: str, request: Any, token: str) -> Any:
        caller = await self._caller(token)
        caller.calls += 1
        try:
            client = caller.clients.get(verb)
            if client is None:
                name = self._service if verb == "submit" else f"{self._service}/{verb}"
                client = caller.clients[verb] = caller.node.create_client(self._types[verb], name)
            return await client.call(request, timeout=TIMEOUT, retry=RetryPolicy())
        finally:
            caller.calls -= 1
            caller.used = asyncio.get_running_loop().time()
            self._expect_idle()

    async def _caller(self, token: str) -> _Caller:
        caller = self._callers.pop(token, None)
        if caller is None:
            await self._make_room()
            caller = _Caller(self._make_node(token))
            await caller.node.start()
        self._callers[token] = caller
        return caller

    async def _make_room(self) -> None:
        if len(self._callers) < MAX_NODES:
            return
        idle = next((key for key, each in self._callers.items() if not each.calls), None)
        if idle is None:
            problem = (
                f"{MAX_NODES} users already control the robot through the page; try again later"
            )
            raise ServerBusy(problem, retry_after=1.0)
        await self._callers.pop(idle).node.destroy()

    def _expect_idle(self) -> None:
        if self._timer is None:
            loop = asyncio.get_running_loop()
            self._timer = loop.call_later(IDLE_SECONDS, self._close_idle)

    def _close_idle(self) -> None:
        self._timer = None
        oldest = asyncio.get_running_loop().time() - IDLE_SECONDS
        for token, caller in list(self._callers.items()):
            if not caller.calls and caller.used <= oldest:
                del self._callers[token]
                closing = asyncio.ensure_future(caller.node.destroy())
                closing.add_done_callback(_retrieve)
        if self._callers:
            self._expect_idle()


def error_page(error: TaskRpcError) -> Page:
    """Return an error as the page expects it: its class and its text, with an HTTP status."""
    fields = {"error": type(error).__name__, "message": str(error)}
    return Page(msgspec.json.encode(fields), JSON, _status(error))


def _status(error: TaskRpcError) -> int:
    if isinstance(error, RequestError):
        return error.status
    if isinstance(error, HandlerFailed):
        return _STATUS_OF_CODE.get(error.code or Code.UNKNOWN, 503)
    return next((status for kind, status in _STATUS_OF_ERROR if isinstance(error, kind)), 503)


def _retrieve(closing: asyncio.Future[None]) -> None:
    if not closing.cancelled():
        closing.exception()
