"""The functions at the top of rclpy: init, create a node, spin, shutdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

from taskrpc.spi import current_program

from ... import signals, utilities
from ...context import Context
from ...signals import SignalHandlerOptions
from ...task import Future
from ...utilities import get_default_context
from .. import cells
from ..diagnostics.deadlocks import check_nested_spin, check_spin

if TYPE_CHECKING:
    from ...executors import Executor
    from ...node import Node

_executors: dict[str, Executor] = {}
"""The global executor of each program; see `taskrpc.core.current_program`."""


class InitContextManager:
    """The result of `init`: `with rclpy.init():` shuts down at the end of the block."""

    def __init__(self, context: Context, installed_signal_handlers: bool) -> None:
        self.context = context
        self.installed_signal_handlers = installed_signal_handlers

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        if self.context is get_default_context():
            get_default_context(shutting_down=True)
        self.context.try_shutdown()
        if self.installed_signal_handlers:
            signals.uninstall_signal_handlers()


def init(
    *,
    args: Sequence[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> InitContextManager:
    """Initialise the context, so that nodes can be created. Also `with rclpy.init():`.

    `args` is the command line by default; arguments after `--ros-args` are applied.
    Raises RuntimeError if the context is initialised already; in a notebook, that does nothing.
    """
    default = context is None or context is get_default_context()
    context = get_default_context() if context is None else context
    if cells.current is not None:
        if context.ok():
            return InitContextManager(context, False)
        # Interrupting a cell must not end the nodes of the other cells.
        signal_handler_options = SignalHandlerOptions.NO
    if signal_handler_options is None:
        signal_handler_options = SignalHandlerOptions.ALL if default else SignalHandlerOptions.NO
    context.init(args, domain_id=domain_id)
    signals.install_signal_handlers(signal_handler_options)
    return InitContextManager(context, signal_handler_options != SignalHandlerOptions.NO)


def get_global_executor() -> Executor:
    """The executor of `spin`, `spin_once` and `spin_until_future_complete`."""
    program = current_program.get()
    if (known := _executors.get(program)) is not None:
        return known
    from ...executors import SingleThreadedExecutor

    executor = _executors[program] = SingleThreadedExecutor()

    def reset() -> None:
        executor.shutdown()
        if _executors.get(program) is executor:
            del _executors[program]

    executor.context.on_shutdown(reset)  # calls it at once after a signal
    return executor


def shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut the context down: destroys its nodes and stops the executors.

    Raises RuntimeError if it is shut down already, except by Ctrl-C or SIGTERM.
    """
    utilities.shutdown(context=context)
    if uninstall_handlers or (uninstall_handlers is None and context is None):
        signals.uninstall_signal_handlers()


def create_node(node_name: str, **settings: Any) -> Node:
    """Create a node; the settings are those of `rclpy.node.Node`."""
    from ...node import Node

    return Node(node_name, **settings)


def spin_once(
    node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Wait at most `timeout_sec` seconds for something to arrive, and run one callback."""
    executor = get_global_executor() if executor is None else executor
    check_nested_spin(executor, node)
    try:
        executor.add_node(node)
        executor.spin_once(timeout_sec=timeout_sec)
    finally:
        executor.remove_node(node)


def spin(node: Node, executor: Executor | None = None) -> None:
    """Run the node's callbacks until the context is shut down.

    An exception of a callback propagates. Raises ExternalShutdownException when a signal or another
    thread shuts the context down.
    """
    executor = get_global_executor() if executor is None else executor
    check_nested_spin(executor, node)
    try:
        executor.add_node(node)
        while executor.context.ok() and not executor.is_shutdown:
            executor.spin_once()
    finally:
        executor.remove_node(node)


def spin_until_future_complete(
    node: Node,
    future: Future[Any],
    executor: Executor | None = None,
    timeout_sec: float | None = None,
) -> None:
    """Run the node's callbacks until the future is done, at most for `timeout_sec` seconds."""
    executor = get_global_executor() if executor is None else executor
    check_spin(executor, future, timeout_sec)
    added = executor.add_node(node)
    try:
        executor.spin_until_future_complete(future, timeout_sec)
    finally:
        if added:  # else an outer spin has the node and continues
            executor.remove_node(node)
