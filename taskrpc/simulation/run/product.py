"""Connects taskrpc and rclpy with the runs of this interpreter."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any, Final

from taskrpc.ros import hook
from taskrpc.simulation.interpreter.interpreter import Interpreter
from taskrpc.simulation.interpreter.state import ModuleState
from taskrpc.simulation.run.observing import watch_publishers
from taskrpc.spi import TRANSPORTS, Registration

_IMPORTED: Final = (
    "taskrpc.sync",
    "taskrpc.actions",
    "taskrpc.simulation.run.network",
    "rclpy",
    "rclpy.executors",
    "rclpy.node",
    "rclpy.action",
)
"""What programs import, so that no run pays for it."""

_is_watched = False


def use_product(interpreter: Interpreter, folder: Path) -> None:
    """Prepare taskrpc and rclpy for programs in a folder."""
    global _is_watched
    hook.install(folder)
    TRANSPORTS["tcp"] = Registration("taskrpc.simulation.run.network:open_network")
    TRANSPORTS["memory"] = TRANSPORTS["tcp"]
    for name in _IMPORTED:
        importlib.import_module(name)
    if not _is_watched:
        _is_watched = True
        watch_publishers(lambda: interpreter.run)
        _install_no_signal_handlers()
    interpreter.state = ModuleState()


def _install_no_signal_handlers() -> None:
    """Keep rclpy from watching for signals, with a socket and a thread: none ever arrives."""

    def ignore(*_: Any, **__: Any) -> None:
        pass

    for name in "rclpy", "rclpy.signals":
        setattr(importlib.import_module(name), "install_signal_handlers", ignore)  # noqa: B010
