"""Managed entities: objects that take part in the transitions of a lifecycle node."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from .._impl.lifecycle_states import LifecycleState
from .._impl.lifecycle_states import TransitionCallbackReturnType as TransitionCallbackReturn


class ManagedEntity:
    """Receives every transition and may fail it; this base class accepts all transitions."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The node is being configured; `state` is the former state."""
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The node releases what it configured."""
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The node shuts down, from any state."""
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The node is being activated."""
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The node is being deactivated."""
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Another callback failed with an error; SUCCESS means that the error is handled."""
        return TransitionCallbackReturn.SUCCESS


class SimpleManagedEntity(ManagedEntity):
    """Remembers whether the node is active."""

    def __init__(self) -> None:
        self._enabled = False

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Remember that the node is active."""
        self._enabled = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Remember that the node is not active."""
        self._enabled = False
        return TransitionCallbackReturn.SUCCESS

    @property
    def is_activated(self) -> bool:
        """Whether the node is active."""
        return self._enabled

    @staticmethod
    def when_enabled(
        wrapped: Callable[..., Any] | None = None,
        *,
        when_not_enabled: Callable[[], Any] | None = None,
    ) -> Callable[..., Any]:
        """Decorates a method that does nothing (or calls another function) while not activated."""

        def decorated(method: Callable[..., Any]) -> Callable[..., None]:
            @functools.wraps(method)
            def only_when_enabled(self: SimpleManagedEntity, *args: Any, **values: Any) -> None:
                if self._enabled:
                    method(self, *args, **values)
                elif when_not_enabled is not None:
                    when_not_enabled()

            return only_when_enabled

        return decorated if wrapped is None else decorated(wrapped)
