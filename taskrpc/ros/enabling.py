"""Puts into a Python environment what makes its programs find `rclpy`, and takes it away."""

from __future__ import annotations

import os
import py_compile
import sys
import sysconfig
from contextlib import suppress
from pathlib import Path

from taskrpc.errors import TaskRpcError
from taskrpc.ros.hook import real_rclpy

_START = Path(__file__).with_name("start.py")
_MODULE = "_taskrpc_ros"
FILES = (f"{_MODULE}.py", "taskrpc_ros.pth")
"""What is written, in the folder where the environment's packages are."""

# A module of its own: taskrpc itself would cost each start of Python milliseconds.
_LINE = f"import {_MODULE}; {_MODULE}.begin()\n"


def folder() -> Path:
    """Where the environment's packages are."""
    return Path(sysconfig.get_path("purelib"))


def is_enabled() -> bool:
    """Whether the environment's programs find `rclpy` through taskrpc."""
    return all((folder() / name).is_file() for name in FILES)


def is_of_this_version() -> bool:
    """Whether what is there is what this taskrpc would write."""
    return is_enabled() and (folder() / FILES[0]).read_text("utf-8") == _START.read_text("utf-8")


def enable() -> Path:
    """Let the environment's programs find `rclpy`; returns the folder that `FILES` are in.

    Raises TaskRpcError where they find a real one already, where another environment is active,
    and where nothing can be written.
    """
    if real := real_rclpy():
        raise TaskRpcError(f"programs here import ROS 2's own rclpy already ({real}): not enabled")
    _refuse_another()
    try:
        for name, text in zip(FILES, (_START.read_text("utf-8"), _LINE), strict=True):
            (folder() / name).write_text(text, "utf-8")
        # A start that compiles it takes 2 ms longer, each time where no bytecode may be written.
        py_compile.compile(str(folder() / FILES[0]), doraise=False, quiet=2)
    except OSError as error:
        disable()
        raise TaskRpcError(
            f"cannot write to {folder()}: {error.strerror or error}; make an environment of your"
            " own (python -m venv .venv), activate it and install taskrpc there"
        ) from None
    return folder()


def disable() -> list[Path]:
    """Remove what `enable` wrote; returns what was there.

    Raises TaskRpcError where it cannot be removed.
    """
    removed = []
    for name in reversed(FILES):
        path = folder() / name
        try:
            path.unlink()
        except FileNotFoundError:
            continue
        except OSError as error:
            raise TaskRpcError(f"cannot remove {path}: {error.strerror or error}") from None
        removed.append(path)
    for cached in (folder() / "__pycache__").glob(f"{_MODULE}.*.pyc"):
        with suppress(OSError):
            cached.unlink()
    return removed


def _refuse_another() -> None:
    """Refuse where the shell's environment is not the one that this command belongs to."""
    active = os.environ.get("VIRTUAL_ENV", "")
    if active and os.path.isdir(active) and not os.path.samefile(active, sys.prefix):
        raise TaskRpcError(
            f"this taskrpc belongs to {sys.prefix}, but the active environment is {active}:"
            " install taskrpc there, too, and say python -m taskrpc ros enable"
        )
