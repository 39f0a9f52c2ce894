"""The checks of `taskrpc doctor` for programs over Zenoh or ROS 2."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Iterator
from importlib.metadata import PackageNotFoundError, version

from taskrpc.cli.ros.doctor.checks import Finding, note, ok, problem
from taskrpc.cli.shared.remote import Remote
from taskrpc.errors import TaskRpcError
from taskrpc.middleware.zenoh.configuration import (
    FILE_VARIABLE,
    OVERRIDE_VARIABLE,
    Configuration,
    configuration_of,
)
from taskrpc.spi import domain_id, environment_peers, registered, suggestions

NAMES = {"zenoh": "Zenoh", "ros": "ROS 2"}
"""The transports that are checked here, as the report names them."""


def transports_of(remote: Remote) -> list[str]:
    """Return the transports to check: that of the command, or those that the environment names.

    Raises TaskRpcError for an unknown transport.
    """
    registered(remote.transport)
    if remote.transport != "tcp":
        return [remote.transport]
    has_zenoh = os.environ.get(FILE_VARIABLE) or os.environ.get(OVERRIDE_VARIABLE)
    has_ros = os.environ.get("ROS_DISTRO")  # set by ROS's setup file
    return ["zenoh"] * bool(has_zenoh) + ["ros"] * bool(has_ros)


async def examine(remote: Remote, transport: str) -> AsyncIterator[Finding]:
    """Check the software of a transport, whether a program can join, and which services it sees."""
    checks = {"zenoh": _zenoh, "ros": _ros}
    findings = checks[transport](remote) if transport in checks else iter(())
    for finding in findings:
        yield finding
        if finding.state == "problem":
            return
    yield await _services(remote, transport)


def _zenoh(remote: Remote) -> Iterator[Finding]:
    """Check Zenoh's library and the settings of the session."""
    try:
        yield ok(f"eclipse-zenoh {version('eclipse-zenoh')}")
    except PackageNotFoundError:
        yield problem("eclipse-zenoh is not installed", registered("zenoh").advice())
        return
    peers = environment_peers() if remote.peers is None else remote.peers
    try:
        found = configuration_of(peers, environ=os.environ)
    except TaskRpcError as error:
        yield _problem_of(error)
        return
    if dict(found.values).get("mode", "").strip("\"'") == "peer":
        yield note(
            f'{OVERRIDE_VARIABLE} has mode="peer": from Zenoh 1.9 on, such a program gets nothing'
            " from a router",
            'use mode="client"',
        )
    yield ok(f"programs over Zenoh connect to {_routers(found)}")


def _routers(found: Configuration) -> str:
    source = f" ({found.routers_from})" if found.routers_from else ""
    return (", ".join(found.routers) or f"the routers in {found.file}") + source


def _ros(_: Remote) -> Iterator[Finding]:
    """Check whether this Python imports the real rclpy, and which middleware it uses."""
    from taskrpc.middleware.ros.installed import real_rclpy

    if chosen := os.environ.get("RMW_IMPLEMENTATION"):
        # Before the import: rclpy ends the process if it finds another middleware.
        yield ok(f"RMW_IMPLEMENTATION is {chosen}")
    try:
        rclpy = real_rclpy()
        yield ok(f"the real rclpy is {rclpy.__file__}")
        rmw = rclpy.utilities.get_rmw_implementation_identifier()
    except TaskRpcError as error:
        yield _problem_of(error)
    except Exception as error:  # rclpy raises whatever loading the middleware raises
        advice = "set RMW_IMPLEMENTATION to an installed middleware, or unset it"
        yield problem(f"ROS 2 cannot load its middleware: {error}", advice)
    else:
        yield ok(f"ROS 2 uses {rmw}")


async def _services(remote: Remote, transport: str) -> Finding:
    """Join with a node, and report the services that it sees."""
    name, domain = NAMES.get(transport, transport), domain_id()
    peers = remote.peers if remote.transport == transport else None
    try:
        node = Remote(transport=transport, tls=remote.tls, token=remote.token)
        node.peers = peers
        async with node.node() as joined:
            services = suggestions.services(await joined.graph())
    except TaskRpcError as error:
        return _problem_of(error)
    if not services:
        advice = f"start one, for example taskrpc-server --transport {transport}"
        return note(f"no program offers a service over {name} in domain {domain}", advice)
    return ok(f"over {name}, programs in domain {domain} offer {', '.join(services)}")


def _problem_of(error: TaskRpcError) -> Finding:
    """Return an error as a finding: most errors say what to do behind a semicolon."""
    text, _, advice = str(error).partition("; ")
    return problem(text, advice)
