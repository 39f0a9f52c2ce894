"""`taskrpc bridge`: gateways to programs that do not use taskrpc."""

from __future__ import annotations

import argparse
import hmac
import os
import sys

from taskrpc.cli.network.bridge import mcp, robot
from taskrpc.cli.shared import remote
from taskrpc.cli.shared.command import exit_after, tune_for_long_run
from taskrpc.cli.shared.parsing import add_allow_origin, add_command, add_group
from taskrpc.errors import TaskRpcError

_ADDRESS = "127.0.0.1:9090"
_INFO = "This address speaks rosbridge v2: connect to it with a WebSocket, as roslib does.\n"
_NAME = "rosbridge_websocket"
"""The name of the node, as in rosbridge_suite."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the command of each gateway to a parser."""
    commands = add_group(parser)
    ros = add_command(commands, "ros", "Let machines without ROS call the services of a robot")
    robot.configure(ros)
    what = "Give an agent, such as an assistant, the services, actions and topics as tools (MCP)"
    mcp.configure(add_command(commands, "mcp", what))
    rosbridge = add_command(
        commands, "rosbridge", "Start a gateway for rosbridge clients, such as roslib in a browser"
    )
    add = rosbridge.add_argument
    what = f"The address for WebSockets (default: {_ADDRESS})"
    add("--listen", metavar="HOST:PORT", type=remote.address, default=_ADDRESS, help=what)
    add_allow_origin(rosbridge)
    add("--token-file", metavar="FILE", help="A file with the token that other machines must send")
    add("--tls-cert", metavar="FILE", help="The certificate of this gateway (PEM)")
    add("--tls-key", metavar="FILE", help="Its key (PEM)")
    rosbridge.set_defaults(run=_rosbridge, connect=None, tls_ca=None)


def _rosbridge(options: argparse.Namespace) -> int:
    try:
        import aiohttp  # noqa: F401
    except ModuleNotFoundError:
        problem = "taskrpc bridge rosbridge needs aiohttp: pip install aiohttp"
        raise TaskRpcError(problem) from None
    access = remote.remote_of(options)
    token = access.token or os.environ.get("TASKRPC_TOKEN") or ""
    from taskrpc.program import run

    return exit_after(run(_serve(options, access, token)))


async def _serve(options: argparse.Namespace, access: remote.Remote, token: str) -> int:
    """Serve until the process gets a signal; returns the signal's number."""
    from taskrpc.bridges.rosbridge.server import RosbridgeServer
    from taskrpc.node import Node
    from taskrpc.observe.web import Page
    from taskrpc.observe.web.server import WebServer
    from taskrpc.program import stop_requested

    async def info() -> Page:
        return Page(_INFO)

    def may_connect(given: str) -> bool:
        return hmac.compare_digest(given.encode(errors="replace"), token.encode())

    async with stop_requested() as stopped, Node(_NAME, namespace="/") as node:
        server = RosbridgeServer(node)
        web = WebServer(
            {"/": info},
            listen=options.listen,
            tls=access.tls,
            may_look=may_connect if token else None,
            upgrade=server.handle,
            origins=options.allow_origin,
        )
        async with web:
            address = web.url.replace("http", "ws", 1)
            print(f"taskrpc bridge ready: rosbridge at {address}", file=sys.stderr, flush=True)
            tune_for_long_run()
            number = await stopped
            await server.close()
    return number
