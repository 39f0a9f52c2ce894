"""`taskrpc-server`: the lecture's task server, with a simulated robot or one's own."""

from __future__ import annotations

import argparse
import asyncio
import importlib
import inspect
import logging
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taskrpc import platform
from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from taskrpc.node import Node
    from taskrpc.robot.protocol import Robot
    from taskrpc.tasks import TaskServer
    from taskrpc.tasks.store import TaskStore
    from taskrpc.transport.tls import Tls

DRAIN_GRACE = 1.0
"""Seconds that calls in flight get when the server is told to end."""

_LOG_FORMAT = "[%(levelname)s] [%(created).9f] [%(name)s]: %(message)s"
_ROBOT_MEMBERS = "speed task_types plan pose execute remaining pause resume stop".split()


def main(argv: list[str] | None = None) -> int:
    """Run the task server until it is told to end; returns the exit code."""
    platform.prepare_output()
    options = _parser().parse_args(argv)
    logging.basicConfig(level=options.log_level.upper(), format=_LOG_FORMAT)
    from taskrpc.node import run

    try:
        run(_serve(options))
    except TaskRpcError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="taskrpc-server",
        description="A robot that takes tasks: offers /robot_task and drives a simulated robot.",
        epilog="Call it: taskrpc-call /robot_task task_type=move target=warehouse priority=8",
    )
    _add_service_options(parser)
    _add_robot_options(parser)
    _add_security_options(parser)
    return parser


def _add_service_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--listen", metavar="HOST:PORT", type=_place, help="where to take calls (127.0.0.1:0)")
    add("--db", metavar="FILE", help="where tasks survive; :memory: forgets them at the end")
    add("--fresh", action="store_true", help="forget the tasks of earlier runs")
    add("--queue-limit", metavar="N", type=_at_least(1, int), default=10_000, help="(10000)")
    settle = "seconds that an idle robot waits for company before it takes a task (0.1)"
    add("--settle", metavar="S", type=_at_least(0.0, float), default=0.1, help=settle)
    add("--join", action="store_true", help="start although another server has the name")
    add("--transport", choices=["tcp"], default="tcp", help="how calls travel (tcp)")
    levels = ["debug", "info", "warning", "error"]
    add("--log-level", choices=levels, default="info", help="what to log to stderr (info)")


def _add_robot_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--map", metavar="FILE", help="the map (YAML) on which the simulated robot drives")
    speed = "simulated seconds a second (1)"
    add("--speed", metavar="X", type=_positive, default=1.0, help=speed)
    robot = "your own class in the simulated robot's place; see taskrpc.Robot"
    add("--robot", metavar="MODULE:CLASS", help=robot)


def _add_security_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--token-file", metavar="FILE", help="the secret that callers elsewhere must know")
    add("--tls-cert", metavar="FILE", help="this server's certificate (PEM)")
    add("--tls-key", metavar="FILE", help="its key (PEM)")
    add("--tls-ca", metavar="FILE", help="callers must show a certificate signed by this one")


async def _serve(options: argparse.Namespace) -> None:
    from taskrpc.node import Node, stop_requested
    from taskrpc.tasks import TaskServer

    robot = _robot(options)
    node = Node(
        "task_server",
        transport=options.transport,
        listen=options.listen,
        tls=_tls(options),
        token=_token(options),
    )
    async with stop_requested() as stopped, node:
        server = TaskServer(
            node,
            robot,
            _store(options),
            queue_limit=options.queue_limit,
            settle=options.settle,
            join=options.join,
        )
        resumed = await server.start(fresh=options.fresh)
        print(f"taskrpc-server: {resumed}", file=sys.stderr)
        _say_ready(node)
        await stopped
        await _shut_down(node, server)


def _say_ready(node: Node) -> None:
    what = "/robot_task [my_robot_interfaces/srv/RobotTask]"
    print(f"taskrpc-server ready: {what} at {node.address}", file=sys.stderr, flush=True)


async def _shut_down(node: Node, server: TaskServer) -> None:
    """No new calls; answer those in flight; then halt the robot and store what ran."""
    drained = asyncio.ensure_future(node.drain(DRAIN_GRACE))
    # Watchers wait for changes that will not come; one turn later nobody can become one any more.
    await asyncio.sleep(0)
    server.dismiss_watchers()
    await drained
    await server.close()


def _store(options: argparse.Namespace) -> TaskStore:
    from taskrpc.tasks import MemoryStore, SqliteStore

    if options.db == ":memory:":
        return MemoryStore()
    return SqliteStore(options.db or _default_file())


def _default_file() -> Path:
    from taskrpc.transport.tcp import domain_id

    domain = domain_id()
    name = f"tasks_domain_{domain}.db" if domain else "tasks.db"
    return platform.state_dir() / name


def _robot(options: argparse.Namespace) -> Robot:
    from taskrpc.robot import KinematicRobot, default_world, read_map

    world = read_map(options.map) if options.map else default_world()
    if options.robot:
        return _own_robot(options.robot, {"world": world, "speed": options.speed})
    return KinematicRobot(world, speed=options.speed)


def _own_robot(spec: str, offered: dict[str, Any]) -> Robot:
    """Make a user's robot; its constructor gets `world` and `speed` if it asks for them."""
    make = _imported(spec)
    try:
        wanted = inspect.signature(make).parameters
        robot = make(**{name: value for name, value in offered.items() if name in wanted})
    except Exception as error:
        raise TaskRpcError(f"--robot {spec}: {type(error).__name__}: {error}") from error
    missing = [name for name in _ROBOT_MEMBERS if not hasattr(robot, name)]
    if missing:
        lacking = ", ".join(missing)
        raise TaskRpcError(f"--robot {spec}: the class lacks {lacking}; see taskrpc.Robot")
    made: Robot = robot
    return made


def _imported(spec: str) -> Callable[..., Any]:
    module_name, colon, class_name = spec.partition(":")
    if not (module_name and colon and class_name):
        raise TaskRpcError(f"--robot: expected MODULE:CLASS such as my_robot:MyRobot, got {spec!r}")
    sys.path.insert(0, str(Path.cwd()))
    try:
        made: Callable[..., Any] = getattr(importlib.import_module(module_name), class_name)
    except ImportError as error:
        raise TaskRpcError(f"--robot {spec}: {error}") from error
    except AttributeError:
        raise TaskRpcError(f"--robot {spec}: {module_name} has no {class_name}") from None
    return made


def _tls(options: argparse.Namespace) -> Tls | None:
    from taskrpc.transport.tls import Tls

    if not (options.tls_cert or options.tls_key or options.tls_ca):
        return None
    return Tls(cert=options.tls_cert, key=options.tls_key, ca=options.tls_ca)


def _token(options: argparse.Namespace) -> str | None:
    if not options.token_file:
        return None
    try:
        token = Path(options.token_file).read_text().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise TaskRpcError(f"--token-file {options.token_file}: {error}") from None
    if not token:
        raise TaskRpcError(f"--token-file {options.token_file}: the file is empty")
    return token


def _place(text: str) -> str:
    from taskrpc.transport.tcp import split_place

    try:
        split_place(text)
    except TaskRpcError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def _positive(text: str) -> float:
    number = _at_least(0.0, float)(text)
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text!r}")
    return float(number)


def _at_least(least: float, kind: type[int] | type[float]) -> Callable[[str], float]:
    what = "a whole number" if kind is int else "a number"

    def convert(text: str) -> float:
        try:
            number = kind(text)
        except ValueError:
            number = kind(least - 1)
        if not least <= number < math.inf:
            raise argparse.ArgumentTypeError(f"expected {what} of at least {least:g}, got {text!r}")
        return number

    return convert


if __name__ == "__main__":
    sys.exit(main())
