"""`taskrpc bridge mcp`: services, actions and topics as tools and resources of an agent."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import MutableMapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taskrpc.cli.shared import remote
from taskrpc.cli.shared.command import (
    Exit,
    NotFound,
    UsageError,
    exit_after,
    hinted,
    tune_for_long_run,
)
from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from taskrpc.bridges.mcp.permissions import Permissions
    from taskrpc.bridges.mcp.serving import HttpServer

_NAME = "mcp_bridge"
"""The name of the node."""
_SHORTEST_TOKEN = 16
_NEEDED = "taskrpc bridge mcp needs the package mcp 2.3 or newer: pip install 'taskrpc[mcp]'"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `taskrpc bridge mcp` to its parser."""
    add = parser.add_argument
    what = "Serve HTTP at this address of this machine, not standard input and output"
    add("--http", metavar="HOST:PORT", type=remote.address, help=what)
    what = "A file with the token that HTTP clients must send"
    add("--token-file", metavar="FILE", help=what)
    add(
        "--map",
        metavar="FILE",
        type=Path,
        help="The map of the robot (YAML), for the agent to read",
    )
    add("--policy", metavar="FILE", help="What the agent may do (YAML); see taskrpc door")
    add("--as", metavar="NAME", dest="name", default="", help="The agent's name in the policy")
    parser.set_defaults(run=_run, connect=None, tls_ca=None, tls_cert=None, tls_key=None)


def _run(options: argparse.Namespace) -> int:
    try:
        from mcp.server import ServerRequestContext  # noqa: F401 - not in earlier versions
    except ImportError:
        raise TaskRpcError(_NEEDED) from None
    # Not TASKRPC_TOKEN: an agent must not get the secret of the programs of a lab.
    token = remote.remote_of(options).token or ""
    if options.http:
        _check_http(options, token)
    permissions = _permissions(options)
    if options.map:
        from taskrpc.robot import read_map

        read_map(options.map)
    if sys.platform == "linux":
        find_runtime_folder(os.environ, Path(f"/run/user/{os.getuid()}"))
    from taskrpc.program import run

    return run(_serve(options, permissions, token))


def _permissions(options: argparse.Namespace) -> Permissions:
    """Return what the agent may do. Raises UsageError, PolicyError, NotFound."""
    from taskrpc.bridges.mcp.permissions import Permissions

    if bool(options.policy) != bool(options.name):
        problem = "expected --policy FILE and --as NAME together"
        raise UsageError(f"taskrpc bridge mcp: error: {problem}")
    if not options.policy:
        return Permissions()
    from srvgen.definitions.names import did_you_mean
    from taskrpc.bridges.door import Door

    door = Door(options.policy)  # without a node: the bridge asks only about absolute names
    if options.name not in door.policy.names:
        problem = f"{options.policy} has no rules for {options.name!r}"
        raise hinted(NotFound(problem), did_you_mean(options.name, door.policy.names))
    return Permissions(door, options.name)


def find_runtime_folder(environment: MutableMapping[str, str], usual: Path) -> None:
    """Set XDG_RUNTIME_DIR to the usual folder if a client has left it out.

    Clients start this command with few variables of their own environment. Without this one, the
    bridge would look for the programs of the user in another folder, and find none.
    """
    if not environment.get("XDG_RUNTIME_DIR") and usual.is_dir():
        environment["XDG_RUNTIME_DIR"] = str(usual)


def _check_http(options: argparse.Namespace, token: str) -> None:
    """Raise UsageError for an address or a token with which the bridge may not serve HTTP."""
    from taskrpc.spi import is_loopback, split_address

    address = options.http
    host, _ = split_address(address)
    problem = ""
    if not is_loopback(host):
        problem = (
            f"--http: expected an address of this machine such as 127.0.0.1:8765, got {address}"
        )
    elif not token:
        problem = "--http needs --token-file FILE, with a random text that only you can read"
    elif len(token) < _SHORTEST_TOKEN:
        problem = (
            f"expected at least {_SHORTEST_TOKEN} characters in {options.token_file}, because other"
            f" users of this machine can try to guess the token; got {len(token)}"
        )
    if problem:
        raise UsageError(f"taskrpc bridge mcp: error: {problem}")


async def _serve(options: argparse.Namespace, permissions: Permissions, token: str) -> int:
    """Serve until the client has left or the process gets a signal."""
    import asyncio

    from taskrpc.bridges.mcp.server import AgentServer
    from taskrpc.bridges.mcp.serving import HttpServer, serve_stdio
    from taskrpc.node import Node
    from taskrpc.program import stop_requested
    from taskrpc.spi import split_address

    async with stop_requested() as stopped, Node(_NAME, namespace="/") as node:
        agent = AgentServer(node, permissions, options.map)
        http: HttpServer | None = None
        if options.http:
            http = HttpServer(agent.server, *split_address(options.http), token)
            serving = asyncio.create_task(http.serve())
        else:
            serving = asyncio.create_task(serve_stdio(agent.server))
        where = "standard input and output" if http is None else http.url
        print(f"taskrpc bridge ready: MCP at {where}", file=sys.stderr, flush=True)
        rights = f"The agent may do what {options.policy} permits {options.name}"
        print(rights if options.policy else _RIGHTS, file=sys.stderr, flush=True)
        tune_for_long_run()
        ends: list[asyncio.Future[Any]] = [stopped, serving]
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        await agent.close()
        if http is not None:
            http.end()
        elif stopped.done():
            serving.cancel()
        await asyncio.wait([serving])
        if not stopped.done():
            serving.result()  # raises the error with which it ended
    return exit_after(stopped.result()) if stopped.done() else Exit.DONE


_RIGHTS = "The agent may call every service and action, and read every topic, as you may"
