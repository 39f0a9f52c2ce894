"""Lets the programs of a Python environment import `rclpy`, and undoes this."""

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
"""The files that `enable` writes into the folder of the environment's packages."""

# A separate module, because importing taskrpc would delay each start of Python by milliseconds.
_LINE = f"import {_MODULE}; {_MODULE}.begin()\n"


def folder() -> Path:
    """The folder of the environment's packages."""
    return Path(sysconfig.get_path("purelib"))


def is_enabled() -> bool:
    """Whether the environment's programs import `rclpy` from taskrpc."""
    return all((folder() / name).is_file() for name in FILES)


def is_of_this_version() -> bool:
    """Whether the files are those that this version of taskrpc writes."""
    return is_enabled() and (folder() / FILES[0]).read_text("utf-8") == _START.read_text("utf-8")


def enable() -> Path:
    """Let the environment's programs import `rclpy`; returns the folder that contains `FILES`.

    Raises TaskRpcError if the programs already import a real rclpy, if another environment is
    active, or if the folder cannot be written.
    """
    if real := real_rclpy():
        raise TaskRpcError(f"programs here already import the rclpy of ROS 2 ({real}): not enabled")
    _refuse_other_environment()
    try:
        for name, text in zip(FILES, (_START.read_text("utf-8"), _LINE), strict=True):
            (folder() / name).write_text(text, "utf-8")
        # Otherwise each start of Python compiles it (2 ms) where bytecode cannot be written.
        py_compile.compile(str(folder() / FILES[0]), doraise=False, quiet=2)
    except OSError as error:
        disable()
        raise TaskRpcError(
            f"cannot write to {folder()}: {error.strerror or error}; create your own environment"
            " (python -m venv .venv), activate it and install taskrpc there"
        ) from None
    return folder()


def disable() -> list[Path]:
    """Remove the files that `enable` wrote; returns those that existed.

    Raises TaskRpcError if one cannot be removed.
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


def _refuse_other_environment() -> None:
    """Raise TaskRpcError if the active environment is not the one that contains this taskrpc."""
    active = os.environ.get("VIRTUAL_ENV", "")
    if active and os.path.isdir(active) and not os.path.samefile(active, sys.prefix):
        raise TaskRpcError(
            f"this taskrpc belongs to {sys.prefix}, but the active environment is {active}:"
            " install taskrpc there, and run python -m taskrpc ros enable"
        )
