"""rclpy's names over taskrpc: programs written for ROS 2 run without it.

Begin with `init()`, make nodes, let callbacks run with `spin`, end with `shutdown()`.
"""

from ._spinning import (
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
from .signals import SignalHandlerOptions
from .task import Future
from .utilities import (
    get_available_rmw_implementations,
    get_default_context,
    get_rmw_implementation_identifier,
    ok,
    try_shutdown,
)

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
    "ok",
    "shutdown",
    "spin",
    "spin_once",
    "spin_until_future_complete",
    "try_shutdown",
]
