"""The running programs, without the command itself; hidden names only on request."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

from taskrpc.cli.shared.command import hinted
from taskrpc.cli.shared.remote import HERE, Remote, called_lab
from taskrpc.errors import ServiceUnavailable, TaskRpcError
from taskrpc.node import Node
from taskrpc.spi import (
    RegistryEntry,
    ServiceEndpoint,
    TopicEndpoint,
    domain_id,
    entry_of,
    process_state,
    suggestions,
)

_PATIENCE = 2.0
"""Seconds for a middleware to find the first other program; DDS may repeat its question."""
_POLL = 0.1


def look(remote: Remote) -> list[RegistryEntry]:
    """Return the entries of all processes in this domain, or of the one at `remote.address`.

    The entry of this process is left out.
    """
    return asyncio.run(_look(remote))


async def _look(remote: Remote) -> list[RegistryEntry]:
    async with remote.node() as node:
        return await entries_of(remote, node)


async def entries_of(remote: Remote, node: Node) -> list[RegistryEntry]:
    """Return the same as `look`, for a command that already has a node."""
    if remote.address:
        return [entry_of(remote.address, await remote.listing(remote.address))]
    found = suggestions.others(await node.graph())
    if remote.transport == "tcp":
        return found  # the registry of this machine is complete at once
    loop = asyncio.get_running_loop()
    end = loop.time() + _PATIENCE
    while not found and loop.time() < end:
        await asyncio.sleep(_POLL)
        found = suggestions.others(await node.graph())
    return found


def gid(entry: RegistryEntry, endpoint: ServiceEndpoint | TopicEndpoint, kind: int) -> str:
    """Return the GID of an endpoint as ros2 prints it; rclpy programs see the same GID.

    `kind` is the value of rclpy's `EndpointTypeEnum`.
    """
    from taskrpc.spi import gid_of

    numbers = gid_of(entry.pid, endpoint.node, endpoint.name, kind)
    return ".".join(f"{each:02x}" for each in numbers)


def qos_lines(*, reliable: bool = True, depth: int = 10, latched: bool = False) -> list[str]:
    """Return a QoS profile as ros2 prints it; by default the profile of services."""
    return [
        "QoS profile:",
        f"  Reliability: {'RELIABLE' if reliable else 'BEST_EFFORT'}",
        f"  History (Depth): KEEP_LAST ({depth})",
        f"  Durability: {'TRANSIENT_LOCAL' if latched else 'VOLATILE'}",
        "  Lifespan: Infinite",
        "  Deadline: Infinite",
        "  Liveliness: AUTOMATIC",
        "  Liveliness lease duration: Infinite",
    ]


async def why_unavailable(
    service: str, remote: Remote, node: Node, waited: str, lost: TaskRpcError | None
) -> ServiceUnavailable:
    """Return the error for a service that did not become available, with a hint.

    `lost` is the error of a failed connection, None if every program answered.
    """
    # Do not connect again to an address that did not respond.
    entries = (
        suggestions.domains().get(domain_id(), [])
        if lost
        else suggestions.others(await node.graph())
    )
    for entry in entries:
        if entry.offers(service):
            return _silent(entry, service, waited)
    if lost:
        return _out_of_reach(remote.address, lost, waited)
    hint = unknown_service_hint(service, entries, remote)
    return hinted(ServiceUnavailable(f"no server offers {service} {waited}"), hint)


def _out_of_reach(address: str, lost: TaskRpcError, waited: str) -> ServiceUnavailable:
    if not address and called_lab() is not None:
        return hinted(ServiceUnavailable(f"{lost} {waited}"), "ask the lecturer whether it runs")
    doctor = f"taskrpc doctor {address}".rstrip()
    problem = f"no taskrpc program responds: {lost} {waited}"
    return hinted(ServiceUnavailable(problem), f"find out why: {doctor}")


def _silent(entry: RegistryEntry, service: str, waited: str) -> ServiceUnavailable:
    """Return the error for a running process that offers a service and does not answer."""
    program = f"{entry.script} (pid {entry.pid})"
    if process_state.is_stopped(entry.pid):
        return hinted(
            ServiceUnavailable(f"{program} offers {service}, but {process_state.STOPPED} {waited}"),
            f"`fg` in its terminal or `kill -CONT {entry.pid}` continues it, `taskrpc stop"
            f" {entry.pid}` ends it",
        )
    return hinted(
        ServiceUnavailable(f"{program} offers {service} but does not answer {waited}"),
        f"find out why: taskrpc doctor {entry.address}",
    )


def unknown_service_hint(
    service: str, entries: Iterable[RegistryEntry], remote: Remote = HERE
) -> str:
    """Return a hint for a user who named a service that no program offers."""
    found = suggestions.like(service, entries, searches_domains=remote.transport == "tcp")
    return found or _nothing_offered(remote)


def _nothing_offered(remote: Remote) -> str:
    """Return the hint if no program offers any service."""
    if remote.transport != "tcp":
        return f"no program offers a service over {remote.transport} in domain {domain_id()}"
    if remote.address:
        return f"the program at {remote.address} offers no service"
    return suggestions.nothing_offered()
