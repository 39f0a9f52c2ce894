"""Several robots: which one this user's commands mean, and the options of a server with several."""

from __future__ import annotations

import argparse
from pathlib import Path

from taskrpc.cli.shared.command import UsageError
from taskrpc.cli.shared.remote import called_lab
from taskrpc.spi import Registry, domain_id, robot_namespace

_SINGLE = {
    "record": "--record records one robot",
    "standby": "--standby waits for the server of one robot",
    "robot": "--robot drives one robot of your own: start one server for each, with --namespace",
}
"""Options that belong to one robot, and why."""


def task_service(namespace: str) -> str:
    """Return the name of the service that accepts the tasks of a robot."""
    return f"{namespace.rstrip('/')}/robot_task"


def own_task_service() -> str:
    """Return the service of this user's robot: that of the joined lab, else `/robot_task`.

    As for all services, programs of this machine come before the lab. Raises TaskRpcError if the
    lab's file is invalid.
    """
    lab = called_lab()
    if lab is None or lab.robot_namespace == "/":
        return task_service("/")
    is_here = any(each.offers(task_service("/")) for each in Registry(domain_id()).entries())
    return task_service("/" if is_here else lab.robot_namespace)


def for_each_robot(options: argparse.Namespace) -> list[argparse.Namespace]:
    """Return the options of each robot's server.

    The first robot has the namespace of `--namespace`, the others have `/robot2`, `/robot3` and so
    on, each with a map, a database and a page of its own. Raises UsageError.
    """
    maps = options.map or [None]
    if len(maps) > options.robots:
        problem = f"{len(maps)} maps for {_count(options.robots)}: give one --map for each robot"
        raise _usage(problem)
    if options.robots == 1:
        return [_changed(options, map=maps[0])]
    for name, why in _SINGLE.items():
        if getattr(options, name):
            raise _usage(f"--robots {options.robots}: {why}")
    if options.namespace != "/":
        raise _usage("--robots names the namespaces itself: use it without --namespace")
    found = []
    for number in range(1, options.robots + 1):
        namespace = robot_namespace(number)
        one = _changed(
            options,
            namespace=namespace,
            map=maps[min(number, len(maps)) - 1],
            web=_later_port(options.web, number - 1),
            db=_own_file(options.db, namespace),
        )
        found.append(one)
    return found


def _changed(options: argparse.Namespace, **values: object) -> argparse.Namespace:
    return argparse.Namespace(**{**vars(options), **values})


def _later_port(address: str | None, steps: int) -> str | None:
    """Return the address with a later port; port 0, a free one, stays."""
    if not address:
        return address
    host, _, port = address.rpartition(":")
    return address if int(port) == 0 else f"{host}:{int(port) + steps}"


def _own_file(given: str | None, namespace: str) -> str | None:
    """Return the database of a robot, "tasks_robot2.db" for "tasks.db"."""
    if given is None or given == ":memory:" or namespace == "/":
        return given
    path = Path(given)
    return str(path.with_name(f"{path.stem}{suffix_of(namespace)}{path.suffix}"))


def suffix_of(namespace: str) -> str:
    """Return what distinguishes the files of a namespace: "" for `/`, `_robot2` for `/robot2`."""
    return namespace.rstrip("/").replace("/", "_")


def _count(robots: int) -> str:
    return "1 robot" if robots == 1 else f"{robots} robots"


def _usage(problem: str) -> UsageError:
    return UsageError(f"taskrpc-server: error: {problem}")
