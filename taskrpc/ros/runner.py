"""Runs an unmodified program as Python itself does, with `rclpy` importable."""

from __future__ import annotations

import gc
import importlib
import runpy
import signal
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, NoReturn

from srvgen.cli import process
from taskrpc.errors import TaskRpcError
from taskrpc.ros import hook, workspace
from taskrpc.ros.missing import WHAT_RUNS, explain_program

_GARBAGE = 700
"""Python's default threshold, which programs expect; the commands of taskrpc use another."""


def run_script(path: Path, arguments: Sequence[str]) -> int:
    """Run a script as `__main__`; returns 1 after an exception, 130 after Ctrl-C, else 0.

    After Ctrl-C the process is killed by SIGINT, as Python's is (`process.end_by_signal`).

    Raises TaskRpcError if the file cannot be read, and SystemExit if the script raises it.
    """
    try:
        source = path.read_bytes()
    except OSError as error:
        problem = TaskRpcError(f"cannot run {path}: {error.strerror or error}")
        raise _with_hint(problem, similar_script(path)) from None
    _prepare(path.resolve().parent, [str(path), *arguments])
    return _run_as_main(source, str(path), __file__=str(path))


def run_code(code: str, arguments: Sequence[str]) -> int:
    """Run Python code as `python -c` does; returns as `run_script` does."""
    _prepare(Path.cwd(), ["-c", *arguments])
    return _run_as_main(code, "<string>")


def _run_as_main(source: str | bytes, file: str, **attributes: object) -> int:
    """Compile a program and run it as the module `__main__` with these attributes."""
    main = ModuleType("__main__")
    main.__dict__.update(attributes, __builtins__=__builtins__)
    sys.modules["__main__"] = main
    # dont_inherit: not with this module's `from __future__ import annotations`.
    return _ended(lambda: exec(compile(source, file, "exec", dont_inherit=True), main.__dict__))


def similar_script(path: Path) -> str:
    """A hint at a script beside `path` with a similar name, or "" if there is none."""
    from srvgen.definitions.names import similar_names  # only a mistake needs it

    found = {one.name: one for one in path.parent.glob("*.py")}
    found |= {one.stem: one for one in found.values()}
    guesses = dict.fromkeys(str(found[name]) for name in similar_names(path.name, found))
    return f"did you mean {' or '.join(guesses)}?" if guesses else ""


def run_module(name: str, arguments: Sequence[str]) -> int:
    """Run a module as `python -m` does; returns as `run_script` does.

    Raises TaskRpcError if there is no such module.
    """
    _prepare(Path.cwd(), [name, *arguments])
    try:
        found = find_spec(name)
    except ImportError:
        found = None
    if found is None:
        raise TaskRpcError(f"No module named {name}")
    return _ended(lambda: runpy.run_module(name, run_name="__main__", alter_sys=True))


def run_executable(
    package: str, name: str, arguments: Sequence[str], start: Path | None = None
) -> int:
    """Run an executable of a package in the workspace or in taskrpc, as `ros2 run` does.

    The workspace is that of the working directory, and that of the folder `start`. Returns as
    `run_script` does. Raises TaskRpcError if there is no such package or executable.
    """
    from taskrpc.ros import bundled, installed  # only this function needs them

    starts = [Path.cwd()] if start is None else [Path.cwd(), start]
    folder = workspace.packages(*starts).get(package)
    if folder is None and package in bundled.EXECUTABLES:
        return _run_bundled(package, bundled.EXECUTABLES[package], name, arguments)
    if folder is None:
        where = f"expected a package.xml of that name in the workspace here, {Path.cwd()}"
        problem = TaskRpcError(f"Package '{package}' not found")
        raise _with_hint(problem, explain_program(package) or where)
    targets = installed.entry_points(folder)
    if name in targets:
        _prepare(installed.source_folder(folder), [str(folder / name), *arguments])
        return _reported(lambda: _ended(lambda: _call(targets[name])))
    if (script := installed.script(folder, name)) is not None:
        return _reported(lambda: run_script(script, arguments))
    raise _no_executable(package, installed.executables(folder), name, folder)


def _run_bundled(package: str, targets: dict[str, str], name: str, arguments: Sequence[str]) -> int:
    if name not in targets:
        raise _no_executable(package, targets, name)
    _prepare(Path.cwd(), [name, *arguments])
    return _reported(lambda: _ended(lambda: _call(targets[name])))


def _no_executable(
    package: str, names: Iterable[str], name: str, folder: Path | None = None
) -> TaskRpcError:
    from taskrpc.ros.executables import compiled_programs

    error = TaskRpcError("No executable found")
    compiled = set() if folder is None else compiled_programs(folder)
    if name in compiled:
        return _with_hint(error, f"{name} of {package} is a C++ program: {WHAT_RUNS}")
    nothing = "no programs in Python" if compiled else "no entry points in setup.py"
    hint = f"{package} has {', '.join(sorted(names)) or nothing}; got '{name}'"
    return _with_hint(error, f"{hint}; {WHAT_RUNS}" if compiled else hint)


def _reported(program: Callable[[], int]) -> int:
    """Run a program and print its failure to stdout, as `ros2 run` does."""
    try:
        status = program()
    except SystemExit as end:
        if failure := _failure(end.code):
            print(f"[ros2run]: Process exited with failure {failure}")
        raise
    if status == process.INTERRUPTED:
        print("[ros2run]: Interrupt")
    elif status:
        print(f"[ros2run]: Process exited with failure {status}")
    return status


def _failure(code: object) -> int:
    """The exit status that `sys.exit` produces from its argument."""
    if code is None:
        return 0
    return code & 0xFF if isinstance(code, int) else 1


def _with_hint(error: TaskRpcError, hint: str) -> TaskRpcError:
    if hint:
        error.add_note(hint)
    return error


def _call(target: str) -> NoReturn:
    module, _, names = target.partition(":")
    home: Any = importlib.import_module(module)
    sys.exit(reduce(getattr, names.split("."), home)())


def _prepare(folder: Path, argv: list[str]) -> None:
    hook.install(folder)
    gc.set_threshold(_GARBAGE)
    sys.argv = argv
    if sys.flags.safe_path:
        sys.path.insert(0, _Folder(folder))
    else:
        sys.path[0] = _Folder(folder)  # until here the folder of the taskrpc command


class _Folder(str):
    """The program's folder, as an entry of `sys.path`.

    `multiprocessing` pickles `sys.path` for the processes that it spawns. Unpickling this entry
    installs the import hook there, before the process imports the program.
    """

    def __reduce__(self) -> tuple[Callable[[str], str], tuple[str]]:
        return _install_hook, (str(self),)


def _install_hook(folder: str) -> str:
    """Install the import hook in a spawned process."""
    hook.install(folder)
    return _Folder(folder)


def _ended(program: Callable[[], object]) -> int:
    try:
        program()
    except SystemExit as end:
        if _failure(end.code):
            sys.last_value = end
        raise
    except KeyboardInterrupt as error:
        sys.last_value = error
        print("KeyboardInterrupt", file=sys.stderr)
        return process.end_by_signal(signal.SIGINT)
    except BaseException as error:
        sys.last_value = error.with_traceback(_of_program(error.__traceback__))  # as Python does
        sys.excepthook(type(error), error, error.__traceback__)
        return 1
    return 0


def _of_program(traceback: TracebackType | None) -> TracebackType | None:
    """The part of a traceback that begins in the program itself."""
    ours = {__file__, runpy.__file__, importlib.__file__, "<frozen runpy>"}
    while traceback is not None and _is_of(traceback, ours):
        traceback = traceback.tb_next
    return traceback


def _is_of(traceback: TracebackType, files: set[str]) -> bool:
    file = traceback.tb_frame.f_code.co_filename
    return file in files or file.startswith("<frozen importlib")
