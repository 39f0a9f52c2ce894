"""Functions that need no node: the default context, its state, and arguments outside of ROS."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence

from taskrpc.spi import current_program

from ._impl.arguments import parse
from .constants import S_TO_NS
from .context import Context

_default_contexts: dict[str, Context] = {}
"""The default context of each program; see `taskrpc.core.current_program`."""
_lock = threading.Lock()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """The context that `rclpy.init()` initialises; `shutting_down` forgets it."""
    program = current_program.get()
    with _lock:
        context = _default_contexts.pop(program, None) or Context()
        if not shutting_down:
            _default_contexts[program] = context
        return context


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """The arguments without everything from `--ros-args` to `--`."""
    return parse(list(sys.argv if args is None else args), strict=False).rest


def ok(*, context: Context | None = None) -> bool:
    """Whether the context is initialised and not shut down."""
    return (get_default_context() if context is None else context).ok()


def shutdown(*, context: Context | None = None) -> None:
    """Shut the context down; raises RuntimeError if it is shut down already."""
    if context is None:
        context = get_default_context(shutting_down=True)
    context.shutdown()


def try_shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut the context down, unless it is not initialised or already shut down."""
    from .signals import uninstall_signal_handlers

    default = context is None
    if context is None:
        context = get_default_context(shutting_down=True)
    context.try_shutdown()
    if uninstall_handlers or (uninstall_handlers is None and default):
        uninstall_signal_handlers()


def get_rmw_implementation_identifier() -> str:
    """The name of the middleware that carries calls and messages."""
    return "rmw_taskrpc"


def get_available_rmw_implementations() -> set[str]:
    """The names of all middlewares that could carry them."""
    return {get_rmw_implementation_identifier()}


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """Nanoseconds of a timeout in seconds; -1 for None and for a negative one: no timeout."""
    if timeout_sec is None or timeout_sec < 0:
        return -1
    return int(float(timeout_sec) * S_TO_NS)
