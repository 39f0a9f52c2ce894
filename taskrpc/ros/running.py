"""Runs an unmodified program as Python itself would, with `rclpy` importable."""

from __future__ import annotations

import gc
import runpy
import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, TracebackType

from taskrpc.errors import TaskRpcError
from taskrpc.ros import hook

_INTERRUPTED = 130
_GARBAGE = 700
"""Python's own setting, which a program expects: our commands have another."""


def run_script(path: Path, arguments: Sequence[str]) -> int:
    """Run a script as `__main__`; returns 1 after an exception, 130 after Ctrl-C, else 0.

    Raises TaskRpcError for a file that cannot be read, and SystemExit where the script does.
    """
    try:
        source = path.read_bytes()
    except OSError as error:
        raise TaskRpcError(f"cannot run {path}: {error.strerror or error}") from None
    _prepare(path.resolve().parent, [str(path), *arguments])
    main = ModuleType("__main__")
    main.__dict__.update(__file__=str(path), __builtins__=__builtins__)
    sys.modules["__main__"] = main
    return _ended(lambda: exec(compile(source, str(path), "exec"), main.__dict__))


def run_module(name: str, arguments: Sequence[str]) -> int:
    """Run a module as `python -m` does; ends as `run_script` does.

    Raises TaskRpcError where there is no such module.
    """
    _prepare(Path.cwd(), [name, *arguments])
    try:
        found = find_spec(name)
    except ImportError:
        found = None
    if found is None:
        raise TaskRpcError(f"No module named {name}")
    return _ended(lambda: runpy.run_module(name, run_name="__main__", alter_sys=True))


def _prepare(folder: Path, argv: list[str]) -> None:
    hook.install(folder)
    gc.set_threshold(_GARBAGE)
    sys.argv = argv
    sys.path.insert(0, str(folder))


def _ended(program: Callable[[], object]) -> int:
    try:
        program()
    except SystemExit:
        raise
    except KeyboardInterrupt:
        print("KeyboardInterrupt", file=sys.stderr)
        return _INTERRUPTED
    except BaseException as error:
        error.__traceback__ = _without_us(error.__traceback__)
        sys.excepthook(type(error), error, error.__traceback__)
        return 1
    return 0


def _without_us(traceback: TracebackType | None) -> TracebackType | None:
    """A traceback from where the program itself begins."""
    ours = {__file__, runpy.__file__, "<frozen runpy>"}
    while traceback is not None and traceback.tb_frame.f_code.co_filename in ours:
        traceback = traceback.tb_next
    return traceback
