"""rclpy's names over taskrpc: programs that were written for ROS 2 run without it.

A program calls `init()`, creates nodes, runs their callbacks with `spin`, and calls `shutdown()`.
Start reading with `node`, then `executors`; both rest on `_impl`, the private machinery. Only files
that ROS names belong here. The package is also imported as top-level `rclpy`, so that all imports
inside it are relative.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from ._impl.execution.spinning import (
    InitContextManager,
    create_node,
    get_global_executor,
    init,
    shutdown,
    spin,
    spin_once,
    spin_until_future_complete,
)
from .context import Context
from .signals import SignalHandlerOptions, install_signal_handlers, uninstall_signal_handlers
from .task import Future
from .utilities import (
    get_available_rmw_implementations,
    get_default_context,
    get_rmw_implementation_identifier,
    ok,
    try_shutdown,
)

if TYPE_CHECKING:
    from . import action as action
    from . import callback_groups as callback_groups
    from . import client as client
    from . import clock as clock
    from . import clock_type as clock_type
    from . import constants as constants
    from . import duration as duration
    from . import exceptions as exceptions
    from . import executors as executors
    from . import logging as logging
    from . import node as node
    from . import parameter as parameter
    from . import publisher as publisher
    from . import qos as qos
    from . import service as service
    from . import subscription as subscription
    from . import task as task
    from . import time as time
    from . import timer as timer
    from . import validate_topic_name as validate_topic_name
    from .parameter import Parameter as Parameter

__all__ = [
    "Context",
    "Future",
    "InitContextManager",
    "SignalHandlerOptions",
    "create_node",
    "get_available_rmw_implementations",
    "get_default_context",
    "get_global_executor",
    "get_rmw_implementation_identifier",
    "init",
    "install_signal_handlers",
    "ok",
    "shutdown",
    "spin",
    "spin_once",
    "spin_until_future_complete",
    "try_shutdown",
    "uninstall_signal_handlers",
]

_LATER = frozenset(
    "action callback_groups client clock clock_type constants duration exceptions executors logging"
    " node parameter publisher qos service subscription task time timer validate_topic_name".split()
)
"""Modules that are imported when a program names them, as in `rclpy.executors.Executor`."""


if not TYPE_CHECKING:  # or type checkers would accept every missing name as Any

    def __getattr__(name):
        if name == "Parameter":
            return importlib.import_module(".parameter", __name__).Parameter
        if name in _LATER:
            return importlib.import_module(f".{name}", __name__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
