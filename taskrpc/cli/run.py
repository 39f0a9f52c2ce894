"""`taskrpc run`: a ROS 2 program as it is, without ROS."""

from __future__ import annotations

from argparse import REMAINDER, ArgumentParser, Namespace


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc run` its arguments."""
    parser.usage = "taskrpc run [-h] [--like-ros] SCRIPT | -m MODULE [ARGS ...] [--ros-args ...]"
    what = "do what ROS 2 would do, hang included, instead of helping"
    parser.add_argument("--like-ros", action="store_true", help=what)
    what = "run a module, as python -m, with its own arguments"
    parser.add_argument("-m", metavar="MODULE", dest="module", nargs=REMAINDER, help=what)
    what = "the program, then its own arguments"
    parser.add_argument("rest", metavar="SCRIPT", nargs=REMAINDER, help=what)
    parser.set_defaults(run=_run, parser=parser)


def _run(options: Namespace) -> int:
    import os
    from pathlib import Path

    from taskrpc.ros.running import run_module, run_script

    if options.like_ros:
        os.environ["TASKRPC_LIKE_ROS"] = "1"
    if options.module:
        module, *arguments = options.module
        return run_module(module, arguments)
    if not options.rest:
        options.parser.error("expected a script, or -m and a module")
    script, *arguments = options.rest
    return run_script(Path(script), arguments)
