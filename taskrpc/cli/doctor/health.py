"""What servers say of themselves: `taskrpc doctor` asks each `…/health` that is a Trigger."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable

import srvgen
from taskrpc.cli.doctor.findings import Finding, ok, problem
from taskrpc.cli.shared import graph
from taskrpc.cli.shared.remote import PATIENCE, Remote
from taskrpc.errors import ServiceUnavailable, TaskRpcError
from taskrpc.node import Node
from taskrpc.transport.tcp.tcp_network import domain_id
from taskrpc.wire.messages import Endpoint

_TYPE = "std_srvs/srv/Trigger"


async def ask(remote: Remote) -> AsyncIterator[Finding]:
    """How the servers of this machine are, or those at HOST:PORT; none where nobody answers."""
    try:
        names = _names(await _services(remote))
    except TaskRpcError:
        return  # why, has been told by whoever looked before
    async with remote.node() as node:
        for finding in await asyncio.gather(*(_asked(node, name) for name in names)):
            if finding is not None:
                yield finding


async def _services(remote: Remote) -> Iterable[Endpoint]:
    if remote.place:
        return (await remote.listing(remote.place)).services
    here = graph.domains().get(domain_id(), [])
    return [service for entry in here for service in entry.services]


def _names(services: Iterable[Endpoint]) -> list[str]:
    asked = {each.name for each in services if each.type_name == _TYPE}
    return sorted(name for name in asked if name.endswith("/health"))


async def _asked(node: Node, name: str) -> Finding | None:
    trigger = srvgen.load(_TYPE)
    try:
        answer = await node.create_client(trigger, name).call(trigger.Request(), timeout=PATIENCE)
    except ServiceUnavailable:
        return None  # its server answers nothing at all, as was told before
    except TaskRpcError as error:
        return problem(f"{name} does not answer: {error}", "see the log of its server")
    if answer.success:
        return ok(f"{name}: {answer.message}")
    return problem(f"{name}: {answer.message}", "wait a moment, or see the log of its server")
