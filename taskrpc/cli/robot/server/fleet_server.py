"""`taskrpc-server --db postgresql://…`: a server of a fleet."""

from __future__ import annotations

import argparse
import logging
import platform
import re
from typing import TYPE_CHECKING

from taskrpc.cli.shared.command import UsageError
from taskrpc.cli.shared.task_database import is_shared, mistyped

if TYPE_CHECKING:
    from taskrpc.node import Node
    from taskrpc.robot.fleet import FleetServer, FleetStore
    from taskrpc.robot.protocol import Robot
    from taskrpc.robot.tasks import History

log = logging.getLogger("taskrpc.fleet")

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}", re.ASCII)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Give the parser of `taskrpc-server` the options of a fleet."""
    add = parser.add_argument
    what = "The robot's name in a fleet (default: the name of this machine)"
    add("--robot-name", metavar="NAME", help=what)
    what = "What the robot may do in a fleet, such as move,scan:area_* (default: everything)"
    add("--capabilities", metavar="LIST", help=what)


def is_fleet(options: argparse.Namespace) -> bool:
    """Return whether `--db` names a database that several servers share."""
    return bool(options.db) and is_shared(options.db)


def check(options: argparse.Namespace) -> None:
    """Check how the options fit together. Raises UsageError."""
    if not is_fleet(options):
        if problem := mistyped(options.db or ""):
            raise _usage(problem)
        for name, value in (
            ("--robot-name", options.robot_name),
            ("--capabilities", options.capabilities),
        ):
            if value is not None:
                raise _usage(f"{name} is for a fleet; it needs --db postgresql://…")
        return
    if options.standby:
        raise _usage(
            "--standby waits for another server of one database file; the servers of a fleet run"
            " at the same time"
        )
    if options.namespace != "/" or options.robots > 1:
        raise _usage("--namespace and --robots are for single servers: a fleet names its robots")
    if options.join:
        raise _usage("--join is for single servers: the servers of a fleet need no option to join")
    if options.record:
        raise _usage("--record records one robot's queue; a fleet cannot be recorded")
    if options.robot_name is not None and not _NAME.fullmatch(options.robot_name):
        raise _usage(
            "--robot-name: expected up to 63 letters, digits and underscores, beginning with a"
            f" letter, got {options.robot_name!r}"
        )
    if options.capabilities is not None:
        from taskrpc.robot.fleet.model import Capabilities

        try:
            if not options.capabilities.strip():
                raise ValueError("expected a list such as move,scan:area_*; got nothing")
            Capabilities(options.capabilities)
        except ValueError as error:
            raise _usage(f"--capabilities: {error}") from None


def store_of(options: argparse.Namespace, history: History) -> FleetStore:
    """Return the store of `--db`. Raises TaskRpcError for a wrong URL, and without psycopg."""
    # First the module that explains how to install psycopg.
    from taskrpc.robot.fleet.postgres import connection  # noqa: F401
    from taskrpc.robot.fleet.postgres.store import PostgresStore

    # psycopg warns about each lost connection with an object's address; the fleet says why.
    logging.getLogger("psycopg").setLevel(logging.ERROR)
    store = PostgresStore(options.db, history=history)
    if store.url.has_password:
        log.warning(
            "other users of this machine can read the password in --db;"
            " put it into PGPASSWORD or ~/.pgpass instead"
        )
    return store


def make_server(
    options: argparse.Namespace, node: Node, robot: Robot, store: FleetStore
) -> FleetServer:
    """Return the server of a fleet that these options describe."""
    from taskrpc.robot.fleet import FleetServer, FleetSettings

    settings = FleetSettings(
        name=options.robot_name or default_name(),
        capabilities=options.capabilities or "",
        queue_limit=options.queue_limit,
        share=options.share,
        settle=options.settle,
    )
    return FleetServer(node, robot, store, settings, introspection=options.introspection)


def default_name() -> str:
    """Return a robot's name made from this machine's name."""
    name = re.sub(r"\W+", "_", platform.node(), flags=re.ASCII).strip("_")
    return name if _NAME.fullmatch(name) else f"robot_{name}"[:63].rstrip("_")


def _usage(problem: str) -> UsageError:
    return UsageError(f"taskrpc-server: error: {problem}")
