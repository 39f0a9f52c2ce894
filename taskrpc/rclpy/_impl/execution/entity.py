"""What executors run callbacks for: timers, subscriptions, clients, services, guard conditions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from ...callback_groups import CallbackGroup


class Entity:
    """Something of a node that callbacks come from; an executor asks it, one thing at a time."""

    _is_timer: ClassVar[bool] = False
    """Whether waiting for it means waiting for a point in time (`_wait_ns`)."""

    _is_answering: ClassVar[bool] = False
    """Whether somebody waits for what its callback returns."""

    _executor_event = False
    """True from the moment an executor chose it until it was taken: not to be chosen again."""

    callback_group: CallbackGroup | None = None
    _node: Any = None

    def _ready(self) -> bool:
        """Whether something is waiting to be taken; asked on the spinning thread, often."""
        raise NotImplementedError

    def _wait_ns(self) -> int | None:
        """Of a timer: nanoseconds until it is due; None when it never will be."""
        raise NotImplementedError

    def _take(self) -> Callable[[], Any] | None:
        """Take one thing that has arrived: what runs it, or None when it is gone already."""
        raise NotImplementedError

    def _arrived(self) -> None:
        """Wake the executor that the node is in; from any thread."""
        node = self._node
        if node is not None and (executor := node.executor) is not None:
            executor._notify()
