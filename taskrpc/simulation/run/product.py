"""Connects taskrpc and rclpy with the runs of this interpreter."""

from __future__ import annotations

import functools
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, cast

import srvgen
from taskrpc.ros import hook
from taskrpc.simulation.interpreter.imports import import_for
from taskrpc.simulation.interpreter.interpreter import Interpreter
from taskrpc.simulation.interpreter.state import ModuleState
from taskrpc.simulation.run.observing import Noting, watch_callers, watch_publishers
from taskrpc.spi import TRANSPORTS, Registration

_IMPORTED: Final = (
    "taskrpc.sync",
    "taskrpc.actions",
    "taskrpc.simulation.run.network",
)
"""What nearly all programs need."""
_OF_ROS: Final = ("rclpy.executors", "rclpy.node", "rclpy.action")
"""What rclpy itself imports late."""

_load: Any = srvgen.load
_watched: set[str] = set()
"""What the runs of this process are told of."""


def use_product(interpreter: Interpreter, folder: Path, files: Sequence[Path]) -> None:
    """Prepare taskrpc, and rclpy if it is used, for programs in a folder."""
    hook.install(folder)
    TRANSPORTS["tcp"] = Registration("taskrpc.simulation.run.network:open_network")
    TRANSPORTS["memory"] = TRANSPORTS["tcp"]
    for name in _IMPORTED:
        importlib.import_module(name)
    import_for(files)
    if "rclpy" in sys.modules:
        for name in _OF_ROS:
            importlib.import_module(name)
        importlib.import_module("rclpy._impl.diagnostics.explain").lose_failed_calls()
    srvgen.load = functools.cache(_load)  # the files do not change during the runs
    if "publishers" not in _watched:
        _watched.add("publishers")
        watch_publishers(lambda: cast("Noting | None", interpreter.run))
    if "rclpy" in sys.modules and "callers" not in _watched:
        _watched.add("callers")
        _install_no_signal_handlers()
        watch_callers(lambda: cast("Noting | None", interpreter.run))
    interpreter.state = ModuleState()


def _install_no_signal_handlers() -> None:
    """Keep rclpy from watching for signals, with a socket, a thread and short waits: none comes."""

    def ignore(*_: Any, **__: Any) -> None:
        pass

    for name in "rclpy", "rclpy.signals":
        setattr(importlib.import_module(name), "install_signal_handlers", ignore)  # noqa: B010
    wakeups = importlib.import_module("rclpy._impl.execution.wakeups")
    setattr(wakeups, "_SLICE", None)  # noqa: B010 - on Windows, a run would have more steps
