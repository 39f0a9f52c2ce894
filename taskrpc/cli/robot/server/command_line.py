"""`taskrpc-server`: the lecture's task server, with a simulated robot or the user's own robot."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import importlib
import inspect
import logging
import os
import re
import sys
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from srvgen.cli import process
from taskrpc import logs
from taskrpc.cli.robot.server import fleet_server
from taskrpc.cli.shared import remote
from taskrpc.cli.shared.command import Exit, UsageError, exit_after, run_main, tune_for_long_run
from taskrpc.cli.shared.parsing import Parser, add_allow_origin, number, whole
from taskrpc.cli.shared.robots import for_each_robot, task_service
from taskrpc.cli.shared.task_database import default_database
from taskrpc.errors import InvalidName, TaskRpcError
from taskrpc.spi import names

if TYPE_CHECKING:
    from taskrpc import Observer
    from taskrpc.cli.robot.server.monitoring import Monitoring
    from taskrpc.course.classroom.attendance import Attendance
    from taskrpc.node import Node
    from taskrpc.observe.recording.run_recorder import RunRecorder
    from taskrpc.robot.fleet import FleetStore
    from taskrpc.robot.protocol import Robot
    from taskrpc.robot.tasks import History, SqliteStore
    from taskrpc.robot.tasks.records.store import TaskStore
    from taskrpc.robot.tasks.services.offered_tasks import OfferedTasks
    from taskrpc.testing import CallFaults

_Result = TypeVar("_Result")

DRAIN_GRACE = 1.0
"""Seconds that calls in flight get after SIGTERM or Ctrl-C."""

_STANDBY_TIMEOUT = 5.0
"""Seconds in which a server that has closed its database must free its addresses and names."""
_STANDBY_POLL = 0.05
"""Seconds between two attempts of a standby server to get these addresses and names."""

_DAY = 86_400.0
_ROBOT_MEMBERS = "speed task_types plan pose execute remaining pause resume stop".split()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the task server until SIGTERM or Ctrl-C; returns the exit code."""
    return run_main(_run, argv, sigterm_is_success=True)


def _run(arguments: list[str]) -> Exit:
    if "_ARGCOMPLETE" in os.environ:
        from taskrpc.cli.completion import complete

        complete(_parser())
    options = _parser().parse_args(arguments)
    if options.standby and (options.fresh or options.db == ":memory:"):
        other = "--fresh" if options.fresh else "--db :memory:"
        problem = f"--standby continues the tasks of another server; do not use it with {other}"
        raise UsageError(f"taskrpc-server: error: {problem}")
    if options.allow_origin and not options.web:
        problem = "--allow-origin is for pages that use the live page's address: give --web too"
        raise UsageError(f"taskrpc-server: error: {problem}")
    fleet_server.check(options)
    robots = for_each_robot(options)
    handler = logs.handler(options.log_format)
    logging.basicConfig(level=options.log_level.upper(), handlers=[handler])
    from taskrpc.program import run

    process.start_work()
    # Before the event loop starts: on the loop, Ctrl-C would wait until the maps are read.
    return exit_after(run(_serve_all([(each, _made_robot(each)) for each in robots])))


def _made_robot(options: argparse.Namespace) -> Callable[[], Robot]:
    """Return a function that returns the robot."""
    robot = _robot(options)
    if options.standby:  # it makes the robot later: the first server still uses the hardware
        return robot
    made = robot()
    return lambda: made


def _parser() -> Parser:
    parser = Parser(
        prog="taskrpc-server",
        description="Run the task server: offer /robot_task and drive a simulated robot",
        epilog="Call it: taskrpc-call /robot_task task_type=move target=warehouse priority=8",
    )
    _add_service_options(parser)
    _add_robot_options(parser)
    _add_security_options(parser)
    return parser


def _add_service_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    listen = "The address for calls, also unix:/path (default: 127.0.0.1:0)"
    add("--listen", metavar="HOST:PORT", type=remote.any_address, help=listen)
    remote.add_transport(parser)
    what = (
        "The database of tasks: a file, :memory: for nothing on the disk,"
        " or postgresql://… for a fleet"
    )
    add("--db", metavar="FILE|URL", help=what)
    add("--fresh", action="store_true", help="Forget the tasks of earlier runs")
    limit = "Maximum number of tasks in the queue (default: 10000)"
    add("--queue-limit", metavar="N", type=whole(1), default=10_000, help=limit)
    history = "How many ended tasks to keep, or how long, such as 30d for days (default: 1000)"
    add("--history", metavar="N|DAYS", type=_history, help=history)
    share = "Maximum number of queued tasks of one account at one machine (default: no limit)"
    add("--share", metavar="N", type=whole(1), help=share)
    attendance = "A file in which the server notes when each account last called"
    add("--attendance", metavar="FILE", help=attendance)
    # `taskrpc classroom` gives it: the folder of the class that the live page shows.
    add("--class", dest="class_folder", metavar="FOLDER", help=argparse.SUPPRESS)
    settle = (
        "Seconds that an idle robot waits for more tasks before it takes the first (default: 0.1)"
    )
    seconds = number("from 0 on", lambda seconds: seconds >= 0)
    add("--settle", metavar="S", type=seconds, default=0.1, help=settle)
    add("--join", action="store_true", help="Start even if another server offers the same services")
    standby = "Wait until the server that uses the database ends, then replace it"
    add("--standby", action="store_true", help=standby)
    events = "How much of each call `taskrpc service echo` can print (default: off)"
    add("--introspection", choices=["off", "metadata", "contents"], default="off", help=events)
    found = "When to end the connection of a silent peer: `default` (8 s) or `robot` (2 s)"
    add("--keepalive", choices=["default", "robot"], help=found)
    web = "Serve the live page, rosbridge, /health and /metrics at this HTTP address"
    add("--web", metavar="HOST:PORT", type=remote.address, help=web)
    add_allow_origin(parser)
    fault = "Inject a fault into calls, such as lose-response:first=1; may be given several times"
    add("--fault", metavar="SPEC", type=_fault, action="append", default=[], help=fault)
    record = "Record the whole run to this new MCAP file; see taskrpc bag"
    add("--record", metavar="FILE", help=record)
    levels = ["debug", "info", "warning", "error"]
    add("--log-level", choices=levels, default="info", help="What to log to stderr (default: info)")
    what = "The format of log lines: text as in ROS 2, or JSON for programs (default: text)"
    add("--log-format", choices=logs.STYLES, default="text", help=what)


def _namespace(text: str) -> str:
    """Return a valid namespace. Raises argparse's ArgumentTypeError."""
    try:
        return names.check_namespace(text)
    except InvalidName as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _history(text: str) -> History:
    """Return which ended tasks are kept. Raises argparse's ArgumentTypeError."""
    from taskrpc.robot.tasks import History

    match = re.fullmatch(r"([1-9]\d{0,8})(d?)", text, re.ASCII)
    if match is None:
        rule = "a number of tasks such as 100000, or of days such as 30d"
        raise argparse.ArgumentTypeError(f"expected {rule}, got {text!r}")
    number = int(match[1])
    return History(count=None, seconds=number * _DAY) if match[2] else History(count=number)


def _fault(spec: str) -> str:
    """Return a valid specification of a fault. Raises argparse's ArgumentTypeError."""
    from taskrpc.testing import CallFaults  # few servers inject faults

    try:
        CallFaults(spec)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return spec


def _add_robot_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    what = "The map (YAML) of the simulated robot; with --robots, give one for each robot"
    add("--map", metavar="FILE", action="append", help=what)
    what = "The namespace of the robot: /robot2 for the service /robot2/robot_task (default: /)"
    add("--namespace", metavar="NAME", type=_namespace, default="/", help=what)
    what = "How many simulated robots; each has a queue, a map and a page of its own (default: 1)"
    add("--robots", metavar="N", type=whole(1), default=1, help=what)
    speed = "Simulated seconds per second (default: 1)"
    add(
        "--speed",
        metavar="X",
        type=number("above 0", lambda speed: speed > 0),
        default=1.0,
        help=speed,
    )
    robot = "Your own robot class instead of the simulated robot; see taskrpc.Robot"
    add("--robot", metavar="MODULE:CLASS", help=robot)
    fleet_server.add_options(parser)


def _add_security_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    what = "A file with the token that callers on other machines must present"
    add("--token-file", metavar="FILE", help=what)
    what = (
        "A TOML or JSON file of users that may call, with their roles; read again when it changes"
    )
    add("--accounts", metavar="FILE", help=what)
    add("--tls-cert", metavar="FILE", help="This server's certificate (PEM)")
    add("--tls-key", metavar="FILE", help="The key of this certificate (PEM)")
    what = "Callers need a certificate that this authority signed (PEM)"
    add("--tls-ca", metavar="FILE", help=what)


async def _serve_all(robots: Sequence[tuple[argparse.Namespace, Callable[[], Robot]]]) -> int:
    """Serve each robot until the process gets a signal; returns the signal's number."""
    from taskrpc.program import stop_requested

    shared = Shared(_attendance(robots[0][0]))
    async with stop_requested() as stopped:
        servers = [
            asyncio.ensure_future(_serve(options, robot, stopped, shared))
            for options, robot in robots
        ]
        try:
            return (await asyncio.gather(*servers))[0]
        finally:
            # If one server fails, the others end as they do after a signal.
            if not stopped.done():
                stopped.set_result(0)
            await asyncio.wait(servers)


class Shared:
    """What the servers of several robots share: the students of a class.

    Args:
        attendance: when each student last called; None without a class.
    """

    def __init__(self, attendance: Attendance | None) -> None:
        self.attendance = attendance
        self.first: Monitoring | None = None
        """The page of the first robot, which counts the calls of the students."""


async def _serve(
    options: argparse.Namespace,
    robot: Callable[[], Robot],
    stopped: asyncio.Future[int],
    shared: Shared,
) -> int:
    """Serve one robot until the process gets a signal; returns the signal's number."""
    monitoring = _monitoring(options, remote.remote_of(options))
    if monitoring is not None:
        if shared.first is not None:
            monitoring.share_students(shared.first)
        shared.first = shared.first or monitoring
    recorder = _recorder(options)
    try:
        return await _serve_with(options, robot, monitoring, recorder, stopped, shared.attendance)
    finally:
        if recorder is not None:  # a server that could not start leaves no recording
            await recorder.close()


async def _serve_with(
    options: argparse.Namespace,
    robot: Callable[[], Robot],
    monitoring: Monitoring | None,
    recorder: RunRecorder | None,
    stopped: asyncio.Future[int],
    attendance: Attendance | None,
) -> int:
    from taskrpc.node import Node
    from taskrpc.robot import KinematicRobot
    from taskrpc.robot.tasks import SqliteStore, TaskServer

    access = remote.remote_of(options)
    faults = _faults(options)
    node = Node(
        "task_server",
        namespace=options.namespace,  # "/" in a lab too: clients call /robot_task
        transport=options.transport,
        listen=options.listen,
        tls=access.tls,
        token=access.token,
        accounts=options.accounts,
        keepalive=options.keepalive,
        observer=_observer(attendance, monitoring, recorder),
        faults=faults,
    )
    store = _store(options)
    async with node, contextlib.AsyncExitStack() as stack:
        started = _at_once
        if isinstance(store, SqliteStore) and options.standby:
            started = _once_free
            if not await _claimed(store, stopped, partial(_say, options)):
                return stopped.result()
        made = robot()
        if recorder is not None:
            stack.push_async_callback(recorder.close)
            if isinstance(made, KinematicRobot):
                made.keep_journal(recorder.journal)
        server = _server(options, node, made, store, monitoring, recorder)
        if monitoring is not None:  # before the start, so that monitors can watch a slow start
            pages = monitoring.web(server, node, options.class_folder)
            web = await started(lambda: stack.enter_async_context(monitoring.serving(pages)))
            _say(options, f"/health and /metrics at {web.url}")
            _say(options, f"the live page is at {web.url}/")
        resumed = await started(lambda: server.start(fresh=options.fresh))
        _offer_reset(options, node, server, attendance, monitoring)
        _say(options, f"{resumed}")
        if recorder is not None:
            assert isinstance(server, TaskServer), "a fleet cannot be recorded"
            await recorder.follow(node, server, service=task_service(options.namespace))
            _say(options, f"recording to {recorder.writer.path}")
        for fault in faults.faults if faults is not None else ():
            _say(options, f"fault: {fault}")
        if line := _in_place_of_a_lab(options):
            _say(options, line)
        what = f"{task_service(options.namespace)} [my_robot_interfaces/srv/RobotTask]"
        _print(options, f"taskrpc-server ready: {what} at {node.address}")
        tune_for_long_run()
        number = await stopped
        await _shut_down(node, server)
    return number


def _server(
    options: argparse.Namespace,
    node: Node,
    robot: Robot,
    store: TaskStore,
    monitoring: Monitoring | None,
    recorder: RunRecorder | None,
) -> OfferedTasks:
    from taskrpc.robot.tasks import TaskServer

    if fleet_server.is_fleet(options):
        return fleet_server.make_server(options, node, robot, cast("FleetStore", store))
    return TaskServer(
        node,
        robot,
        monitoring.measured(store) if monitoring else store,
        queue_limit=options.queue_limit,
        share=options.share,
        settle=options.settle,
        join=options.join,
        introspection=options.introspection,
        journal=recorder.journal if recorder is not None else None,
    )


def _observer(
    attendance: Attendance | None, monitoring: Monitoring | None, recorder: RunRecorder | None
) -> Observer | None:
    from taskrpc import Observers

    observers: list[Observer] = [monitoring.observer] if monitoring else []
    if attendance is not None:
        observers.append(attendance)
    if recorder is not None:
        observers.append(recorder.calls)
    return Observers(*observers) if len(observers) > 1 else next(iter(observers), None)


def _attendance(options: argparse.Namespace) -> Attendance | None:
    if not options.attendance:
        return None
    from taskrpc.course.classroom.attendance import Attendance  # few servers are those of a class

    return Attendance(Path(options.attendance))


def _offer_reset(
    options: argparse.Namespace,
    node: Node,
    server: OfferedTasks,
    attendance: Attendance | None,
    monitoring: Monitoring | None,
) -> None:
    """Offer what `taskrpc classroom reset` calls, if this is the server of a class."""
    from taskrpc.robot.tasks import TaskServer

    if options.class_folder is None or not isinstance(server, TaskServer):
        return
    from taskrpc.cli.course.classroom.group import GroupReset
    from taskrpc.course.classroom.register import Register

    forget = monitoring.forget_students if monitoring else lambda: None
    GroupReset(server, Register(Path(options.class_folder)), attendance, forget).offer(node)


def _in_place_of_a_lab(options: argparse.Namespace) -> str:
    """Return a warning if this server takes calls that are meant for a joined lab, else ""."""
    if options.transport != "tcp" or options.class_folder is not None:
        return ""
    try:
        lab = remote.called_lab()
    except TaskRpcError:
        return ""  # the commands that call the lab report a damaged file
    if lab is None or options.namespace not in ("/", lab.robot_namespace):
        return ""
    return (
        f"you have joined the lab at {lab.address}: while this server runs, your calls of"
        f" {task_service(options.namespace)} come here, not to the lab's robot; to reach both,"
        " start this server with --namespace /local"
    )


def _faults(options: argparse.Namespace) -> CallFaults | None:
    """Return the faults to inject; they concern /robot_task if they name no other service."""
    if not options.fault:
        return None
    from taskrpc.testing import CallFaults

    return CallFaults(*options.fault, service=task_service(options.namespace))


def _recorder(options: argparse.Namespace) -> RunRecorder | None:
    if not options.record:
        return None
    from taskrpc.observe.recording.run_recorder import RunRecorder  # most servers record nothing

    return RunRecorder(options.record)


def _monitoring(options: argparse.Namespace, access: remote.Remote) -> Monitoring | None:
    if not options.web:
        return None
    from taskrpc.cli.robot.server.monitoring import (
        Monitoring,  # slow to import; most servers show no pages
    )

    return Monitoring(options.web, access, options.accounts, options.allow_origin)


async def _claimed(
    store: SqliteStore, stopped: asyncio.Future[int], say: Callable[[str], object]
) -> bool:
    """Wait until this server owns the store; return False if a signal ends the wait.

    Raises StoreError.
    """
    from taskrpc.robot.tasks.services.offered_tasks import load_types

    load_types()  # now, so that it does not delay the start after the wait
    claim = asyncio.ensure_future(store.claim(lambda error: say(f"standing by: {error.fact}")))
    await asyncio.wait((claim, stopped), return_when=asyncio.FIRST_COMPLETED)
    if not stopped.done():
        await claim
        return True
    claim.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await claim
    await store.close()
    return False


async def _once_free(start: Callable[[], Awaitable[_Result]]) -> _Result:
    """Start something that needs the addresses and names of the previous server.

    The previous server has closed its database and may still be ending. Raises CannotListen or
    NameInUse if another program has them.
    """
    from taskrpc.errors import CannotListen, NameInUse

    loop = asyncio.get_running_loop()
    deadline = loop.time() + _STANDBY_TIMEOUT
    while True:
        try:
            return await start()
        except (CannotListen, NameInUse):
            if loop.time() >= deadline:
                raise
        await asyncio.sleep(_STANDBY_POLL)


async def _at_once(start: Callable[[], Awaitable[_Result]]) -> _Result:
    return await start()


def _say(options: argparse.Namespace, text: str) -> None:
    _print(options, f"taskrpc-server: {text}")


def _print(options: argparse.Namespace, text: str) -> None:
    """Print a line at every log level, in the format of the log."""
    if options.log_format == "json":
        level = logging.INFO
        record = logging.LogRecord("taskrpc.cli", level, __file__, 0, text, (), None)
        text = logs.JsonFormatter().format(record)
    print(text, file=sys.stderr, flush=True)


async def _shut_down(node: Node, server: OfferedTasks) -> None:
    """Accept no new calls, answer those in flight, halt the robot, store the running task."""
    drained = asyncio.ensure_future(node.drain(DRAIN_GRACE))
    # Watching calls wait for changes that will not come. After one loop turn the drain has begun,
    # so no new watching call can arrive.
    await asyncio.sleep(0)
    server.dismiss_watchers()
    await drained
    await server.close()


def _store(options: argparse.Namespace) -> TaskStore:
    from taskrpc.robot.tasks import History, MemoryStore, SqliteStore

    history = options.history or History()
    if options.db == ":memory:":
        return MemoryStore(history=history)
    if fleet_server.is_fleet(options):
        return fleet_server.store_of(options, history)
    return SqliteStore(options.db or default_database(options.namespace), history=history)


def _robot(options: argparse.Namespace) -> Callable[[], Robot]:
    """Return the function that makes the robot; reads the map and imports the class at once.

    So mistakes in these options are reported before the server starts. Raises TaskRpcError.
    """
    from taskrpc.robot import KinematicRobot, default_world, read_map

    world = read_map(options.map) if options.map else default_world()
    if options.robot:
        make = _imported(options.robot)
        return partial(_own_robot, options.robot, make, {"world": world, "speed": options.speed})
    return partial(KinematicRobot, world, speed=options.speed)


def _own_robot(spec: str, make: Callable[..., Any], offered: dict[str, Any]) -> Robot:
    """Make a user's robot; its constructor gets `world` and `speed` if it has these parameters."""
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


if __name__ == "__main__":
    sys.exit(main())
