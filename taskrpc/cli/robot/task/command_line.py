"""`taskrpc task`: the services of the task server, from a command line."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from taskrpc.cli.shared.command import Exit, OutputLost, UsageError
from taskrpc.cli.shared.parsing import Parser, add_command, add_group, number

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace
    from collections.abc import Awaitable, Callable
    from typing import TypeAlias

    from taskrpc.cli.robot.task.task_services import TaskServices
    from taskrpc.cli.shared.parsing import Commands

    Action: TypeAlias = Callable[[Namespace, TaskServices], Awaitable[Exit]]

_SECONDS = number("greater than zero", lambda value: value > 0)
_ORDERS = (
    ("cancel", "Cancel tasks, also a running one: the robot halts"),
    (
        "requeue",
        "Queue interrupted, failed or cancelled tasks again, behind others of their priority",
    ),
    ("drop", "Cancel queued or interrupted tasks, but never a running one"),
)
_HALTS = (
    ("pause", "Halt the robot during its task and start no other task; in a fleet: all robots"),
    (
        "stop",
        "Halt the robot at once and pause the queue; in a fleet: all robots"
        " (no emergency stop: this is software)",
    ),
)
_SPELLINGS = (
    ("reprioritise", "Move a queued task to another priority"),
    ("reprioritize", "The American spelling of reprioritise"),
)


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc task` its commands."""
    commands = add_group(parser)
    _add_submit(commands)
    _add_views(commands)
    _add_export(commands)
    for verb, purpose in _ORDERS:
        command = _add(commands, verb, purpose, _order)
        command.add_argument("task_ids", metavar="ID", type=int, nargs="+", help="A task's number")
        command.set_defaults(verb=verb)
    for verb, purpose in _HALTS:
        command = _add(commands, verb, purpose, _halt)
        what = f"{verb.capitalize()} only this robot of a fleet (default: all robots)"
        _add_robot(command, what)
        command.set_defaults(verb=verb)
    what = "Continue after a pause or a stop; with IDs, queue interrupted tasks again"
    command = _add(commands, "resume", what, _resume)
    what = "Continue only this robot; without it, robots that were paused by name stay paused"
    _add_robot(command, what)
    what = "An interrupted task; it gets its old place in the queue"
    command.add_argument("task_ids", metavar="ID", type=int, nargs="*", help=what)
    for verb, purpose in _SPELLINGS:
        command = _add(commands, verb, purpose, _reprioritise)
        command.add_argument("task_id", metavar="ID", type=int, help="The task's number")
        command.add_argument("priority", metavar="PRIORITY", type=int, help="1 to 10, 10 first")


def _add_submit(commands: Commands) -> None:
    command = _add(commands, "submit", "Queue a task", _submit)
    add = command.add_argument
    add(
        "task_type",
        metavar="TYPE",
        help="Type of the task: move, scan or report; your own robot may have more",
    )
    add("target", metavar="TARGET", help="A place on the map, or x,y in metres")
    what = "Priority, 1 to 10; 10 runs first (default: 5)"
    add("priority", metavar="PRIORITY", type=int, nargs="?", default=5, help=what)
    what = "Follow the task to its end; exit code 0 if it SUCCEEDED, else 1"
    add("--wait", action="store_true", help=what)


def _add_robot(command: Parser, what: str) -> None:
    command.add_argument("--robot", metavar="NAME", default="", help=what)


def _add_views(commands: Commands) -> None:
    command = _add(commands, "list", "List the tasks in the order in which they run", _list)
    command.add_argument("--all", action="store_true", help="List ended tasks too")
    command = _add(commands, "show", "Show a task with its result and its estimate", _show)
    command.add_argument("task_id", metavar="ID", type=int, help="The task's number")
    command = _add(commands, "watch", "Print a line for each change, until Ctrl-C", _watch)
    what = "Only this task (default: all tasks)"
    command.add_argument("task_id", metavar="ID", type=int, nargs="?", default=0, help=what)


def _add_export(commands: Commands) -> None:
    what = "Write all ended tasks of a database, the oldest first; the server may run meanwhile"
    command = add_command(commands, "export", what)
    add = command.add_argument
    what = "The database of the server or of the fleet (default: that of a server without --db)"
    add("--db", metavar="FILE|URL", type=_database, help=what)
    what = "Only tasks that ended since then: 2026-11-29T08:00 in UTC, or 12h or 7d ago"
    add("--since", metavar="T", type=_instant, help=what)
    kind = command.add_mutually_exclusive_group()
    kind.add_argument("--csv", action="store_true", help="Write CSV with a heading (the default)")
    kind.add_argument("--jsonl", action="store_true", help="Write a JSON object a line")
    command.set_defaults(run=_export)


def _database(text: str) -> str:
    """Return a valid `--db`. Raises argparse's ArgumentTypeError."""
    from argparse import ArgumentTypeError

    from taskrpc.cli.shared.task_database import mistyped

    if problem := mistyped(text):
        raise ArgumentTypeError(problem.removeprefix("--db: "))
    return text


def _instant(text: str) -> float:
    """Return an instant as seconds since 1970. Raises argparse's ArgumentTypeError."""
    import re
    from argparse import ArgumentTypeError
    from datetime import UTC, datetime

    from taskrpc.spi import time_of_day

    if match := re.fullmatch(r"(\d{1,6})([mhd])", text, re.ASCII):
        return time_of_day() - int(match[1]) * {"m": 60.0, "h": 3600.0, "d": 86400.0}[match[2]]
    try:
        at = datetime.fromisoformat(text)
    except ValueError:
        rule = "a time such as 2026-11-29 or 2026-11-29T08:00+01:00, or 30m, 12h or 7d"
        raise ArgumentTypeError(f"expected {rule}, got {text!r}") from None
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _export(options: Namespace) -> Exit:
    import asyncio

    from taskrpc.cli.robot.task.export import export

    since = options.since or 0.0
    asyncio.run(export(options.db, since, as_csv=not options.jsonl, write=_write))
    return Exit.DONE


def _write(text: str) -> None:
    print(text, end="", flush=True)


def _add(commands: Commands, verb: str, purpose: str, action: Action) -> Parser:
    from taskrpc.cli.shared.remote import add_connect

    command = add_command(commands, verb, purpose)
    command.mixed = True
    add = command.add_argument
    what = "The service of the task server (default: /robot_task, or that of your robot in a lab)"
    add("--service", metavar="NAME", help=what)
    what = "Seconds for one call, including the wait for the server (default: 10)"
    add("--timeout", metavar="S", type=_SECONDS, default=10.0, help=what)
    add("--json", action="store_true", help="Print JSON")
    add_connect(command)
    command.set_defaults(run=_run, action=action)
    return command


def _run(options: Namespace) -> Exit:
    import asyncio

    if getattr(options, "robot", "") and getattr(options, "task_ids", ()):
        raise UsageError("taskrpc task resume: error: give either IDs of tasks or --robot NAME")
    return asyncio.run(perform(options))


async def perform(options: Namespace) -> Exit:
    """Connect to the task server and perform the command.

    Raises TaskRefused, NotFound, TypeMismatch, ServiceUnavailable and the other errors of calls.
    """
    from taskrpc.cli.robot.task.task_services import TaskServices
    from taskrpc.cli.shared.remote import remote_of
    from taskrpc.cli.shared.robots import own_task_service

    remote, service = remote_of(options), options.service or own_task_service()
    async with remote.node() as node:
        services = TaskServices(
            node,
            service,
            timeout=options.timeout,
            remote=remote,
            note=(lambda _: None) if options.json else _note,
        )
        await services.reach()
        action: Action = options.action
        return await action(options, services)


# The actions


async def _submit(options: Namespace, services: TaskServices) -> Exit:
    response = await services.submit(options.task_type, options.target, options.priority)
    task_id = response.task_id
    if not options.wait:
        message = f"{response.message} (task {task_id}, done in {response.estimated_time:.1f} s)"
        done = f"task {task_id} was submitted"
        _report(_as_json(response) if options.json else message, done)
        return Exit.DONE
    return await _wait(task_id, options, services)


async def _wait(task_id: int, options: Namespace, services: TaskServices) -> Exit:
    """Follow a task to its end."""
    import asyncio

    from taskrpc.cli.robot.task.view import status_line, whole_object

    try:
        await _follow_to_end(task_id, services)
    except asyncio.CancelledError:
        _note(f"task {task_id} continues; to cancel it: taskrpc task cancel {task_id}")
        raise
    task = await services.show(task_id)
    line = status_line(task)
    _report(whole_object(task) if options.json else line, line)
    return Exit.DONE if task.state == task.SUCCEEDED else Exit.ERROR


async def _follow_to_end(task_id: int, services: TaskServices) -> None:
    from taskrpc.cli.robot.task.progress import progress

    with progress() as display:
        async for update in services.follow(task_id, seconds=1.0, persist=False):
            for task in update.tasks:
                display.show(task, paused=update.paused)
                if task.ended.sec:
                    return


async def _list(options: Namespace, services: TaskServices) -> Exit:
    from taskrpc.cli.robot.task.view import as_object, table

    tasks = await services.tasks(ended=options.all)
    if options.json:
        _print([as_object(task) for task in tasks])
        return Exit.DONE
    for line in table(tasks):
        print(line)
    if not tasks:
        _note("no task runs or waits" + ("" if options.all else "; --all lists those that ended"))
    return Exit.DONE


async def _show(options: Namespace, services: TaskServices) -> Exit:
    from taskrpc.cli.robot.task.view import details, whole_object

    task = await services.show(options.task_id)
    _print(whole_object(task) if options.json else "\n".join(details(task)))
    return Exit.DONE


async def _watch(options: Namespace, services: TaskServices) -> Exit:
    from taskrpc.cli.robot.task.progress import ChangePrinter

    printer = ChangePrinter(as_json=options.json)
    async for update in services.follow(options.task_id):
        printer.show(update)
    return Exit.DONE


async def _order(options: Namespace, services: TaskServices) -> Exit:
    """Cancel, requeue or drop each of the tasks."""
    return await _request_each(f"/{options.verb}", options, services)


async def _resume(options: Namespace, services: TaskServices) -> Exit:
    if options.task_ids:
        return await _request_each("/requeue", options, services, resume=True)
    _print_response(await services.request("/resume", robot=options.robot), options)
    return Exit.DONE


async def _request_each(
    verb: str, options: Namespace, services: TaskServices, **fields: object
) -> Exit:
    """Call a service for each of the tasks, even if it refuses some of them.

    Raises TaskRefused or OutputLost at the end.
    """
    from taskrpc.cli.robot.task.task_services import TaskRefused

    failures: list[TaskRefused | OutputLost] = []
    for task_id in options.task_ids:
        try:
            _print_response(await services.request(verb, task_id=task_id, **fields), options)
        except (TaskRefused, OutputLost) as failure:
            failures.append(failure)
    if failures:
        raise type(failures[0])("\n".join(map(str, failures)))
    return Exit.DONE


async def _halt(options: Namespace, services: TaskServices) -> Exit:
    _print_response(await services.request(f"/{options.verb}", robot=options.robot), options)
    return Exit.DONE


async def _reprioritise(options: Namespace, services: TaskServices) -> Exit:
    fields = {"task_id": options.task_id, "priority": options.priority}
    _print_response(await services.request("/reprioritise", **fields), options)
    return Exit.DONE


# Output


def _print_response(response: Any, options: Namespace) -> None:
    seconds = getattr(response, "estimated_time", 0.0)
    estimate = f" (done in {seconds:.1f} s)" if seconds else ""
    text = _as_json(response) if options.json else response.message + estimate
    _report(text, response.message)


def _as_json(response: Any) -> Any:
    from srvgen import to_builtins

    return to_builtins(response)


def _print(value: Any) -> None:
    """Print a text, or any other value as one line of JSON."""
    import json

    print(value if isinstance(value, str) else json.dumps(value), flush=True)


def _report(value: Any, done: str) -> None:
    """Print a result. Raises OutputLost with the text `done` if it cannot be printed."""
    try:
        _print(value)
    except BrokenPipeError:
        return  # the reader of the output stopped early; `guarded` ends the command for it
    except OSError as error:
        problem = f"cannot write to standard output: {error.strerror}"
        raise OutputLost(f"{done}, but {problem}") from None


def _note(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
