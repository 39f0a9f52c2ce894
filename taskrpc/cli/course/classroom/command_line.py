"""`taskrpc classroom`: let the laptops of a class call this machine's robot."""

from __future__ import annotations

import argparse
import datetime
import sys
import time

from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.parsing import add_command, add_group, whole
from taskrpc.cli.shared.remote import address
from taskrpc.errors import TaskRpcError

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from collections.abc import Sequence

    from taskrpc import Account
    from taskrpc.cli.shared.parsing import Commands
    from taskrpc.course.classroom.class_server import ClassServer
    from taskrpc.course.classroom.register import Register

_PORT = 7450
_DAYS = 180
_MOST_STUDENTS = 1000
_MOST_DAYS = 36_500
_SHARE = 20  # queued tasks of one laptop
_DAY = 86_400
_MOST_ROBOTS = 20
_CLASS = "class"  # the account of a class without --students


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of `classroom` and its commands."""
    add = parser.add_argument
    what = "A name or address of this machine for the join strings (default: found automatically)"
    add("--address", action="append", metavar="HOST", type=_host, help=what)
    what = f"Where the server listens (default: {_PORT}, or as last time)"
    add("--port", metavar="N", type=_port, help=what)
    what = "A file with one student per line, or a number of students (default: one string for all)"
    add("--students", metavar="FILE|N", help=what)
    what = f"How many days the join strings are valid (default: {_DAYS})"
    add("--days", metavar="N", type=whole(1, _MOST_DAYS), default=_DAYS, help=what)
    add("--renew", action="store_true", help="Make a new certificate; all students must join again")
    what = "How many robots share the students (default: 1, or as many as the last time)"
    add("--robots", metavar="N", type=whole(1, _MOST_ROBOTS), help=what)
    what = f"With --serve: maximum number of queued tasks of one laptop (default: {_SHARE})"
    add("--share", metavar="N", type=whole(1), default=_SHARE, help=what)
    what = "Run taskrpc-server for the class, with a live page there (default: 127.0.0.1:0)"
    add("--web", metavar="HOST:PORT", type=address, nargs="?", const="127.0.0.1:0", help=what)
    what = "Then run taskrpc-server for the class; the words that follow are its options"
    add("--serve", nargs=argparse.REMAINDER, metavar="OPTION", help=what)
    commands = add_group(parser)
    parser.set_defaults(run=_make)
    roster = add_command(commands, "roster", "Show students, their last calls and queued tasks")
    roster.add_argument("--json", action="store_true", help="Print JSON")
    roster.set_defaults(run=_roster)
    adding = add_command(commands, "add", "Add students and print their join strings")
    adding.add_argument("names", nargs="+", metavar="NAME", help="Name of the student")
    days = whole(1, _MOST_DAYS)
    what = f"How many days the join strings are valid (default: {_DAYS})"
    adding.add_argument("--days", metavar="N", type=days, default=_DAYS, help=what)
    adding.set_defaults(run=_add)
    _add_bundle(commands)
    _add_lab(commands)
    _add_reset(commands)
    what = "Revoke students; a running server then refuses them"
    revoking = add_command(commands, "revoke", what)
    revoking.add_argument("names", nargs="+", metavar="NAME", help="Name of the student")
    revoking.set_defaults(run=_revoke)


def _add_bundle(commands: Commands) -> None:
    what = "Make a folder with all that students install and read without the internet"
    bundling = add_command(commands, "bundle", what)
    what = "The folder to fill, for example on a memory stick; created if it is missing"
    bundling.add_argument("folder", metavar="DIR", help=what)
    what = "A Python version of the laptops (default: 3.11, 3.12, 3.13 and 3.14)"
    bundling.add_argument("--python", action="append", metavar="VERSION", type=_python, help=what)
    what = "A system of the laptops: windows, macos or linux (default: all)"
    systems = ("windows", "macos", "linux")
    bundling.add_argument("--system", action="append", choices=systems, help=what)
    what = "Add Jupyter, for the notebooks"
    bundling.add_argument("--jupyter", action="store_true", help=what)
    what = "Make nothing: check that each laptop can install what is in the folder"
    bundling.add_argument("--check", action="store_true", help=what)
    bundling.set_defaults(run=_bundle)


def _add_lab(commands: Commands) -> None:
    what = "Serve the first labs to the browsers of laptops that have no Python"
    serving = add_command(commands, "lab", what)
    what = "The port of the page; browsers keep the programs for each port (default: 8737)"
    serving.add_argument("--port", metavar="N", type=_port, help=what)
    what = "Take Pyodide from this folder, such as browser-lab of a bundle (default: download)"
    serving.add_argument("--pyodide", metavar="FOLDER", help=what)
    serving.set_defaults(run=_lab)


def _add_reset(commands: Commands) -> None:
    what = "Begin the next group: empty queue, robot at its start, no last calls"
    resetting = add_command(commands, "reset", what)
    resetting.add_argument("--yes", action="store_true", help="Do not ask")
    what = "Give all students new join strings; the earlier ones end"
    resetting.add_argument("--new-accounts", action="store_true", help=what)
    what = "The students of the next group, in the place of the former ones: a file or a number"
    resetting.add_argument("--students", metavar="FILE|N", help=what)
    what = f"How many days new join strings are valid (default: {_DAYS})"
    resetting.add_argument(
        "--days", metavar="N", type=whole(1, _MOST_DAYS), default=_DAYS, help=what
    )
    what = "The server's database, if it does not run and is not the default one"
    resetting.add_argument("--db", metavar="FILE", help=what)
    resetting.set_defaults(run=_reset)


def _host(text: str) -> str:
    from taskrpc.course.classroom.own_addresses import is_host

    if not is_host(text):
        raise argparse.ArgumentTypeError(f"expected a host name or an address, got {text!r}")
    return text


def _port(text: str) -> int:
    port = whole(1)(text)
    if port > 65535:
        raise argparse.ArgumentTypeError(f"expected a port from 1 to 65535, got {text!r}")
    return port


def _python(text: str) -> str:
    import re

    if not re.fullmatch(r"3\.\d{1,2}", text) or int(text[2:]) < 11:
        raise argparse.ArgumentTypeError(f"expected a version such as 3.12, got {text!r}")
    return text


def _make(options: argparse.Namespace) -> Exit:
    register = _register()
    server = _server(options, register)
    made = register.certificates
    if options.renew or not made.cert.exists():
        _make_certificates(register, server)
    register.server = server
    accounts = register.accounts()
    if options.students or not accounts:
        names = _students(options.students) if options.students else [_CLASS]
        accounts = register.add(names, time.time() + options.days * _DAY)
    if options.serve is None and options.web is None:
        _print_strings(register, accounts)
        print("start the server: taskrpc classroom --web --serve", file=sys.stderr)
        print("for laptops without taskrpc: taskrpc classroom bundle DIR", file=sys.stderr)
        return Exit.DONE
    # Students may see this screen in class, and each student's string is a secret. So print only
    # new strings and the string that all students share.
    if options.students or len(accounts) == 1:
        _print_strings(register, accounts)
    return _serve(register, server, options)


def _register() -> Register:
    from taskrpc.course.classroom.register import Register
    from taskrpc.spi import folders

    return Register(folders.state_dir() / "classroom")


def _server(options: argparse.Namespace, register: Register) -> ClassServer:
    from taskrpc.course.classroom.class_server import ClassServer
    from taskrpc.course.classroom.own_addresses import own_addresses
    from taskrpc.spi import domain_id

    hosts = options.address or own_addresses()
    if not hosts:
        raise TaskRpcError(
            "this machine has no address in a network: join the one in which the laptops are, or"
            " say with --address HOST what they can reach"
        )
    robots = options.robots or register.robots
    port = options.port or register.port or _PORT
    return ClassServer(tuple(hosts), port, domain_id(), robots)


def _make_certificates(register: Register, server: ClassServer) -> None:
    from taskrpc.course.classroom.authority import make_certificates
    from taskrpc.course.classroom.own_addresses import own_names

    names = list(dict.fromkeys([*server.hosts, *own_names()]))
    make_certificates(register.folder, names, datetime.datetime.now(datetime.UTC))
    print(f"certificates are in {register.folder}", file=sys.stderr)


def _students(given: str) -> list[str]:
    """Return the names in a file, or generated names for a number of students."""
    if given.isdecimal():
        count = int(given) if len(given) <= len(str(_MOST_STUDENTS)) else _MOST_STUDENTS + 1
        if not 1 <= count <= _MOST_STUDENTS:
            problem = f"expected a number from 1 to {_MOST_STUDENTS}, got {given[:20]}"
            raise TaskRpcError(f"--students: {problem}")
        return [f"student{number:0{len(given)}}" for number in range(1, count + 1)]
    from taskrpc.course.classroom.student_names import cleaned, student_name_problem
    from taskrpc.spi import read_text

    try:
        lines = read_text(given, "utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "expected UTF-8 text"
        raise TaskRpcError(f"--students {given}: {reason}") from None
    names: dict[str, None] = {}
    for number, line in enumerate(lines, 1):
        if not (name := cleaned(line)):
            continue
        where = f"--students {given}, line {number}"
        if problem := student_name_problem(name):
            raise TaskRpcError(f"{where}: {problem}")
        if name in names:
            raise TaskRpcError(f"{where}: {name!r} appears twice; give each student another name")
        names[name] = None
    if not names:
        raise TaskRpcError(f"--students {given}: expected one name per line, got an empty file")
    return list(names)


def _print_strings(register: Register, accounts: Sequence[Account]) -> None:
    """Print one line per valid account: the string, after the name if there are several.

    With several robots, the namespace of the student's robot is before the string.
    """
    usable = [account for account in accounts if not account.refusal(time.time())]
    print("on each laptop: taskrpc join STRING", file=sys.stderr)
    written = register.names()
    for account in usable:
        student = written.get(account.name, account.name)
        name = f"{student} " if len(usable) > 1 else ""
        if register.robots > 1:
            name += f"{register.robot_of(account.name)} "
        print(f"{name}{register.join_string(account)}", flush=True)


def _serve(register: Register, server: ClassServer, options: argparse.Namespace) -> Exit:
    from taskrpc.cli.robot.server import command_line as task_server

    made = register.certificates
    arguments = [
        *("--listen", f"0.0.0.0:{server.port}"),
        *("--tls-cert", str(made.cert), "--tls-key", str(made.key)),
        *("--accounts", str(register.accounts_file)),
        *("--attendance", str(register.attendance_file)),
        *("--share", str(options.share)),
        *("--class", str(register.folder)),
        *(("--web", options.web) if options.web else ()),
        *(("--robots", str(server.robots)) if server.robots > 1 else ()),
        *(options.serve or ()),
    ]
    return Exit(task_server.main(arguments))


def _add(options: argparse.Namespace) -> Exit:
    register = _register()
    assert register.server  # raises TaskRpcError if there is no class
    accounts = register.add(options.names, time.time() + options.days * _DAY)
    _print_strings(register, accounts)
    return Exit.DONE


def _bundle(options: argparse.Namespace) -> Exit:
    from taskrpc.cli.course.classroom.offline import make_or_check  # needs many modules

    return make_or_check(options)


def _lab(options: argparse.Namespace) -> Exit:
    from taskrpc.cli.course.classroom.browser_lab import serve_to_class  # reads many files

    return serve_to_class(_register(), options)


def _reset(options: argparse.Namespace) -> Exit:
    from pathlib import Path

    from taskrpc.cli.course.classroom.reset import REFRESH, confirmed, end_group
    from taskrpc.cli.shared.task_database import default_database
    from taskrpc.spi import robot_namespace

    register = _register()
    assert register.server  # raises TaskRpcError if there is no class
    names = _students(options.students) if options.students else None
    if options.db and not Path(options.db).exists():
        raise TaskRpcError(f"--db: expected the database of the class, got {options.db}: no file")
    if not confirmed(options):
        print("nothing is changed", file=sys.stderr)
        return Exit.ERROR
    accounts: Sequence[Account] = ()
    if options.new_accounts or names is not None:
        # First, so that programs of the former group cannot submit more tasks.
        accounts = register.renew(names, time.time() + options.days * _DAY)
        time.sleep(REFRESH)
    robots = [robot_namespace(number) for number in range(1, register.robots + 1)]
    databases = [default_database(namespace) for namespace in robots]
    end_group(register, [Path(options.db)] if options.db else databases)
    if accounts:
        _print_strings(register, accounts)
    return Exit.DONE


def _revoke(options: argparse.Namespace) -> Exit:
    register = _register()
    for name in options.names:
        register.revoke(name)
        print(f"{name} is revoked")
    return Exit.DONE


def _roster(options: argparse.Namespace) -> Exit:
    from taskrpc.cli.course.classroom import roster

    return roster.show(_register(), as_json=options.json)
