"""`taskrpc router`: a Zenoh router, for programs with `transport="zenoh"`."""

from __future__ import annotations

import argparse
import sys

from taskrpc.cli.shared.command import exit_after, tune_for_long_run
from taskrpc.errors import TaskRpcError

_ADDRESS = "127.0.0.1:7447"


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of the router."""
    what = f"The address for programs and other routers, also tcp/HOST:PORT (default: {_ADDRESS})"
    parser.add_argument("--listen", metavar="HOST:PORT", default=_ADDRESS, help=what)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    try:
        import zenoh  # noqa: F401
    except ModuleNotFoundError:
        from taskrpc.spi import install_command

        command = install_command("zenoh", "eclipse-zenoh")
        problem = f"taskrpc router needs eclipse-zenoh: {command}"
        raise TaskRpcError(problem) from None
    from taskrpc.program import run

    return exit_after(run(_serve(options.listen)))


async def _serve(listen: str) -> int:
    """Serve until the process gets a signal; returns the signal's number."""
    from taskrpc.middleware.zenoh.configuration import is_loopback, locator, router_configuration
    from taskrpc.middleware.zenoh.session import open_session
    from taskrpc.program import stop_requested

    address = locator(listen)
    async with stop_requested() as stopped:
        with open_session(router_configuration(address)):
            if not is_loopback(address):
                _say("warning: every machine that reaches this address can call all services that")
                _say("         need no token; Zenoh's own TLS and access control can restrict it")
            _say(f"taskrpc router ready: Zenoh at {address}")
            tune_for_long_run()
            return await stopped


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
