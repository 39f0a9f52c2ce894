"""Makes the calls of a command line: finds the service, calls it, prints the response."""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

import srvgen
from taskrpc.cli.shared import quoting
from taskrpc.cli.shared.command import hinted
from taskrpc.cli.shared.definitions import differs_here, local_service_type, service_type_name
from taskrpc.cli.shared.remote import HERE, Remote
from taskrpc.cli.shared.values import as_typed, build_request
from taskrpc.client import Client
from taskrpc.errors import (
    AuthenticationFailed,
    ConnectionLost,
    DeadlineExceeded,
    InvalidRequest,
    ProtocolError,
    ServiceUnavailable,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.node import Node
from taskrpc.retry import RetryPolicy
from taskrpc.spi import with_address

POLL = 0.05
"""Seconds between two looks for a service that is not available yet."""
_EARLY = 0.1
"""Seconds before its deadline at which a call counts as ended by a shorter limit of the server."""


class Plan(msgspec.Struct, frozen=True):
    """The calls that a command line describes."""

    service: str
    type_name: str = ""
    """The type on the command line; "" to use the type that the server reports."""
    values: tuple[str, ...] = ()
    timeout: float | None = 10.0
    """Seconds for one call, including the wait for the service; None for no limit."""
    retries: int = 0
    request_id: str = ""
    """The id that the user gave the request, "" for none."""
    rate: float | None = None
    """Calls per second; None for no pause between them."""
    count: int = 1
    """The number of calls; 0 for no limit."""
    as_json: bool = False
    remote: Remote = HERE


async def perform(plan: Plan) -> None:
    """Make the calls and print requests and responses.

    Raises the errors of `Client.call`, InvalidName, InvalidRequest and DefinitionError.
    """
    service = quoting.expanded(plan.service)
    async with plan.remote.node() as node:
        await _Caller(plan, node, service).run()


class _Caller:
    """The calls of one command."""

    def __init__(self, plan: Plan, node: Node, service: str) -> None:
        self._plan = plan
        self._node = node
        self._service = service
        self._loop = asyncio.get_running_loop()
        self._retry = RetryPolicy(attempts=plan.retries + 1) if plan.retries else None
        self._client: Client[Any, Any] | None = None
        self._request: Callable[[], Any] = lambda: None
        """Makes the request of each call; `now` and `auto` become the time of the call."""
        self._reported_waiting = False
        self._lost: TaskRpcError | None = None
        """The error of the last failed connection; None if the last one succeeded."""

    async def run(self) -> None:
        began = self._loop.time()
        number = 0
        while True:
            await self._call()
            number += 1
            if number == self._plan.count:
                return
            if self._plan.rate is not None:
                due = began + number / self._plan.rate
                await asyncio.sleep(max(0.0, due - self._loop.time()))

    async def _call(self) -> None:
        timeout = self._plan.timeout
        deadline = None if timeout is None else self._loop.time() + timeout
        client = self._client
        if client is None or not client.service_is_ready():
            client = self._client = await self._reach(deadline)
        request = self._request()
        self._print(f"requester: making request: {as_typed(request)!r}\n")
        try:
            response = await client.call(
                request,
                timeout=None if deadline is None else deadline - self._loop.time(),
                retry=self._retry,
                request_id=self._plan.request_id,
            )
        except DeadlineExceeded as error:
            if deadline is None or self._loop.time() < deadline - _EARLY:
                raise  # the server has a shorter limit, which the text names
            raise self._too_late(error) from None
        if self._plan.as_json:
            import json

            print(json.dumps(without_nan(srvgen.to_builtins(response))), flush=True)
        self._print(f"response:\n{response!r}\n")

    async def _reach(self, deadline: float | None) -> Client[Any, Any]:
        """Wait for the service; set `_request` and return a client, both with its definition."""
        type_name, text = await self._definition(deadline)
        given = self._plan.type_name
        if given and service_type_name(given) != type_name:
            local_service_type(given)
            raise TypeMismatch(f"{self._service} is offered as {type_name}, not as {given}")
        cls = srvgen.define(type_name, text)
        try:
            self._request = _requests(cls.Request, self._plan.values)
        except InvalidRequest as error:
            here = "the server's definition differs from the one on this machine"
            raise hinted(error, here if differs_here(cls) else "") from None
        if self._client is not None:
            self._client.destroy()
        return self._node.create_client(cls, self._service)

    async def _definition(self, deadline: float | None) -> tuple[str, str]:
        """Wait for a server; returns the type of its service, and the text of the definition."""
        while True:
            try:
                async with asyncio.timeout_at(deadline):
                    return await self._node.definition(self._service)
            except (ConnectionLost, TimeoutError) as error:
                self._lost = error if isinstance(error, ConnectionLost) else self._lost
            except ServiceUnavailable:
                self._lost = None
            except (AuthenticationFailed, ProtocolError):
                if not self._plan.remote.addresses:
                    raise
            await self._report_waiting(deadline)
            left = math.inf if deadline is None else deadline - self._loop.time()
            if left <= 0:
                raise await self._unavailable()
            await asyncio.sleep(min(POLL, left))

    async def _report_waiting(self, deadline: float | None) -> None:
        """Report once that the command waits; raise if the call cannot succeed in any case."""
        if self._reported_waiting:
            return
        self._reported_waiting = True
        if self._plan.type_name:
            _requests(local_service_type(self._plan.type_name).Request, self._plan.values)
        await self._check_addresses(deadline)
        if not self._plan.as_json:
            print("waiting for service to become available...", file=sys.stderr, flush=True)
            if self._lost:
                print(f"({self._lost})", file=sys.stderr, flush=True)

    async def _check_addresses(self, deadline: float | None) -> None:
        """Find out why a remote program does not list the service.

        Raises AuthenticationFailed, because waiting would not help.
        """
        for address in self._plan.remote.addresses:
            try:
                async with asyncio.timeout_at(deadline):
                    await self._plan.remote.listing(address)
                return
            except (ConnectionLost, ProtocolError) as error:
                self._lost = type(error)(with_address(address, error))
            except TimeoutError:
                self._lost = self._lost or ConnectionLost(f"{address} did not respond in time")

    async def _unavailable(self) -> ServiceUnavailable:
        from taskrpc.cli.shared.graph import why_unavailable  # only where a call fails

        waited, remote = f"(waited {self._plan.timeout:g} s)", self._plan.remote
        return await why_unavailable(self._service, remote, self._node, waited, self._lost)

    def _too_late(self, error: DeadlineExceeded) -> DeadlineExceeded:
        fate = "the call was not sent" if error.not_executed else "the call may have run"
        problem = f"no response from {self._service} within {self._plan.timeout:g} s; {fate}"
        return DeadlineExceeded(problem, not_executed=error.not_executed)

    def _print(self, text: str) -> None:
        if not self._plan.as_json:
            print(text, flush=True)


def _requests(cls: Any, values: Sequence[str]) -> Callable[[], Any]:
    """Return the function that makes the request of each call. Raises InvalidRequest."""
    if not any(word in value for value in values for word in ("auto", "now")):
        request = build_request(cls, values)
        return lambda: request
    from taskrpc.cli.shared.messages import Template  # few requests need the time

    return Template(cls, values).message


def without_nan(value: Any) -> Any:
    """Return a value with None in place of NaN and infinity, which JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list):
        return [without_nan(each) for each in value]
    if isinstance(value, dict):
        return {name: without_nan(each) for name, each in value.items()}
    return value
