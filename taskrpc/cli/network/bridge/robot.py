"""`taskrpc bridge ros`: the gateway between a robot with ROS 2 and laptops without it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from taskrpc.cli.shared import remote
from taskrpc.cli.shared.command import UsageError, exit_after, tune_for_long_run
from taskrpc.cli.shared.parsing import number, whole

if TYPE_CHECKING:
    from taskrpc.bridges.gateway import Gateway

_GATEWAY = "taskrpc_gateway"
"""The name of its two nodes: one on the robot, one for the laptops."""
_LOOKS, _PAUSE = 15, 0.2
"""How often, and after how many seconds, it looks for allowed names before it reports: DDS finds
some programs late."""


def configure(ros: argparse.ArgumentParser) -> None:
    """Add the arguments of `taskrpc bridge ros` to its parser."""
    add = ros.add_argument
    what = "The address for calls (default: 127.0.0.1:0)"
    add("--listen", metavar="HOST:PORT", type=remote.any_address, help=what)
    what = "Let callers use the services of this name, such as '/arm/*'; may be given several times"
    add("--allow", metavar="NAME", type=_name, action="append", default=[], help=what)
    what = "Let callers subscribe to the topics of this name; may be given several times"
    add("--allow-topic", metavar="NAME", type=_name, action="append", default=[], help=what)
    what = "The most calls per second of one account (default: 20)"
    above = number("above 0", lambda value: value > 0)
    add("--rate", metavar="N", type=above, default=20.0, help=what)
    what = "The most calls of one account without a response (default: 4)"
    add("--in-flight", metavar="N", type=whole(1), default=4, help=what)
    what = "The most seconds that a call to the robot may take (default: 10)"
    add("--timeout", metavar="S", type=above, default=10.0, help=what)
    add("--token-file", metavar="FILE", help="A file with the token that callers must present")
    what = "A TOML or JSON file of users that may call, with their roles; see taskrpc classroom"
    add("--accounts", metavar="FILE", help=what)
    add("--tls-cert", metavar="FILE", help="The certificate of this gateway (PEM)")
    add("--tls-key", metavar="FILE", help="Its key (PEM)")
    what = "Callers need a certificate that this authority signed (PEM)"
    add("--tls-ca", metavar="FILE", help=what)
    # For robots on another middleware than ROS, and for tests.
    add("--transport", default="ros", help=argparse.SUPPRESS)
    ros.set_defaults(run=_ros, connect=None)


def _name(text: str) -> str:
    """Return a name that may have `*` and `?`. Raises argparse's ArgumentTypeError."""
    from taskrpc.bridges.gateway import Allowed  # imports much, so only this command does

    try:
        Allowed([text])
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def _ros(options: argparse.Namespace) -> int:
    if not options.allow and not options.allow_topic:
        problem = "expected --allow NAME or --allow-topic NAME: otherwise callers can use nothing"
        raise UsageError(f"taskrpc bridge ros: error: {problem}; --allow '*' allows all services")
    from taskrpc.program import run

    return exit_after(run(serve(options, remote.remote_of(options))))


async def serve(options: argparse.Namespace, access: remote.Remote) -> int:
    """Serve until the process gets a signal; returns the signal's number."""
    import asyncio

    import srvgen
    from taskrpc import Role
    from taskrpc.bridges.gateway import AccountLimits, Allowed, Gateway
    from taskrpc.node import Node
    from taskrpc.program import stop_requested

    robot = Node(_GATEWAY, namespace="/", transport=options.transport)
    lab = Node(
        _GATEWAY,
        namespace="/",  # callers use the names of the robot
        listen=options.listen,
        tls=access.tls,
        token=access.token,
        accounts=options.accounts,
    )
    async with stop_requested() as stopped, robot, lab:
        gateway = Gateway(
            robot,
            lab,
            services=Allowed(options.allow),
            topics=Allowed(options.allow_topic),
            limits=AccountLimits(options.rate, options.in_flight),
            timeout=options.timeout,
        )
        trigger = srvgen.load("std_srvs/srv/Trigger")

        def health(_: Any, response: Any) -> Any:
            response.success = bool(gateway.names)
            response.message = f"{_count(gateway.names, 'service')} of the robot"
            return response

        lab.create_service(trigger, "~/health", health, role=Role.OBSERVE)
        for _ in range(_LOOKS):
            await gateway.update()
            if not gateway.unused or stopped.done():
                break
            await asyncio.sleep(_PAUSE)
        _announce(gateway, lab.address, options.transport)
        tune_for_long_run()
        following = asyncio.create_task(gateway.follow())
        following.add_done_callback(lambda _: stopped.cancel())  # `follow` ends only after a bug
        try:
            number = await stopped
        except asyncio.CancelledError:
            following.result()
            raise
        following.cancel()
        if calls := gateway.calls_in_flight:
            text = (
                f"{calls} in flight, at most {options.timeout:g} s; a second signal does not wait"
            )
            print(f"taskrpc bridge: waiting for calls: {text}", file=sys.stderr, flush=True)
        await lab.drain(options.timeout)
        gateway.close()
    return number


def _announce(gateway: Gateway, address: str, transport: str) -> None:
    """Print what callers can use, and each `--allow` that fits nothing yet."""
    found = f"{_count(gateway.names, 'service')} and {_count(gateway.topic_names, 'topic')}"
    print(f"taskrpc bridge ready: {found} of the robot at {address}", file=sys.stderr)
    for pattern in gateway.unused:
        problem = f"taskrpc bridge: the robot has nothing yet that {pattern!r} allows"
        lists = f"`taskrpc service list --transport {transport}`, or topic list"
        print(f"{problem}; see what it has: {lists}", file=sys.stderr)
    sys.stderr.flush()


def _count(names: Sequence[str], what: str) -> str:
    return f"{len(names)} {what}{'' if len(names) == 1 else 's'}"
