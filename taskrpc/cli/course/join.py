"""`taskrpc join`: let every taskrpc program of this user call a lab's server."""

from __future__ import annotations

import argparse
import time

from taskrpc.cli.shared.command import Exit, NotFound, UsageError, standard_input
from taskrpc.spi import Lab, forget_lab, remember_lab, remembered_lab

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from taskrpc.spi import Listing

_NEXT = """\
Try next:
  taskrpc service list
  {}
  {}
`taskrpc join --leave` forgets the lab."""
_WITH_TASKS = (
    "taskrpc-call {robot} task_type=move target=station_1 priority=5",
    "taskrpc task list",
)
_WITHOUT_TASKS = "taskrpc service type NAME", "taskrpc topic list"
"""For a gateway to a robot: which calls are harmless is not known here."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of `join`."""
    what = "The join string that the lecturer gave you; - reads it from standard input"
    parser.add_argument("join_string", nargs="?", metavar="STRING", help=what)
    what = "Print which lab you have joined, and whether its server answers"
    parser.add_argument("--status", action="store_true", help=what)
    parser.add_argument("--leave", action="store_true", help="Forget the lab that you have joined")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> Exit:
    if [options.status, options.leave, bool(options.join_string)].count(True) != 1:
        raise UsageError("taskrpc join: error: expected a join string, --status or --leave")
    if options.join_string:
        return _join(options.join_string)
    return _status() if options.status else _leave()


def _join(text: str) -> Exit:
    from taskrpc.course.classroom.invitation import from_join_string
    from taskrpc.course.classroom.joining import find_lab

    # All users of the machine can see a command line, so the secret may also come from stdin.
    lab = find_lab(from_join_string(standard_input() if text == "-" else text))
    listing = _listing(lab)
    remember_lab(lab)
    print(f"You have joined the lab at {lab.address} as {_account(lab)}{_until(lab)}.")
    print(_offers(lab, listing))
    print(*_health(lab), sep="\n")
    if lab.namespace != "/":
        print(f"Your own services are in {lab.namespace}: `greet` is {lab.namespace}/greet.")
    _warn_of_peers()
    from taskrpc.cli.shared.robots import task_service

    service = task_service(lab.robot_namespace)
    if lab.robot_namespace != "/":
        print(f"Your robot is {service}; `robot_task` means it too.")
    has_tasks = any(each.name == service for each in listing.services)
    examples = _WITH_TASKS if has_tasks else _WITHOUT_TASKS
    print(_NEXT.format(*(each.format(robot=service) for each in examples)))
    return Exit.DONE


def _health(lab: Lab) -> list[str]:
    """Call the server's health services; this first call also enters the student in the roster."""
    import asyncio

    from taskrpc.cli.ros.doctor import checks
    from taskrpc.cli.shared.remote import Remote

    async def call() -> list[str]:
        return [finding.text async for finding in checks.check_health(Remote(lab.address))]

    return asyncio.run(call())


def _status() -> Exit:
    lab = remembered_lab()
    if lab is None:
        raise NotFound("you have not joined a lab: `taskrpc join STRING` joins one")
    print(f"joined: the lab at {lab.address} as {_account(lab)}{_until(lab)}")
    print(f"namespace: {lab.namespace}")
    print(_offers(lab, _listing(lab)))
    _warn_of_peers()
    return Exit.DONE


def _leave() -> Exit:
    if not forget_lab():
        raise NotFound("you have not joined a lab")
    print("You have left the lab: your programs call those of this machine again.")
    return Exit.DONE


def _listing(lab: Lab) -> Listing:
    from taskrpc.course.classroom.joining import visit_now

    return visit_now(lab)


def _warn_of_peers() -> None:
    from taskrpc.spi import environment_peers

    if peers := environment_peers():
        listed = ", ".join(peers)
        print(f"TASKRPC_PEERS is set: programs call {listed} instead, until it is unset.")


def _account(lab: Lab) -> str:
    return lab.token.partition(".")[0]


def _until(lab: Lab) -> str:
    if not lab.expires:
        return ""
    return time.strftime(", until %Y-%m-%d", time.localtime(lab.expires))


def _offers(lab: Lab, listing: Listing) -> str:
    from taskrpc.spi import names

    found = sorted(each.name for each in listing.services if not names.is_hidden(each.name))
    shown = ", ".join(found[:3]) + (f" and {len(found) - 3} more" if len(found) > 3 else "")
    return f"Its server offers {shown or 'nothing yet'}."
