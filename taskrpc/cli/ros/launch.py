"""`taskrpc launch`: runs a launch file, which starts several programs together."""

from __future__ import annotations

import contextlib
import os
import stat
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from taskrpc.cli.shared.command import Exit, UsageError, hinted
from taskrpc.cli.shared.parsing import Parser
from taskrpc.errors import TaskRpcError

_USAGE = """taskrpc launch [-h] [OPTIONS] PACKAGE FILE [NAME:=VALUE ...]
       taskrpc launch [-h] [OPTIONS] PATH [NAME:=VALUE ...]"""
_LEFT_OUT = {"build", "install", "log", "__pycache__", ".git"}
_SETTINGS = {"emulate_tty", "sigterm_timeout", "sigkill_timeout"}
"""Launch configurations that `launch` itself reads, even if the launch file does not use them."""
_ENVIRONMENT = {"ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3", "ROS_DISTRO": "kilted"}
"""Variables that ROS's setup file sets, and that launch files read."""
_SUFFIXES = (".py", ".xml", ".yaml", ".yml")


def configure(parser: Parser) -> None:
    """Give the parser of `taskrpc launch` its arguments."""
    parser.usage = _USAGE
    parser.mixed = True
    parser.add_argument("target", metavar="PACKAGE", help="A package, or the path of a launch file")
    what = "The launch file's name, without its folder; then arguments, as NAME:=VALUE"
    parser.add_argument("rest", metavar="FILE", nargs="*", help=what)
    what = "Tell the launch file that no terminal is attached; nothing else changes"
    parser.add_argument("-n", "--noninteractive", action="store_true", help=what)
    what = "Print tracebacks of errors in launch files"
    parser.add_argument("-d", "--debug", action="store_true", help=what)
    shown = parser.add_mutually_exclusive_group()
    what = "Print the actions of the launch file, and start nothing"
    shown.add_argument(
        *("-p", "--print", "--print-description"), dest="print", action="store_true", help=what
    )
    what = "Print the arguments of the launch file, and start nothing"
    shown.add_argument(
        *("-s", "--show-args", "--show-arguments"), dest="show", action="store_true", help=what
    )
    what = "Show the output of all programs, also if the launch file hides it"
    parser.add_argument("-a", "--show-all-subprocesses-output", action="store_true", help=what)
    what = "Put this command before the command of each program, such as 'gdb -ex run --args'"
    parser.add_argument("--launch-prefix", metavar="COMMAND", help=what)
    what = "Use --launch-prefix only for programs whose names match this regular expression"
    parser.add_argument("--launch-prefix-filter", metavar="REGEX", help=what)
    parser.set_defaults(run=_run)


def _run(options: Namespace) -> int:
    from taskrpc.ros import hook

    _leave_out_working_directory()
    hook.install(Path.cwd())
    path, words = _launch_file(options.target, options.rest)
    hook.install(path.resolve().parent, Path.cwd())
    arguments = parse_arguments(words)
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    _tolerate_missing_packages()
    if options.print or options.show:
        return _describe(path, is_tree=options.print)
    for name in ("launch_prefix", "launch_prefix_filter"):
        if (value := getattr(options, name)) is not None:
            arguments.setdefault(name.replace("_", "-"), value)
    if options.show_all_subprocesses_output:
        os.environ["OVERRIDE_LAUNCH_PROCESS_OUTPUT"] = "both"
    with _ros2_command():
        return _launch(path, arguments, words, options)


def _leave_out_working_directory() -> None:
    """Let `python -m taskrpc` import nothing from the working directory, as `ros2` does.

    Otherwise a launch file `launch.py` there hides the package `launch`.
    """
    if not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:
        del sys.path[0]


def _launch(path: Path, arguments: dict[str, str], words: list[str], options: Namespace) -> int:
    import logging

    import launch

    from taskrpc.ros.process_tree import end_children_with_this_process

    config = launch.logging.launch_config
    config.level = logging.DEBUG if options.debug else logging.INFO
    logger = launch.logging.get_logger("launch")
    logger.info(f"All log files can be found below {config.log_dir}")
    level = logging.getLevelName(config.level)
    logger.info(f"Default logging verbosity is set to {level}")
    end_children_with_this_process()
    source = launch.launch_description_sources.AnyLaunchDescriptionSource(str(path.resolve()))
    include = launch.actions.IncludeLaunchDescription(source, launch_arguments=arguments.items())
    check = launch.actions.OpaqueFunction(function=_name_unknown, args=[arguments, logger])
    service = launch.LaunchService(
        argv=words, noninteractive=options.noninteractive, debug=options.debug
    )
    service.include_launch_description(launch.LaunchDescription([include, check]))
    code = int(service.run())
    return Exit.INTERRUPTED if service.is_interrupted and not code else code


def _tolerate_missing_packages() -> None:
    """Let a launch file name the folders of packages that are not here, unless misspelt."""
    from ament_index_python import packages

    from taskrpc.ros import hook, workspace
    from taskrpc.ros.executables import missing_folder

    def stand_in(name: str) -> Path | None:
        is_misspelt = _guess(name, workspace.packages(*hook.starts()))
        return None if is_misspelt else missing_folder(name)

    packages.stand_in = stand_in


def _name_unknown(context: Any, arguments: dict[str, str], logger: Any) -> None:
    """Warn about arguments that the launch file does not use."""
    from srvgen.definitions.names import similar_names

    used = context.used_configurations
    for name in arguments:
        if name not in used and name not in _SETTINGS and not name.startswith("launch-prefix"):
            guesses = similar_names(name, used)
            hint = f"; did you mean {' or '.join(guesses)}?" if guesses else ""
            logger.warning(f"the launch file does not use the argument '{name}'{hint}")


def parse_arguments(words: list[str]) -> dict[str, str]:
    """Return the launch arguments by name; of several with one name, the last counts.

    Raises UsageError if one of them is not NAME:=VALUE.
    """
    found = {}
    for word in words:
        name, sign, value = word.partition(":=")
        if not sign or not name:
            raise UsageError(
                f"malformed launch argument '{word}', expected format '<name>:=<value>'"
            )
        found[name] = value
    return found


def _launch_file(target: str, rest: list[str]) -> tuple[Path, list[str]]:
    """Return the launch file that the command line names, and the words after it."""
    has_name = bool(rest) and ":=" not in rest[0]
    if not has_name:
        if os.path.isfile(target):
            return Path(target), rest
        if os.sep in target or target.endswith(_SUFFIXES):
            raise _no_file(target)
        raise UsageError(
            f"expected a package and its launch file, or the path of a launch file, got '{target}'"
        )
    if os.path.isfile(target):
        raise UsageError(
            f"malformed launch argument '{rest[0]}', expected format '<name>:=<value>'"
        )
    return file_in_package(target, rest[0]), rest[1:]


def _no_file(target: str) -> Exception:
    """The error for a path that does not exist, with the next step."""
    folder, name = os.path.split(target)
    if folder and not os.path.isdir(folder):
        return TaskRpcError(f"cannot launch {target}: the folder {folder} does not exist")
    there = [each for each in os.listdir(folder or ".") if each.endswith(_SUFFIXES)]
    hint = _guess(name, there) or f"for a file of a package, write: taskrpc launch PACKAGE {name}"
    return hinted(TaskRpcError(f"cannot launch {target}: No such file or directory"), hint)


def file_in_package(package: str, name: str) -> Path:
    """Return the launch file of a package; raises TaskRpcError if there is not exactly one."""
    from ament_index_python.packages import (
        PackageNotFoundError,
        get_package_share_path,
        get_packages_with_prefixes,
    )

    from taskrpc.ros.missing import explain_program

    try:
        share = Path(get_package_share_path(package))
    except PackageNotFoundError as error:
        problem = TaskRpcError(f"Package '{package}' not found: \"{error.args[0]}\"")
        hint = explain_program(package) or _guess(package, get_packages_with_prefixes())
        raise hinted(problem, hint) from None
    except ValueError as error:
        raise TaskRpcError(str(error)) from None
    found: list[Path] = []
    launch_files: set[str] = set()
    for folder, folders, files in os.walk(share):
        folders[:] = sorted(set(folders) - _LEFT_OUT)
        found += [Path(folder, name)] if name in files else []
        launch_files |= {each for each in files if "launch." in each}
    if not found and not launch_files and (advice := explain_program(package)):
        problem = TaskRpcError(f"taskrpc does not have '{name}' of the package '{package}'")
        raise hinted(problem, advice)
    if not found:
        problem = TaskRpcError(
            f"file '{name}' was not found in the share directory of package '{package}'"
            f" which is at '{share}'"
        )
        raise hinted(problem, _guess(name, launch_files))
    if len(found) > 1:
        places = ", ".join(f"'{each}'" for each in found)
        raise TaskRpcError(
            f"file '{name}' was found more than once in the share directory of package"
            f" '{package}': [{places}]; give the path of one of them"
        )
    return found[0]


def _guess(name: str, known: Any) -> str:
    from srvgen.definitions.names import similar_names

    guesses = similar_names(name, known)
    return f"did you mean {' or '.join(guesses)}?" if guesses else ""


def _describe(path: Path, *, is_tree: bool) -> Exit:
    import launch

    try:
        load = launch.launch_description_sources.get_launch_description_from_any_launch_file
        description = load(str(path))
        if is_tree:
            print(launch.LaunchIntrospector().format_launch_description(description))
        else:
            print("\n".join(_argument_lines(description.get_launch_arguments())))
    except Exception as error:  # of the launch file
        raise TaskRpcError(launch.utilities.problems.explained(error)) from None
    return Exit.DONE


def _argument_lines(arguments: list[Any]) -> Iterator[str]:
    yield "Arguments (pass arguments as '<name>:=<value>'):"
    for each in arguments:
        yield f"\n    '{each.name}':{'*' if each.is_conditional else ''}"
        yield f"        {each.description}"
        if each.default_value is not None:
            yield f"        (default: {' + '.join(one.describe() for one in each.default_value)})"
    if not arguments:
        yield "\n  No arguments."
    elif any(each.is_conditional for each in arguments):
        yield "\n* argument(s) which are only used if specific conditions occur"


@contextlib.contextmanager
def _ros2_command() -> Iterator[None]:
    """Let the started programs call `ros2`, if the machine has no command of this name."""
    from shutil import which

    if which("ros2") is not None:
        yield
        return
    with tempfile.TemporaryDirectory(prefix="taskrpc-launch-") as folder:
        if sys.platform == "win32":
            script = Path(folder, "ros2.cmd")
            script.write_text(f'@"{sys.executable}" -m taskrpc %*\n')
        else:
            script = Path(folder, "ros2")
            script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m taskrpc "$@"\n')
            script.chmod(stat.S_IRWXU)
        before = os.environ.get("PATH", os.defpath)
        os.environ["PATH"] = f"{before}{os.pathsep}{folder}"
        yield
