"""`taskrpc run`: runs an unmodified ROS 2 program without ROS."""

from __future__ import annotations

from argparse import REMAINDER, ArgumentParser, Namespace

_USAGE = """taskrpc run [-h] [OPTIONS] SCRIPT [ARGS ...] [--ros-args ...]
       taskrpc run [-h] [OPTIONS] -m MODULE [ARGS ...] [--ros-args ...]
       taskrpc run [-h] [OPTIONS] -c CODE [ARGS ...] [--ros-args ...]
       taskrpc run [-h] [OPTIONS] PACKAGE EXECUTABLE [ARGS ...] [--ros-args ...]"""


_EPILOG = """\
To run programs that import rclpy with plain `python`, in an editor, in pytest or in a notebook:
taskrpc ros enable"""


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc run` its arguments."""
    parser.usage, parser.epilog = _USAGE, _EPILOG
    what = "Run the program through this command; quote it if it has spaces ('nice -n 5')"
    parser.add_argument("--prefix", metavar="COMMAND", help=what)
    what = "Behave exactly like ROS 2, even where a program then hangs"
    parser.add_argument("--like-ros", action="store_true", help=what)
    what = "Search the package in the workspace of this folder, too"
    parser.add_argument("--workspace", metavar="FOLDER", help=what)
    what = "Run a module, as python -m, with its own arguments"
    parser.add_argument("-m", metavar="MODULE", dest="module", nargs=REMAINDER, help=what)
    what = "Run Python code, as python -c, with its own arguments"
    parser.add_argument("-c", metavar="CODE", dest="code", nargs=REMAINDER, help=what)
    what = "A Python file, or a package of this workspace and its executable; then its arguments"
    parser.add_argument("rest", metavar="PROGRAM", nargs=REMAINDER, help=what)
    parser.set_defaults(run=_run, parser=parser)


def _run(options: Namespace) -> int:
    import os

    if options.module == []:
        options.parser.error("argument -m: expected a module")
    if options.code == []:
        options.parser.error("argument -c: expected code")
    if options.like_ros:
        os.environ["TASKRPC_LIKE_ROS"] = "1"
    if options.prefix:
        return _run_behind(options)
    if options.module:
        from taskrpc.ros.runner import run_module

        module, *arguments = options.module
        return run_module(module, arguments)
    if options.code:
        from taskrpc.ros.runner import run_code

        code, *arguments = options.code
        return run_code(code, arguments)
    if not options.rest:
        options.parser.error(
            "expected a script, a package and its executable, -m and a module, or -c and code"
        )
    return _run_named(options.workspace, *options.rest)


def _run_behind(options: Namespace) -> int:
    """Run the program through the command of `--prefix`, in a new process."""
    import subprocess
    import sys

    from srvgen.cli import process
    from taskrpc.cli.shared.command import UsageError
    from taskrpc.ros.command_line import split_words

    try:
        prefix = split_words(options.prefix)
    except ValueError as error:
        raise UsageError(f"--prefix: expected a command, got {options.prefix}: {error}") from None
    program = options.rest
    if options.workspace:
        program = ["--workspace", options.workspace, *program]
    if options.module:
        program = ["-m", *options.module]
    elif options.code:
        program = ["-c", *options.code]
    command = [*prefix, sys.executable, "-m", "taskrpc", "run", *program]
    with subprocess.Popen(command) as child:
        while True:
            try:
                status = child.wait()
                return process.end_by_signal(-status) if status < 0 else status
            except KeyboardInterrupt:  # the process gets Ctrl-C too; wait for its exit status
                continue


def _run_named(workspace: str | None, program: str, *arguments: str) -> int:
    from pathlib import Path

    from taskrpc.cli.shared.command import hinted
    from taskrpc.errors import TaskRpcError
    from taskrpc.ros.runner import run_executable, run_script, similar_script

    path = Path(program)
    if path.is_file() or path.suffix == ".py" or len(path.parts) != 1:
        return run_script(path, arguments)
    if not arguments:
        problem = "No such file or directory; for a package, name its executable"
        raise hinted(TaskRpcError(f"cannot run {program}: {problem}"), similar_script(path))
    executable, *rest = arguments
    return run_executable(program, executable, rest, None if workspace is None else Path(workspace))
