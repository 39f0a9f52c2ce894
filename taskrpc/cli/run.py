"""`taskrpc run`: a ROS 2 program as it is, without ROS."""

from __future__ import annotations

from argparse import REMAINDER, ArgumentParser, Namespace

_USAGE = """taskrpc run [-h] [--like-ros] SCRIPT [ARGS ...] [--ros-args ...]
       taskrpc run [-h] [--like-ros] -m MODULE [ARGS ...] [--ros-args ...]
       taskrpc run [-h] [--like-ros] PACKAGE EXECUTABLE [ARGS ...] [--ros-args ...]"""


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc run` its arguments."""
    parser.usage = _USAGE
    what = "do what ROS 2 would do, hang included, instead of helping"
    parser.add_argument("--like-ros", action="store_true", help=what)
    what = "run a module, as python -m, with its own arguments"
    parser.add_argument("-m", metavar="MODULE", dest="module", nargs=REMAINDER, help=what)
    what = "a Python file, or a package of the workspace here and its executable, then arguments"
    parser.add_argument("rest", metavar="PROGRAM", nargs=REMAINDER, help=what)
    parser.set_defaults(run=_run, parser=parser)


def _run(options: Namespace) -> int:
    import os

    if options.like_ros:
        os.environ["TASKRPC_LIKE_ROS"] = "1"
    if options.module:
        from taskrpc.ros.running import run_module

        module, *arguments = options.module
        return run_module(module, arguments)
    if not options.rest:
        options.parser.error("expected a script, a package and its executable, or -m and a module")
    return _run_named(*options.rest)


def _run_named(program: str, *arguments: str) -> int:
    from pathlib import Path

    from taskrpc.errors import TaskRpcError
    from taskrpc.ros.running import run_executable, run_script

    path = Path(program)
    if path.is_file() or path.suffix == ".py" or len(path.parts) != 1:
        return run_script(path, arguments)
    if not arguments:
        raise TaskRpcError(
            f"cannot run {program}: No such file or directory; for a package, name its executable"
        )
    executable, *rest = arguments
    return run_executable(program, executable, rest)
